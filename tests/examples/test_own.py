"""The examples run as they stand."""

import os
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from script_files import load_script

from humanoid_sim.assets import asset_path
from humanoid_sim.errors import InputError
from humanoid_sim.mit import MITCommand

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name):
    return load_script(EXAMPLES / f"{name}.py")


def test_a_controller_of_ones_own_drives_the_robot(capsys):
    load("own_controller").main()
    *modes, swayed = capsys.readouterr().out.splitlines()
    assert [line.split()[2] for line in modes] == ["DAMPING", "STANDBY", "LOCOMOTION", "DAMPING"]
    low, high = (float(word) for word in swayed.split()[3:6:2])
    assert high - low == pytest.approx(0.4, abs=0.05)


def test_the_controller_stands_what_the_fuzzer_does_to_it():
    from humanoid_sim.testing import DEFAULT_SETTINGS, fuzz_controller  # noqa: PLC0415 - an extra

    few = type(DEFAULT_SETTINGS)(DEFAULT_SETTINGS, max_examples=20, derandomize=True, database=None)
    fuzz_controller(load("own_controller").Sway(("shoulder", "elbow"), ("elbow",)), few, healthy_ticks=200)


def test_a_front_end_of_ones_own_watches_a_session(tmp_path, runtime):
    words = ["--pace", "realtime", "--script", "hold 60", "--viewer", "none", "--record", "none"]
    session = subprocess.Popen(
        [sys.executable, "-m", "humanoid_sim.play", *words], stdout=subprocess.DEVNULL, cwd=tmp_path
    )
    try:
        deadline = time.monotonic() + 60.0
        while not list(runtime.rglob("*.session")) and time.monotonic() < deadline:
            time.sleep(0.1)
        watcher = subprocess.Popen(
            [sys.executable, str(EXAMPLES / "own_front_end.py")], stdout=subprocess.PIPE, text=True
        )
        lines = [watcher.stdout.readline() for _ in range(2)]
        session.terminate()
        assert watcher.wait(30.0) == 0
        watcher.stdout.close()
    finally:
        session.kill()
        session.wait()
    assert all(line.endswith(" N·m\n") for line in lines)


def test_motors_of_ones_own_follow_worse(capsys):
    load("own_motor").main()
    ideal, tired = (float(line.split()[5]) for line in capsys.readouterr().out.splitlines())
    assert 0.01 < ideal < tired < 0.1


def test_motors_of_ones_own_give_what_the_law_asks_for_where_nothing_is_lost():
    example = load("own_motor")

    class Ideal(example.TiredMotors):
        friction, no_load_velocity = 0.0, 1e12

    command = MITCommand.zeros(14)
    ends = []
    for motors in (None, Ideal):
        robot = example.MujocoRobot(example.LITE, control_period=0.005, motors=motors)
        for _ in range(20):
            robot.write(command)
        ends.append(robot.read()[0].joint_position)
        robot.close()
    assert abs(ends[0] - ends[1]).max() < 1e-9
    with pytest.raises(InputError, match="actuation: is 'affine', expected 'qfrc_applied' for motors of your own"):
        example.MujocoRobot(example.LITE, actuation="affine", motors=Ideal)


def test_a_task_of_ones_own_alone_and_in_a_batch(capsys):
    load("own_task").main()
    zeros, random, batch = capsys.readouterr().out.splitlines()
    held, strayed = (float(line.split()[1]) for line in (zeros, random))
    assert zeros.endswith("held out")
    assert 1.0 < held <= 2.0
    assert strayed < held
    assert 0.0 < float(batch.split()[3]) <= 0.02


@pytest.mark.slow
def test_branching_from_a_recording_shows_how_hard_a_push_is_stood(tmp_path):
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    run = subprocess.run(
        ["bash", str(EXAMPLES / "branch.sh"), str(tmp_path)],
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )
    assert (run.returncode, run.stderr) == (0, "")
    weakest, *_, strongest, hint = run.stdout.splitlines()
    assert weakest == "0.2 m/s to the left: stands"
    assert strongest == "2.5 m/s to the left: falls"
    assert Path(hint.split("--again ")[1].split()[0]).stat().st_size > 1000


@pytest.mark.slow
def test_the_ci_job_compares_two_policies(tmp_path):
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
