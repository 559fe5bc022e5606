import json

import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import RobotDescription, load_robot


@pytest.mark.parametrize("name", ["lite", "lite_neck"])
def test_json_round_trip(name):
    robot = load_robot(name)
    text = robot.to_json()
    assert "\n" not in text
    assert "folder" not in json.loads(text)
    again = RobotDescription.from_json(text, folder=robot.folder)
    assert again == robot
    # A recording's description still finds the model of a shipped robot.
    assert RobotDescription.from_json(text).mjcf_path == robot.mjcf_path


@pytest.mark.parametrize("text", ["", "[]", '{"name": "lite"}', '{"name": 3}'])
def test_bad_json_is_an_input_error(text):
    with pytest.raises(InputError, match=r"^robot description \(JSON\): "):
        RobotDescription.from_json(text)


def test_arrays_are_in_joint_order_and_read_only():
    robot = load_robot("lite")
    for name in ("lower", "upper", "effort_limit", "stiffness", "damping"):
        array = getattr(robot, name)
        assert array.shape == (14,)
        assert array.dtype == np.float64
        assert array.tolist() == [getattr(joint, name) for joint in robot.joints]
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_is_immutable():
    with pytest.raises(AttributeError):
        load_robot("lite").name = "other"
