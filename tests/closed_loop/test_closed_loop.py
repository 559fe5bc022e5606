"""The whole stack around a simulated Lite, one tick at a time: each mode does to the robot what it is for."""

import numpy as np
import pytest

from humanoid_sim.messages import Intent, Mode, TickInput
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.kinematics import GravityTorque
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.sim_robot import SimRobot
from humanoid_sim.stack import build_supervisor

LITE, PERIOD = load_robot("lite"), 0.005


class Drive:
    """Steps robot and supervisor in turn and keeps what passed between them."""

    def __init__(self):
        self.robot = SimRobot(LITE, SimConfig(control_period=PERIOD))
        self.supervisor = build_supervisor(LITE, PERIOD, None)
        self.memory = self.supervisor.initial()
        self.states, self.outputs = [], []

    def step(self, *intents):
        state, safety = self.robot.read()
        self.memory, output = self.supervisor.step(self.memory, TickInput(state, safety, intents))
        self.robot.write(output.command)
        self.states.append(state)
        self.outputs.append(output)

    def run(self, seconds):
        for _ in range(round(seconds / PERIOD)):
            self.step()

    def stand(self, load=Intent.LOAD_A):
        """DAMPING, then STANDBY until it is finished."""
        self.step(Intent.DAMP)
        self.step(load)
        while not self.outputs[-1].standby.is_finished:
            self.step()

    def applied(self, since):
        """Shape (ticks, n), N·m: the torques that the motors applied, from tick `since` on."""
        return np.array([state.joint_effort for state in self.states[since:]])


@pytest.mark.parametrize("load", [Intent.LOAD_A, Intent.LOAD_B])
def test_standby_reaches_its_pose_up_to_the_sag_of_its_springs_without_a_step_in_torque(load):
    standby = LITE.standby_controller_a if load is Intent.LOAD_A else LITE.standby_controller_b
    drive = Drive()
    drive.step(Intent.DAMP)
    drive.run(1.0)  # at rest
    entered = len(drive.states)
    drive.stand(load)
    assert drive.states[-1].time - drive.states[entered].time == pytest.approx(sum(standby.segment_durations), abs=0.02)
    change = np.abs(np.diff(drive.applied(entered - 1), axis=0)).max(axis=1)
    ramp = round(standby.segment_durations[0] / PERIOD)
    assert change[:3].max() < 0.02  # N·m per tick of 5 ms: nothing jumps when it begins
    assert change[:ramp].max() < 0.1
    # The corner of the trajectory between its segments is a step in speed, which K_d turns into one of torque.
    assert change.max() < 0.5
    assert np.abs(drive.applied(entered)).max() > 1.0  # something was driven at all
    drive.run(1.0)
    goal, state = np.array(standby.pose_segments[-1]), drive.states[-1]
    assert drive.outputs[-1].command.position.tolist() == goal.tolist()
    # A spring of stiffness K_p gives way by gravity / K_p; friction and what still moves add 0.1° or so.
    sag = np.abs(GravityTorque(LITE)(state.joint_position)) / np.array(standby.target_stiffness)
    assert 0.01 < sag.max() < 0.1
    assert (np.abs(state.joint_position - goal) <= sag + 0.003).all()
    assert np.abs(state.joint_velocity).max() < 0.005
    assert drive.outputs[-1].control_mode.mode is Mode.STANDBY


def test_arms_that_are_let_go_sink_slowly():
    speeds = []
    for is_damped in (True, False):
        drive = Drive()
        drive.stand()
        if is_damped:
            drive.step(Intent.DAMP)
        else:  # what ZERO_TORQUE would do
            drive.memory = drive.supervisor.initial()
        drive.run(1.0)
        speeds.append(max(np.abs(state.joint_velocity).max() for state in drive.states[-200:]))
    assert speeds[0] < 1.0  # rad/s
    assert speeds[1] > 5.0
