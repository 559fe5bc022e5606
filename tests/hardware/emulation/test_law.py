"""The MIT law on several motors, and the loops of the other run modes on a simple inertia."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from humanoid_sim.hardware.emulation.law import MitTargets, RunMode, Servo, servo_current, wrapped

_PERIOD = 0.0005


@given(st.floats(-1e3, 1e3), st.sampled_from([12.5, 4 * math.pi]))
def test_wrapping_keeps_the_angle_up_to_whole_ranges(position: float, limit: float) -> None:
    found = wrapped(position, limit)
    assert -limit <= found <= limit
    turns = (position - found) / (2 * limit)
    assert turns == pytest.approx(round(turns), abs=1e-9)


def test_the_mit_law_and_its_limit() -> None:
    targets = MitTargets(np.array([17.0, 4.0]))
    targets.position[:] = 1.0, 1.0
    targets.velocity[:] = 0.5, 0.0
    targets.effort[:] = 0.25, 0.0
    targets.stiffness[:] = 10.0, 50.0
    targets.damping[:] = 2.0, 0.0
    torque = targets.torque(np.array([0.8, -0.5]), np.array([0.1, 3.0]))
    np.testing.assert_allclose(torque, [10.0 * 0.2 + 2.0 * 0.4 + 0.25, 4.0], rtol=1e-12)
    targets.release(0)
    np.testing.assert_array_equal(targets.torque(np.array([0.8, 2.5]), np.zeros(2)), [0.0, -4.0])


def _simulate(servo: Servo, duration: float, inertia: float = 0.05, torque_per_ampere: float = 0.74) -> np.ndarray:
    """Position and velocity over time of an inertia on a motor in one of its own modes."""
    position = velocity = 0.0
    track = []
    for _ in range(round(duration / _PERIOD)):
        velocity += servo_current(servo, position, velocity, _PERIOD) * torque_per_ampere / inertia * _PERIOD
        position += velocity * _PERIOD
        track.append((position, velocity))
    return np.array(track)


def test_current_mode_is_the_current() -> None:
    assert servo_current(Servo(RunMode.CURRENT, current_target=1.5), 3.0, -2.0, _PERIOD) == 1.5


def test_velocity_mode_ramps_to_its_target() -> None:
    track = _simulate(Servo(RunMode.VELOCITY, speed_target=4.0, acceleration=20.0, current_limit=23.0), 1.0)
    assert track[-1, 1] == pytest.approx(4.0, abs=0.05)
    assert track[199, 1] == pytest.approx(2.0, abs=0.3), "after 0.1 s at 20 rad/s²"


def test_cyclic_position_mode_keeps_its_velocity_limit() -> None:
    track = _simulate(Servo(RunMode.CYCLIC_POSITION, position_target=2.0, speed_limit=3.0, current_limit=23.0), 2.0)
    assert track[-1, 0] == pytest.approx(2.0, abs=0.01)
    assert np.abs(track[:, 1]).max() < 3.5


def test_profile_position_mode_arrives_without_running_past() -> None:
    servo = Servo(
        RunMode.PROFILE_POSITION, position_target=2.0, speed_limit=10.0, acceleration=10.0, current_limit=23.0
    )
    track = _simulate(servo, 2.0)
    assert track[-1, 0] == pytest.approx(2.0, abs=0.02)
    assert track[:, 0].max() < 2.1
    assert np.abs(track[:, 1]).max() < math.sqrt(2.0 * 10.0) + 0.5, "it brakes half way"


def test_the_current_limit_holds() -> None:
    servo = Servo(RunMode.CYCLIC_POSITION, position_target=100.0, current_limit=5.0)
    assert servo_current(servo, 0.0, 0.0, _PERIOD) == 5.0
