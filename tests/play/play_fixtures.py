"""A quick robot and a way to run `play` in a folder of its own, within this process."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml

from humanoid_sim.assets import asset_path
from humanoid_sim.cli import run_program
from humanoid_sim.messages import Event, TickRecord
from humanoid_sim.play import main
from humanoid_sim.recording.reader import open_recording

Document = dict[str, Any]


@dataclass
class Result:
    """Status, output and files of one run."""

    status: int
    out: str
    err: str
    folder: Path
    ticks: list[TickRecord] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    summary: Document = field(default_factory=dict)

    @property
    def modes(self) -> list[str]:
        """The modes in the order in which they were entered."""
        return [span["mode"] for span in self.summary["modes"]]

    @property
    def reasons(self) -> list[str]:
        """Why each was entered."""
        return [span["reason"] for span in self.summary["modes"]]


@pytest.fixture
def folder(tmp_path: Path, runtime: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder, without a display."""
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"):
        monkeypatch.delenv(name, raising=False)
    return work


def quick_robot(folder: Path, name: str = "lite", change: Callable[[Document], Any] = lambda _: None) -> str:
    """Writes a copy of a shipped robot that reaches its standby poses in 0.4 s, changed by a function; its path."""
    document = yaml.load(asset_path("robots", f"{name}.yaml").read_text(encoding="utf-8"), yaml.CSafeLoader)
    document["mjcf"] = str((asset_path("robots") / document["mjcf"]).resolve())
    for pose in ("a", "b"):
        standby = document[f"standby_controller_{pose}"]
        standby["segment_durations"] = [0.2] * len(standby["pose_segments"])
    change(document)
    path = folder / f"quick_{name}.yaml"
    path.write_text(yaml.dump(document, Dumper=yaml.CSafeDumper), encoding="utf-8")
    return str(path)


@pytest.fixture
def make_robot(tmp_path: Path) -> Callable[..., str]:
    """`quick_robot` in the test's own folder."""
    return partial(quick_robot, tmp_path)


@pytest.fixture
def quick(make_robot: Callable[..., str]) -> str:
    """The quick Lite's path."""
    return make_robot()


@pytest.fixture
def run(folder: Path, capfd: pytest.CaptureFixture[str]) -> Callable[..., Result]:
    """`run("--duration", "1")`: everything that `play` printed and wrote; no viewer, and the recording in `r.mcap`."""

    def play(*arguments: str, record: bool = True) -> Result:
        options = ["--viewer", "none"] if "--viewer" not in arguments else []
        if record:
            options += ["--record", "r.mcap", "--summary", "s.json", "--overwrite"]
        capfd.readouterr()
        try:
            status = run_program(main, [*arguments, *options])
        except SystemExit as stop:  # tyro's way out
            status = int(stop.code or 0)
        captured = capfd.readouterr()
        result = Result(status, captured.out, captured.err, folder)
        if record and (folder / "r.mcap").exists():
            recording = open_recording(folder / "r.mcap")
            for entry in recording.entries():
                (result.ticks if isinstance(entry, TickRecord) else result.events).append(entry)
            assert recording.is_complete
        if record and (folder / "s.json").exists():
            result.summary = json.loads((folder / "s.json").read_text(encoding="utf-8"))
        return result

    return play
