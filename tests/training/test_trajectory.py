import numpy as np
import pytest

from humanoid_sim.training.trajectory import derivative, ease, minimum_jerk_path, smooth


def test_ease_rises_from_rest_to_rest():
    phase = np.linspace(0.0, 1.0, 1001)
    rise = ease(phase)
    assert (rise[0], rise[500], rise[-1]) == (0.0, 0.5, 1.0)
    speed = derivative(rise[:, None], 1e-3)[:, 0]
    assert abs(speed[0]) < 1e-4
    assert abs(speed[-1]) < 1e-4
    assert speed.max() == pytest.approx(1.875, abs=1e-4)  # Flash and Hogan 1985
    assert ease(np.array([-3.0, 7.0])).tolist() == [0.0, 1.0]


def test_a_path_passes_its_points_at_their_times():
    times, points = np.array([0.0, 0.5, 0.8, 1.6]), np.array([[0.0, 1.0], [1.0, 0.0], [1.0, 0.0], [-1.0, 3.0]])
    path = minimum_jerk_path(times, points, 0.1)
    assert path.shape == (17, 2)
    np.testing.assert_allclose(path[[0, 5, 8, 16]], points, atol=1e-12)
    np.testing.assert_allclose(path[5:9], points[[1] * 4], atol=1e-12)  # the pause


def test_smoothing_keeps_length_mean_and_constants():
    path = np.zeros((50, 2))
    path[25:] = [1.0, 2.0]
    result = smooth(path, 9)
    assert result.shape == path.shape
    np.testing.assert_allclose(result[:20], 0.0)
    np.testing.assert_allclose(result[30:], path[30:])
    assert np.abs(np.diff(result, axis=0)).max() < 0.5
