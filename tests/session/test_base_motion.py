from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from humanoid_sim.controllers.context import BASE_LINEAR_VELOCITY
from humanoid_sim.mit import Extern, MITState
from humanoid_sim.session.base_motion import BaseMotion


def state(time: float, *, yaw: float = 0.0, tilt: float = 0.0, velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)):
    turn = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    lean = np.array([math.cos(tilt / 2), 0.0, math.sin(tilt / 2), 0.0])
    quaternion = [turn[0] * lean[0], -turn[3] * lean[2], turn[0] * lean[2], turn[3] * lean[0]]
    return replace(
        MITState.unknown(2, time),
        imu_quaternion=np.array(quaternion),
        imu_angular_velocity=np.array([0.0, 0.0, 0.3]),
        extern={BASE_LINEAR_VELOCITY: Extern(np.array(velocity), time)},
    )


def test_nothing_before_release() -> None:
    assert BaseMotion().summary() is None


def test_speeds_are_in_the_heading_frame_from_two_seconds_on() -> None:
    motion = BaseMotion()
    for k in range(301):
        time = 5.0 + 0.01 * k
        early = time < 7.0 - 1e-9
        motion.update(state(time, yaw=math.pi / 2, velocity=(9.0, 9.0, 0.0) if early else (-0.2, 0.5, 0.0)), 0.78)
    summary = motion.summary()
    assert summary is not None
    assert summary.released == 5.0
    assert summary.duration == pytest.approx(3.0)
    assert summary.velocity == pytest.approx((0.5, 0.2))
    assert summary.yaw_rate == pytest.approx(0.3)
    assert summary.fall is None


def test_height_and_tilt() -> None:
    motion = BaseMotion()
    for time, height, tilt in ((0.0, 0.8, 0.0), (0.1, 0.7, 0.25), (0.2, 0.75, -0.1)):
        motion.update(state(time, tilt=tilt, yaw=1.0), height)
    summary = motion.summary()
    assert summary is not None
    assert summary.height == pytest.approx((0.7, 0.75, 0.8))
    assert summary.tilt_max == pytest.approx(0.25)
    assert math.isnan(summary.velocity[0])


@pytest.mark.parametrize(("height", "tilt"), [(0.39, 0.0), (0.8, 1.06)])
def test_a_fall_ends_the_figures(height: float, tilt: float) -> None:
    motion = BaseMotion()
    motion.update(state(1.0), 0.8)
    motion.update(state(1.5, tilt=tilt), height)
    motion.update(state(2.0, velocity=(7.0, 0.0, 0.0)), 0.1)
    summary = motion.summary()
    assert summary is not None
    assert summary.fall == 0.5
    assert summary.height[0] == height
