"""A network that plays two keys, one a hand: it presses each while the song asks for it. Exactly solvable, so real."""

from pathlib import Path

import numpy as np
from models import contract_of, linear_model, saved

from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.simulation.fingers import Fingers

KEYS = (34, 53)
"""G3 for the left hand, D5 for the right."""
_HOVER = 0.006
"""m of the fingers above the keys."""


def two_key_policy(path: Path, robot: RobotDescription | None = None) -> Path:
    """Write it as a piano policy, and return its path: action = the goals of the two keys, each times a pose."""
    robot = load_robot("lite_piano") if robot is None else robot
    fingers = Fingers(robot)
    above = fingers.ready.copy()
    weights = np.zeros((2 * 88, robot.joint_count), dtype=np.float32)
    for hand, key in enumerate(KEYS):
        arm = fingers.arms[hand]
        raised = fingers.solve(hand, fingers.tip_above(fingers.keys[key], _HOVER))
        pressed = fingers.solve(hand, fingers.tip_above(fingers.keys[key], 0.0, 0.9), raised)
        # The commanded pose is beyond the real one by what holds the arm: gravity, and the key.
        above[arm] = raised + fingers.holding_torque(hand, raised, 0.0) / robot.stiffness[arm]
        down = pressed + fingers.holding_torque(hand, pressed, 2.0) / robot.stiffness[arm]
        weights[key, arm] = down - above[arm]
    contract = contract_of(
        robot.joint_names,
        task_type="piano",
        joint_stiffness=robot.stiffness,
        joint_damping=robot.damping,
        default_joint_pos=above,
        observation=("target_keys", "key_pressed"),
    )
    return saved(path, linear_model(write_metadata(contract), matrix=weights))
