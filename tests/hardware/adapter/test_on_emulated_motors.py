"""The adapter and emulated motors, MuJoCo behind them: two implementations of the protocol that must agree."""

import contextlib
import itertools
import time

import msgspec
import numpy as np
import pytest
from waiting import wait_until

from humanoid_sim.hardware.adapter import control
from humanoid_sim.hardware.adapter.robot import HardwareRobot
from humanoid_sim.hardware.checks import Verdict
from humanoid_sim.hardware.emulation.faults import parse_fault
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.messages import SafetyFlag
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.schema import HardwareSettings

pytestmark = pytest.mark.soak

LITE = load_robot("lite")
N = LITE.joint_count
ZEROS = np.zeros(N)
_numbers = itertools.count()


@pytest.fixture(autouse=True)
def short_waits(monkeypatch):
    """These motors answer in the time that a bus takes: the waits for answers are as they are."""
    monkeypatch.setattr(control, "_LONGEST", 0.1)


def _offsets():
    """Homing offsets of a robot as it is assembled: anything within a turn."""
    generator = np.random.default_rng(3)
    return dict(zip(LITE.joint_names, generator.uniform(-1.2, 1.2, N).tolist(), strict=True))


def _channels(count):
    return [f"virtual:adapter-{next(_numbers)}" for _ in range(count)]


def _robot(motors, channels, offsets=None, can_timeout=1.0):
    """A robot that a busy machine does not disturb, unless the test says so."""
    calibration = dict.fromkeys(LITE.joint_names, 0.0) if offsets is None else offsets
    patient = msgspec.structs.replace(LITE, hardware=HardwareSettings(rx_timeout_ms=2000.0))
    return HardwareRobot(patient, channels, calibration=calibration, can_timeout=can_timeout, open_bus=motors.open_bus)


def _hold(position, stiffness=50.0, damping=1.0):
    return MITCommand(position, ZEROS, ZEROS, np.full(N, stiffness), np.full(N, damping))


def _drive(robot, command, seconds, until=lambda _: False):
    """Write a command at 50 Hz, for some time at most; the last state, and what was not OK."""
    bad = []
    deadline = time.monotonic()
    for _ in range(round(seconds / 0.02)):
        state, statuses = robot.read()
        bad += [status for status in statuses if not status.is_ok]
        if until(state):
            break
        robot.write(command)
        deadline += 0.02
        time.sleep(max(0.0, deadline - time.monotonic()))
    return state, bad


@pytest.mark.parametrize("channel_count", [2, 1])
def test_an_assembled_robot_is_read_where_it_is_and_moved_where_it_should_be(channel_count):
    channels, offsets = _channels(channel_count), _offsets()
    target = np.array(LITE.initial_position) + 0.1
    settings = EmulationSettings(homing_offset=offsets, physics_timestep=0.001)
    with (
        VirtualMotors(LITE, channels, settings=settings) as motors,
        contextlib.closing(_robot(motors, channels, offsets)) as robot,
    ):
        robot.activate()
        assert all(check.verdict is not Verdict.PROBLEM for check in robot.checks)
        state, _ = robot.read()
        np.testing.assert_allclose(state.joint_position, motors.truth.joint_position, atol=0.02)
        np.testing.assert_allclose(state.joint_position, LITE.initial_position, atol=0.1)

        def is_there(state):
            wrists = np.abs(state.joint_position[4:7] - target[4:7]).max() < 0.03
            slow = np.abs(state.joint_velocity).max() < 0.02
            return bool(wrists and slow)

        state, bad = _drive(robot, _hold(target), 10.0, is_there)
        bad = [status for status in bad if status.flags != SafetyFlag.TX_QUEUE_OVERRUN]  # a very busy machine
        assert is_there(state)
        np.testing.assert_allclose(state.joint_position, motors.truth.joint_position, atol=0.02)
        robot.close()
        assert bad == []
        statistics = robot.statistics
        assert statistics.acknowledged > 0.5 * statistics.commanded > 0
        assert statistics.reports > 0
        assert wait_until(lambda: np.abs(motors.truth.joint_effort).max() == 0.0), "nobody drives the joints any more"


def test_nothing_recovers_by_itself_and_reactivating_does():
    channels = _channels(1)
    settings = EmulationSettings(physics_timestep=0.001)
    with (
        VirtualMotors(LITE, channels, settings=settings) as motors,
        contextlib.closing(_robot(motors, channels)) as robot,
    ):
        robot.activate()
        limp = MITCommand.zeros(N)
        motors.inject(parse_fault("reset:left_elbow_pitch", LITE))
        _drive(robot, limp, 5.0, lambda _: not robot.read()[1][0].is_ok)
        motors.clear_faults()
        _, later = _drive(robot, limp, 0.4)
        assert robot.read()[1][0].flags == SafetyFlag.MOTOR_FAULT
        assert "left run mode (mode reset): left_elbow_pitch" in robot.read()[1][0].message
        assert len(later) == 20, "the motor stays out of run mode until the robot is activated again"
        robot.activate()
        _, bad = _drive(robot, limp, 0.2)
        assert bad == []


def test_the_motors_stop_when_the_host_falls_silent():
    channels = _channels(1)
    settings = EmulationSettings(physics_timestep=0.001)
    with (
        VirtualMotors(LITE, channels, settings=settings) as motors,
        contextlib.closing(_robot(motors, channels, can_timeout=0.2)) as robot,
    ):
        robot.activate()
        hold = _hold(np.array(LITE.initial_position) + 0.2)
        _drive(robot, hold, 5.0, lambda _: np.abs(motors.truth.joint_effort).max() > 1.0)
        assert np.abs(motors.truth.joint_effort).max() > 1.0
        assert wait_until(lambda: np.abs(motors.truth.joint_effort).max() == 0.0, 5.0)
        assert wait_until(lambda: "left run mode (mode reset): all 14 motors" in robot.read()[1][0].message)
        assert robot.read()[1][0].flags & SafetyFlag.MOTOR_FAULT
