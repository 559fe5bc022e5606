import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.fingers import HOVER, Fingers


@pytest.fixture(scope="module")
def fingers():
    return Fingers(load_robot("lite_piano"))


def test_strike_points_are_on_the_keys_in_front_of_the_robot(fingers):
    # The piano stands 0.4 m in front, turned round, its white keys 0.08 m high: A0 is on the left, 0.5865 m away.
    assert fingers.strike_point(fingers.keys[0]) == pytest.approx([0.4 - 0.138, 0.5865, 0.08])
    assert fingers.strike_point(fingers.keys[1]) == pytest.approx([0.4 - 0.08, 0.575, 0.0925])
    down = fingers.strike_point(fingers.keys[0]) - fingers.strike_point(fingers.keys[0], 1.0)
    assert down == pytest.approx([0.0, 0.0, 0.012 * 0.178 / 0.19], abs=1e-9)


@pytest.mark.parametrize(("hand", "key"), [(0, 10), (0, 31), (0, 50), (1, 40), (1, 57), (1, 80)])
def test_a_pose_brings_the_tip_over_the_key_and_nothing_touches(fingers, hand, key):
    target = fingers.tip_above(fingers.keys[key], HOVER)
    pose = fingers.solve(hand, target)
    place, direction = fingers.place(hand, pose)
    assert place == pytest.approx(target, abs=5e-4)
    assert direction[2] < -0.4
    assert fingers.strike(hand, fingers.keys[key]) is not None


@pytest.mark.parametrize(("hand", "key"), [(0, 0), (0, 87), (0, 65), (1, 0), (1, 25), (1, 87)])
def test_keys_beyond_an_arm_are_out_of_reach(fingers, hand, key):
    assert fingers.strike(hand, fingers.keys[key]) is None
    with pytest.raises(InputError, match=r"^lite: has no piano, expected a robot with one, such as lite_piano"):
        Fingers(load_robot("lite"))


def test_what_an_arm_touches_is_named(fingers):
    key = fingers.keys[30]
    pose = fingers.solve(0, fingers.tip_above(key, -0.003))
    assert fingers.touched(0, pose, key) == []  # its own key
    assert fingers.touched(0, pose, fingers.keys[40]) == ["left_hand and black_key_30"]


def test_holding_torque_is_gravity_and_the_key_s_force(fingers):
    pose = fingers.solve(1, fingers.tip_above(fingers.keys[57], 0.0))
    free = fingers.holding_torque(1, pose, 0.0)
    pressing = fingers.holding_torque(1, pose, 2.0)
    step = 1e-6
    lowered = [
        (fingers.place(1, pose + step * np.eye(7)[i])[0][2] - fingers.place(1, pose)[0][2]) / step for i in range(7)
    ]
    assert free - pressing == pytest.approx(2.0 * np.array(lowered), abs=1e-4)
