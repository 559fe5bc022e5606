"""Motors of two families on one robot and one bus: ten Robstride and four Sito, emulated."""

import time
from contextlib import closing, contextmanager

import can
import numpy as np
import pytest

from humanoid_sim.hardware.can_bus import frame_of
from humanoid_sim.hardware.joints import JointTracker, make_wiring, motor_values
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.motor_link import Readings
from humanoid_sim.hardware.robot import HardwareRobot
from humanoid_sim.hardware.sito import motors as sito_motors
from humanoid_sim.hardware.sito.protocol import Command, Enable, Gains, HostMessage, Reset, decode
from humanoid_sim.messages import SafetyFlag
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.session.realtime import punctual_threads

ROBOT = load_robot("lite_sito")
ZEROS = dict.fromkeys(ROBOT.joint_names, 0.0)
WRISTS = (5, 6, 12, 13)
TA50 = MOTORS["TA40-50"]


@pytest.fixture(autouse=True)
def short_listening(monkeypatch):
    monkeypatch.setattr(sito_motors, "_LISTENING", 0.05)


@contextmanager
def rig(before=lambda _: None):
    told, channel = [], "virtual:mixed"
    with punctual_threads(behind=10):
        motors = MockServer(ROBOT, [channel], log=lambda _, text: told.append(text))
    with motors:
        before(motors)
        robot = HardwareRobot(
            ROBOT,
            [channel],
            calibration=ZEROS,
            allow_no_timeout=True,
            can_timeout=1.0,  # a busy machine may not send for a while
            clock=motors.clock,
        )
        with closing(robot):
            yield robot, motors, told


def hold(robot, seconds, stiffness=0.0):
    target = np.array(ROBOT.initial_position) + 0.1
    command = MITCommand(target, np.zeros(14), np.zeros(14), np.full(14, stiffness), np.full(14, 2.0))
    for _ in range(round(seconds / 0.02)):
        robot.write(command)
        time.sleep(0.02)


def test_from_limp_to_holding_to_disabled():
    with rig() as (robot, motors, told):
        robot.prepare()
        state, statuses = robot.read()
        assert np.isnan(state.joint_position[list(WRISTS)]).all(), "they tell nothing before they are enabled"
        assert np.isfinite(np.delete(state.joint_position, WRISTS)).all()
        assert told == []
        assert {status.flags for status in statuses} == {SafetyFlag.MOTOR_FAULT}
        robot.activate()
        assert len(told) == 14
        assert set(told[:4]) == {f"{ROBOT.joint_names[i]}: enabled" for i in WRISTS}, "first those that nothing stops"
        hold(robot, 0.3, 50.0)
        state, statuses = robot.read()
        assert all(status.is_ok for status in statuses), statuses
        assert (state.joint_age < 1.0).all()
        assert np.abs(state.joint_position - motors.truth.joint_position).max() < 0.02
        assert np.abs(motors.truth.joint_effort).max() > 0.5
        figures = robot.figures()
        assert figures["commands"] == 15
        assert figures["channels"][0]["received"] >= 10 * 15
        robot.close()
        assert len([text for text in told if text.endswith(": disabled")]) == 14


def test_zero_gains_and_zero_current_come_before_enabling_and_in_the_first_frame_after():
    """Whether a disabled motor takes gains is not known, and its last host left it stiff."""

    def leave_stiff(motors):
        def change(mock):
            motor = mock.motors[5]
            motor.gains, motor.command = Gains(16, 20.0, 1.0), Command(16, 0.5, 0.0, 0.0)

        motors.call(change)

    with rig(leave_stiff) as (robot, motors, _):
        with can.Bus(interface="virtual", channel=motors.addresses[0].channel) as listener:
            robot.activate()
            heard = [decode(frame_of(message), TA50) for message in iter(lambda: listener.recv(0.0), None)]
        sent = [message for message in heard if isinstance(message, HostMessage) and message.device_id == 16]
        (enabling,) = (i for i, message in enumerate(sent) if isinstance(message, Enable))
        limp = [Gains(16, 0.0, 0.0), Gains(16, 0.0, 0.0), Command(16, 0.0, 0.0, 0.0)]
        assert sent[enabling] == Enable(16, 20)
        assert sent[enabling - 3 : enabling] == sent[enabling + 1 : enabling + 4] == limp
        assert all(message in limp or isinstance(message, Reset) for message in sent[:enabling])
        later = [message for message in sent[enabling + 4 :] if isinstance(message, Gains)]
        assert later
        assert all(message == limp[0] for message in later), "until the loop commands"


def test_torque_is_bounded_for_the_strongest_reading_of_the_gains():
    """688.58 where the library has 500: the same frame may mean 1.38 times the K_p."""
    wiring = make_wiring(ROBOT, 1, ZEROS)
    tracker = JointTracker(wiring, np.zeros(14))
    joints = tracker.update(Readings(*np.zeros((5, 14))))
    stiff = MITCommand(np.full(14, 0.4), *np.zeros((2, 14)), np.full(14, 50.0), np.zeros(14))
    values = motor_values(wiring, stiff, joints, tracker, 0.04)
    assert np.abs(values[0, WRISTS]) == pytest.approx([4.0 / (50.0 * 688.58 / 500.0)] * 4, abs=1e-4)
