"""`python -m humanoid_sim.sysid`: from recordings to files that the other programs take, and what is refused."""

import json
import re

import pytest
import yaml
from planted_arm import PERIOD, arm, motion, planted, simulated, write

pytest.importorskip("colorama")  # of mujoco[sysid]

from humanoid_sim.cli import main
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch import Randomisation
from humanoid_sim.simulation.mujoco_robot import MujocoRobot


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A robot's file and a recording of what it really is."""
    folder = tmp_path_factory.mktemp("sysid")
    robot = arm(folder)
    write(folder / "run.mcap", simulated(planted(robot), motion(12.0)), robot)
    return folder


@pytest.fixture(scope="module")
def fitted(folder):
    """Folder and exit status of a fit of it, the recording given twice."""
    run, output = str(folder / "run.mcap"), folder / "fitted"
    copy = folder / "copy.mcap"
    copy.write_bytes((folder / "run.mcap").read_bytes())
    only = ("--only", "armature", "friction", "torque_scale", "delay", "offset")
    status = main(["sysid", run, str(copy), "--robot", str(folder / "arm.yaml"), "-o", str(output), *only])
    return output, status


def test_a_fit_that_predicts_better_is_a_robot_like_any_other(fitted):
    output, status = fitted
    assert status == 0
    robot = load_robot(output / "robot.yaml")
    own = {joint.name: joint.dynamics for joint in robot.joints}
    assert own["shoulder"].armature == pytest.approx(0.015, rel=0.2)
    assert own["shoulder"].torque_scale == pytest.approx(0.9, rel=0.1)
    simulation = MujocoRobot(robot, control_period=PERIOD)
    dof = simulation.model.joint("shoulder").dofadr[0]
    assert simulation.model.dof_armature[dof] == own["shoulder"].armature
    state, _ = simulation.read()
    simulation.write(MITCommand.zeros(2))
    assert state.joint_position.shape == (2,)


def test_ranges_results_and_page_lie_beside_it(fitted):
    output, _ = fitted
    ranges = Randomisation.of(yaml.safe_load((output / "randomisation.yaml").read_text()))
    assert ranges.armature[0] < 1.0 < ranges.armature[1]
    results = json.loads((output / "sysid.json").read_text())
    assert results["better"]
    assert results["notes"] == ["copy.mcap holds the same data as run.mcap; it counts once"]
    kinds = {row["kind"] for row in results["parameters"]}
    assert kinds == {"armature", "friction", "torque_scale", "delay", "offset"}
    text = (output / "sysid.html").read_text()
    assert "<svg" in text
    assert re.findall(r'(?:src|href)="(?!#)|@import|url\((?!#)', text) == []


def test_files_that_are_there_are_not_replaced(folder, fitted, capsys):
    assert main(["sysid", str(folder / "run.mcap"), "--robot", str(folder / "arm.yaml"), "-o", str(fitted[0])]) == 2
    assert capsys.readouterr().err == f"error: {fitted[0] / 'robot.yaml'}: exists; --overwrite replaces it\n"


def test_data_that_nothing_new_is_in_is_status_1(folder, tmp_path, capsys):
    robot = load_robot(folder / "arm.yaml")
    path = write(tmp_path / "same.mcap", simulated(robot, motion(8.0), offset=0.0), robot)
    status = main(
        ["sysid", str(path), "--robot", str(folder / "arm.yaml"), "-o", str(tmp_path / "out"), "--only", "friction"]
    )
    assert status == 1
    assert "not better: errors on data that were not fitted" in capsys.readouterr().out


def refused(capsys, *words):
    assert main(["sysid", *map(str, words)]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    return err.removeprefix("error: ").rstrip("\n")


def test_what_cannot_be_used_is_said_in_one_line(folder, tmp_path, capsys):
    run, robot = folder / "run.mcap", folder / "arm.yaml"
    (tmp_path / "text.mcap").write_text("no recording")
    short = write(tmp_path / "short.mcap", simulated(load_robot(robot), motion(1.0)), load_robot(robot))
    new = ("-o", tmp_path / "new")
    assert "text.mcap" in refused(capsys, tmp_path / "text.mcap", "--robot", robot, *new)
    assert refused(capsys, run, *new).startswith(
        f"{run}: has no joint 'left_shoulder_pitch' of the robot; it has: shoulder"
    )
    assert "leave no stretch of 2 s" in refused(capsys, short, "--robot", robot, *new)
    assert "holds data that are fitted" in refused(capsys, run, "--robot", robot, "--judge", run, *new)
    assert "expected at least one" in refused(capsys, "--robot", robot, *new)
    assert "Expected one of" in refused(capsys, run, "--robot", robot, "--only", "frition", *new)
    assert not (tmp_path / "new").exists()
