"""The examples run as they stand."""

from __future__ import annotations

import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest
import yaml

from humanoid_sim.assets import asset_path

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_a_controller_of_ones_own_drives_the_robot(capsys: pytest.CaptureFixture[str]) -> None:
    load("own_controller").main()
    *modes, swayed = capsys.readouterr().out.splitlines()
    assert [line.split()[2] for line in modes] == ["DAMPING", "STANDBY", "LOCOMOTION", "DAMPING"]
    low, high = (float(word) for word in swayed.split()[3:6:2])
    assert high - low == pytest.approx(0.4, abs=0.05)


def test_the_controller_stands_what_the_fuzzer_does_to_it() -> None:
    from humanoid_sim.testing import DEFAULT_SETTINGS, fuzz_controller  # noqa: PLC0415 - an extra

    few = type(DEFAULT_SETTINGS)(DEFAULT_SETTINGS, max_examples=20, derandomize=True, database=None)
    fuzz_controller(load("own_controller").Sway(("shoulder", "elbow"), ("elbow",)), few, healthy_ticks=200)


def test_a_front_end_of_ones_own_watches_a_session(tmp_path: Path) -> None:
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)}
    words = ["--pace", "realtime", "--script", "hold 60", "--viewer", "none", "--record", "none"]
    session = subprocess.Popen(
        [sys.executable, "-m", "humanoid_sim.play", *words], stdout=subprocess.DEVNULL, cwd=tmp_path, env=environment
    )
    try:
        deadline = time.monotonic() + 60.0
        while not list(tmp_path.rglob("*.session")) and time.monotonic() < deadline:
            time.sleep(0.1)
        watcher = subprocess.Popen(
            [sys.executable, str(EXAMPLES / "own_front_end.py")], stdout=subprocess.PIPE, text=True, env=environment
        )
        assert watcher.stdout is not None
        lines = [watcher.stdout.readline() for _ in range(2)]
        session.terminate()
        assert watcher.wait(30.0) == 0
        watcher.stdout.close()
    finally:
        session.kill()
        session.wait()
    assert all(line.endswith(" N·m\n") for line in lines)


@pytest.mark.slow
def test_the_ci_job_compares_two_policies(tmp_path: Path) -> None:
    workflow = yaml.safe_load((EXAMPLES / "ci" / "regress.yml").read_text())
    (command,) = [step["run"] for step in workflow["jobs"]["regress"]["steps"] if "regress " in step.get("run", "")]
    words = shlex.split(command)
    assert words[:3] == ["python", "-m", "humanoid_sim.regress"]
    (tmp_path / "policies").mkdir()
    for name in ("tonight", "released"):
        shutil.copy(asset_path("policies", "lite_tracking.onnx"), tmp_path / "policies" / f"{name}.onnx")
    few = ["--seeds", "2", "--only", "circle"]
    run = subprocess.run([sys.executable, *words[1:], *few], cwd=tmp_path, check=False, timeout=200)
    assert run.returncode == 0
    for name in workflow["jobs"]["regress"]["steps"][-1]["with"]["path"].split("\n")[:2]:
        assert (tmp_path / name).stat().st_size > 500
