"""Signs in a run: START is refused for a mirrored joint, an operator may know better, and it replays."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.messages import Mode
from humanoid_sim.mit import GRAVITY_LEVERS
from humanoid_sim.play import played_robot
from humanoid_sim.replay import main as replay
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.mujoco_robot import MujocoRobot

SCRIPT = "damp; load_b; wait; start_locomotion; hold 0.1; damp"


@pytest.fixture
def mirrored(monkeypatch):
    """A Lite whose left shoulder roll motor turns the other way round."""

    class Mirrored(MujocoRobot):
        @property
        def _sign(self):
            return np.where(np.array(self.joints) == "left_shoulder_roll", -1.0, 1.0)

        def read(self):
            state, safety = super().read()
            fields = ("joint_position", "joint_velocity", "joint_effort")
            return replace(state, **{name: self._sign * getattr(state, name) for name in fields}), safety

        def write(self, command):
            fields = ("position", "velocity", "effort")
            super().write(replace(command, **{name: self._sign * getattr(command, name) for name in fields}))

    monkeypatch.setattr(played_robot, "MujocoRobot", Mirrored)


@pytest.mark.usefixtures("mirrored")
def test_a_mirrored_joint_refuses_start(run, quick, folder):
    result = run("--robot", quick, "--script", SCRIPT)
    assert "START_LOCOMOTION refused: left_shoulder_roll contradicts gravity: held with " in result.out + result.err
    assert Mode.LOCOMOTION not in {tick.output.control_mode.mode for tick in result.ticks}
    samples = [tick for tick in result.ticks if GRAVITY_LEVERS in tick.input.state.extern]
    assert {round(20 * tick.input.state.time) % 2 for tick in samples} == {0}, "ten a second"
    assert run_program(replay, [str(folder / "r.mcap")]) == 0


@pytest.mark.usefixtures("mirrored")
def test_an_operator_may_know_better(run, quick, folder):
    result = run("--robot", quick, "--script", SCRIPT, "--allow-sign-contradiction", "left_shoulder_roll")
    assert "refused" not in result.out
    assert "left_shoulder_roll contradicts gravity: held with " in result.out
    assert Mode.LOCOMOTION in {tick.output.control_mode.mode for tick in result.ticks}
    assert run_program(replay, [str(folder / "r.mcap")]) == 0


def test_check_poses_come_at_the_end_of_standby(run, make_robot):
    def change(document):
        document["check_poses"] = [{"left_wrist_yaw": 0.2}]

    robot = make_robot(change=change)
    result = run("--robot", robot, "--script", "damp; load_b; wait; hold 0.1; damp", "--check-poses")
    assert result.status == 0
    assert "of 14 joints agree with gravity, " in result.out
    wrist = result.ticks[0].input.state.joint_position.size // 2 - 3
    asked = np.array([tick.output.command.position[wrist] for tick in result.ticks])
    assert asked.max() == pytest.approx(0.2)
    finished = next(tick for tick in result.ticks if tick.output.standby and tick.output.standby.is_finished)
    assert finished.output.command.position[wrist] == pytest.approx(0.0)


def test_check_poses_that_would_do_harm_are_refused(run, make_robot):
    robot = make_robot(change=lambda document: document.update(check_poses=[{"left_elbow_pitch": -0.6}]))
    result = run("--robot", robot, "--check-poses")
    assert result.status == 2
    assert result.err.startswith("error: --check-poses: check_poses[0]: left_elbow_pitch would be at 0.60 rad mirrored")


def test_who_cannot_be_judged_and_why():
    arms, legs = load_robot("lite"), load_robot("lite_biped")
    assert played_robot.gravity_levers(arms, has_imu=False)[0] is not None
    for robot, reason in (
        (msgspec.structs.replace(arms, signs=None), "the robot's file turns that off"),
        (legs, "without an IMU nobody knows how the robot hangs"),
    ):
        levers, notices = played_robot.gravity_levers(robot, has_imu=False)
        assert levers is None
        assert notices == (f"signs are not judged in STANDBY: {reason}",)
