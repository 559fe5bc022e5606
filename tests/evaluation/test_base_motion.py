import math

import numpy as np
import pytest

from humanoid_sim.evaluation.base_motion import BaseMotion
from humanoid_sim.simulation.floating_base import BaseState


def base(height=0.8, *, yaw=0.0, tilt=0.0, velocity=(0.0, 0.0, 0.0)):
    turn = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    lean = np.array([math.cos(tilt / 2), 0.0, math.sin(tilt / 2), 0.0])
    quaternion = [turn[0] * lean[0], -turn[3] * lean[2], turn[0] * lean[2], turn[3] * lean[0]]
    position, rate = np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 0.3])
    return BaseState(position, np.array(quaternion), np.array(velocity), rate, 0.7 * position, np.zeros(()))


def released(time):
    motion = BaseMotion()
    motion.release(time, 0.56)
    return motion


def test_speeds_are_in_the_heading_frame_from_two_seconds_on():
    motion = released(5.0)
    for k in range(301):
        time = 5.0 + 0.01 * k
        early = time < 7.0 - 1e-9
        velocity = (9.0, 9.0, 0.0) if early else (-0.2, 0.5, 0.0)
        motion.update(time, base(0.78, yaw=math.pi / 2, velocity=velocity))
    summary = motion.summary()
    assert summary.released == 5.0
    assert summary.duration == pytest.approx(3.0)
    assert summary.velocity == pytest.approx((0.5, 0.2))
    assert summary.yaw_rate == pytest.approx(0.3)
    assert summary.fall is None


def test_height_and_tilt():
    motion = released(0.0)
    for time, height, tilt in ((0.0, 0.8, 0.0), (0.1, 0.7, 0.6), (1.9, 0.75, 0.5), (2.0, 0.75, -0.1)):
        motion.update(time, base(height, tilt=tilt, yaw=1.0))
    summary = motion.summary()
    assert summary.height == pytest.approx((0.7, 0.75, 0.8))
    assert summary.lowest == pytest.approx(0.7 * 0.7 / 0.56)
    assert summary.tilt_max == pytest.approx(0.1)  # not those of the release


def test_height_counts_from_landing_on():
    motion = released(0.0)
    for time, height in ((0.0, 0.83), (0.05, 0.81), (0.1, 0.79), (0.2, 0.78), (0.3, 0.82), (2.5, 0.8)):
        motion.update(time, base(height))
        if time == 0.05:
            falling = motion.summary()
    summary = motion.summary()
    assert falling.height == pytest.approx((0.81, 0.81, 0.81))  # it has not landed yet: where it is
    assert summary.height == pytest.approx((0.78, 0.7975, 0.82))
    assert summary.lowest == pytest.approx(0.7 * 0.78 / 0.56)


def test_a_run_that_ends_before_it_has_settled_has_no_means():
    motion = released(0.0)
    motion.update(1.9, base(tilt=0.3))
    summary = motion.summary()
    assert (summary.velocity, summary.yaw_rate, summary.tilt_max) == (None, None, None)


@pytest.mark.parametrize(
    ("height", "tilt", "text"),
    [(0.47, 0.0, "fell: its centre of mass sank to 0.33 m, it stood at 0.56 m"), (0.8, 1.01, "fell: tilted by 58°")],
)
def test_a_fall_ends_the_figures(height, tilt, text):
    motion = released(1.0)
    assert motion.update(1.0, base(0.8)) == ""
    assert motion.update(1.5, base(height, tilt=tilt)) == text
    assert motion.update(2.0, base(0.1, velocity=(7.0, 0.0, 0.0))) == ""  # told once
    summary = motion.summary()
    assert (summary.fall, summary.fell) == (0.5, text)
    assert summary.height[0] == height
