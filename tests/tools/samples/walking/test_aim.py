import numpy as np

from tools.samples.walking.aim import _ASKED, NO_AIM, aim_from

RANGES = np.array([[-0.5, 0.8], [-0.4, 0.4], [-0.8, 0.8]])


def test_a_robot_that_answers_too_weakly_is_told_more():
    answer = np.array([[0.8, 0.1], [-0.4, 0.6]])  # of sideways step and turn, together
    response = _ASKED.copy()
    response[:, 0] = np.where(_ASKED[:, 0] > 0.0, 0.8, 0.5) * _ASKED[:, 0]
    response[:, 1:] = _ASKED[:, 1:] @ answer.T
    aim = aim_from(response, RANGES)
    np.testing.assert_allclose([*aim.ahead, aim.back], [0.1875, 0.375, 0.5625, 0.6, 0.8, 2.0])
    asked = np.array([[0.4, 0.1, 0.2], [-0.2, 0.0, -0.1]])
    told = aim.told(asked)
    np.testing.assert_allclose(told[:, 0], [0.5, -0.4])
    np.testing.assert_allclose(told[:, 1:] @ answer.T, asked[:, 1:], atol=1e-12)


def test_a_robot_that_falls_short_of_great_speeds_is_told_more_of_those_but_spares_its_ankles():
    response = _ASKED.copy()
    ahead = _ASKED[:, 0] > 0.3
    response[ahead, 0] = 0.3 + 0.75 * (_ASKED[ahead, 0] - 0.3)
    aim = aim_from(response, RANGES)
    np.testing.assert_allclose([*aim.ahead, aim.back], [0.15, 0.3, 0.5, 0.6, 0.8, 1.0])
    np.testing.assert_allclose(aim.told(np.array([0.6, 0.0, 0.0])), [0.6, 0.0, 0.0])
    np.testing.assert_allclose(aim.told(np.array([0.2, 0.0, 0.0])), [0.2, 0.0, 0.0])


def test_nobody_is_told_more_than_was_trained():
    aim = aim_from(0.1 * _ASKED, RANGES)
    np.testing.assert_allclose(
        [*aim.ahead, aim.back], [0.3, 0.6, 0.6, 0.6, 0.8, 2.0]
    )  # ten times would be asking for trouble
    np.testing.assert_allclose(aim.told(np.array([0.8, -0.3, 0.7])), [0.8, -0.4, 0.8])
    np.testing.assert_allclose(NO_AIM.told(np.array([0.6, -0.3, 0.7])), [0.6, -0.3, 0.7])
