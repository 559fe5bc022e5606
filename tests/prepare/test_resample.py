import numpy as np
import pytest

from humanoid_sim.prepare.conventions import NamedMotion
from humanoid_sim.prepare.resample import has_rate, resample


def turning(count: int, fps: float) -> NamedMotion:
    """One joint that rises by 1 rad/s, one body that turns by 1 rad/s about the vertical and moves by 2 m/s."""
    t = np.arange(count) / fps
    turn = np.stack([np.cos(t / 2), 0 * t, 0 * t, np.sin(t / 2)], axis=-1)
    return NamedMotion(
        fps=fps,
        joint_position=t[:, None],
        joint_velocity=np.ones((count, 1)),
        body_names=("hand",),
        body_position=np.stack([2 * t, 0 * t, 0 * t], axis=-1)[:, None],
        body_quaternion=turn[:, None],
        base_position=None,
        base_quaternion=turn,
        is_world=True,
    )


@pytest.mark.parametrize(("count", "fps", "frames"), [(31, 30.0, 51), (121, 120.0, 51), (1, 30.0, 1), (2, 30.0, 2)])
def test_resampling_to_50_hz(count: int, fps: float, frames: int) -> None:
    result = resample(turning(count, fps), 0.02)
    expected = turning(frames, 50.0)
    assert result.fps == 50.0
    assert result.joint_position is not None
    assert result.joint_position.shape == (frames, 1)
    for name in ("joint_position", "joint_velocity", "body_position", "body_quaternion", "base_quaternion"):
        np.testing.assert_allclose(getattr(result, name), getattr(expected, name), atol=1e-9, err_msg=name)
    assert result.base_position is None


def test_it_never_goes_beyond_the_last_frame() -> None:
    result = resample(turning(10, 29.97), 0.02)
    assert result.joint_position is not None
    assert 9 / 29.97 - 0.02 < result.joint_position[-1, 0] <= 9 / 29.97


def test_equal_rates() -> None:
    assert has_rate(50.0, 0.02)
    assert has_rate(50.0, 0.019999999552965164)  # float32 0.02
    assert not has_rate(49.9, 0.02)
    assert not has_rate(30.0, 0.02)
