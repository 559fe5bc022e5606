"""What runs without the parts of Python that only Unix or Linux has, and what refuses with a line.

It shows that nothing needs them. It does not show that anything runs on Windows or macOS: nobody has tried.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ABSENT = Path(__file__).parent / "absent.py"
LINE = "use Linux; environments, regress and the tools for policies run here\n"

ENVIRONMENTS = """
import gymnasium, humanoid_sim
env = gymnasium.make("humanoid_sim/LiteTracking-v0")
env.reset(seed=0)
_, reward, terminated, _, _ = env.step(env.action_space.sample() * 0.0)
envs = gymnasium.make_vec("humanoid_sim/LiteTracking-v0", num_envs=3, vectorization_mode="vector_entry_point")
envs.reset(seed=0)
_, rewards, *_ = envs.step(envs.action_space.sample() * 0.0)
envs.close()
print(terminated, 0.0 < reward < 0.1, rewards.shape)
"""
SIMULATION = """
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
robot = MujocoRobot(load_robot("lite"))
before, _ = robot.read()
robot.write(MITCommand.zeros(14))
after, _ = robot.read()
print(after.time > before.time, (after.joint_position != before.joint_position).any())
"""
PROGRAM = """
import sys
from humanoid_sim.cli import main
sys.exit(main({words!r}))
"""
PROGRAMS = """
import sys
from humanoid_sim.cli import main
for words in {words!r}:
    try:
        status = main(words)
    except SystemExit as stopped:
        status = stopped.code
    print("status", int(status))
"""
GONE = """
import os
for name in "import fcntl", "import termios", "import resource", "import socket; socket.AF_UNIX", "os.symlink(*'ab')":
    try:
        exec(name)
    except (ImportError, AttributeError, OSError):
        print(name)
print(hasattr(os, "sched_setscheduler"))
"""


def run(code, folder):
    return subprocess.run(
        [sys.executable, str(ABSENT), code], cwd=folder, capture_output=True, text=True, check=False, timeout=200
    )


def test_they_are_absent(tmp_path):
    done = run(GONE, tmp_path)
    assert (done.returncode, done.stdout.count("\n")) == (0, 6)
    assert done.stdout.endswith("\nFalse\n")


@pytest.mark.parametrize(("code", "printed"), [(ENVIRONMENTS, "False True (3,)\n"), (SIMULATION, "True True\n")])
def test_simulation_and_environments(code, printed, tmp_path):
    done = run(code, tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, printed, "")


def test_regress_with_its_files(tmp_path):
    words = ["regress", "lite_tracking.onnx", "--seeds", "2", "--only", "circle", "--json", "r.json", "--quiet"]
    (tmp_path / "lite_tracking.onnx").write_bytes(
        (Path(__file__).parents[2] / "assets" / "policies" / "lite_tracking.onnx").read_bytes()
    )
    done = run(PROGRAM.format(words=words), tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_an_episode_and_its_replay(tmp_path):
    policy = str(Path(__file__).parents[2] / "assets" / "policies" / "lite_tracking.onnx")
    done = run(PROGRAM.format(words=["regress", policy, "--episode", "circle:1", "--record-failures", "f"]), tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    (recording,) = (tmp_path / "f").rglob("*.mcap")
    done = run(PROGRAM.format(words=["replay", str(recording)]), tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


def test_sessions_and_hardware_refuse_in_one_line(tmp_path):
    words = [["play", "--duration", "1"], ["hardware", "ping", "virtual:x", "11"], ["viewer"]]
    done = run(PROGRAMS.format(words=words), tmp_path)
    assert (done.returncode, done.stdout) == (0, "status 2\n" * 3)
    for line in (lines := done.stderr.splitlines(keepends=True)):
        assert line.startswith("error: sessions, front ends and hardware need Python's module '")
        assert line.endswith(LINE)
    assert len(lines) == 3
    assert list(tmp_path.iterdir()) == []


def test_help_is_had_everywhere(tmp_path):
    done = run(PROGRAMS.format(words=[["play", "--help"], ["regress", "-h"], []]), tmp_path)
    assert (done.returncode, done.stdout.count("status 0\n")) == (0, 3)
