from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import pytest

from humanoid_sim.training.ppo import videos as module
from humanoid_sim.training.ppo.options import TrainConfig
from humanoid_sim.training.ppo.subject import subject_of
from humanoid_sim.training.ppo.videos import Videos

LEGS = subject_of(TrainConfig(robot="lite_biped"))


def test_a_video_is_a_run_of_play(tmp_path: Path) -> None:
    legs = Videos(LEGS, tmp_path, None).command(tmp_path / "0000001000.onnx")
    assert legs[1:3] == ["-m", "humanoid_sim.play"]
    assert "--command=0.4,0,0" in legs  # half of the greatest
    assert legs[legs.index("--video") + 1] == str(tmp_path / "0000001000.mp4")
    arms = Videos(subject_of(TrainConfig()), tmp_path, None).command(tmp_path / "0000001000.onnx")
    assert arms[arms.index("--motion") + 1] == "wave"
    assert not any(word.startswith("--command") for word in arms)


def test_none_is_made_before_it_is_time(tmp_path: Path) -> None:
    learner: Any = None  # which would fail
    for minutes in (None, 60.0):
        videos = Videos(LEGS, tmp_path, minutes)
        videos.show(learner, 1000)
        videos.close()
    assert list((tmp_path / "videos").iterdir()) == []


def test_the_next_waits_for_the_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Process:
        running = True
        started: ClassVar[list[list[str]]] = []

        def __init__(self, command: list[str], **_: Any) -> None:
            self.started.append(command)

        def poll(self) -> int | None:
            return None if self.running else 0

        def wait(self, _: float | None = None) -> int:
            return 0

    class Learner:
        def network(self) -> None:
            return None

    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(module.subprocess, "Popen", Process)
    monkeypatch.setattr(module, "write_network", lambda path, *_: path.write_bytes(b""))
    learner: Any = Learner()
    videos = Videos(LEGS, tmp_path, 1.0)
    for seconds, steps in ((59.0, 1), (61.0, 2), (200.0, 3)):
        now[0] = seconds
        videos.show(learner, steps)
    assert [Path(command[4]).stem for command in Process.started] == ["0000000002"]
    monkeypatch.setattr(Process, "running", False)
    videos.show(learner, 4)
    assert [Path(command[4]).stem for command in Process.started] == ["0000000002", "0000000004"]
    videos.close()
