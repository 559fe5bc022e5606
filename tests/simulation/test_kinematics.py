import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.simulation.kinematics import ForwardKinematics

RobotFactory = Callable[..., RobotDescription]

GOLDEN = json.loads(Path(__file__).parent.parent.joinpath("data", "lite_arms_golden.json").read_text())["samples"]

ON_A_TILTED_BASE = """
<mujoco>
  <worldbody>
    <body name="base" pos="1 2 3" euler="0 0 90">
      <site name="imu"/>
      <body name="arm">
        <joint name="hinge" axis="0 0 1"/>
        <geom size="0.1"/>
        <body name="tip" pos="0.5 0 0"><geom size="0.1"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def test_golden_hand_positions() -> None:
    kinematics = ForwardKinematics(load_robot("lite"))
    assert kinematics.bodies == ("left_hand", "right_hand")
    positions, rotations = kinematics(np.array([sample["q"][:14] for sample in GOLDEN]))
    assert positions.shape == (20, 2, 3)
    assert rotations.shape == (20, 2, 3, 3)
    for b, hand in enumerate(kinematics.bodies):
        expected = [sample[hand]["pos"] for sample in GOLDEN]
        np.testing.assert_allclose(positions[:, b], expected, rtol=0, atol=1e-9)


def test_single_and_batch_are_the_same_bits() -> None:
    kinematics = ForwardKinematics(load_robot("lite"))
    poses = np.array([sample["q"][:14] for sample in GOLDEN]).reshape(4, 5, 14)
    positions, rotations = kinematics(poses)
    for index in np.ndindex(4, 5):
        position, rotation = kinematics(poses[index])
        assert position.tobytes() == positions[index].tobytes()
        assert rotation.tobytes() == rotations[index].tobytes()


def test_results_do_not_change_afterwards() -> None:
    kinematics = ForwardKinematics(load_robot("lite"))
    position, rotation = kinematics(np.zeros(14))
    kept = position.copy(), rotation.copy()
    kinematics(np.full(14, -0.5))
    assert (position == kept[0]).all()
    assert (rotation == kept[1]).all()


def test_poses_are_in_the_base_frame(small_robot: RobotFactory) -> None:
    kinematics = ForwardKinematics(small_robot(ON_A_TILTED_BASE, ("hinge",)), ("tip", "base"))
    positions, rotations = kinematics(np.array([np.pi / 2]))
    np.testing.assert_allclose(positions, [[0, 0.5, 0], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(rotations[0], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(rotations[1], np.eye(3), atol=1e-12)


def test_an_unknown_body() -> None:
    with pytest.raises(InputError, match=r"^lite: unknown body 'left_paw'; known: chest, left_shoulder_pitch, "):
        ForwardKinematics(load_robot("lite"), ("left_paw",))
