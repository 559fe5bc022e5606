"""A network that plays two keys, one a hand: it presses each while the song asks for it. Exactly solvable, so real."""

from pathlib import Path

import numpy as np
from models import contract_of, linear_model, saved

from humanoid_sim.policy.readers.own import write_metadata
from humanoid_sim.robots.description import load_robot

_KEYS = (34, 53)
"""G3 for the left hand, D5 for the right."""
_ABOVE = (-0.4768, 0.0310, -1.0887, -2.0515, -0.0761, 0.2430, -0.3723)
"""rad, commands that hold the left finger 6 mm above its key; the right arm's are mirrored."""
_DOWN = (-0.4452, -0.0303, -1.1206, -1.9981, -0.0772, 0.2643, -0.3491)
"""rad, commands that press it to 0.9 of its travel."""
_MIRRORED = (1, -1, -1, 1, -1, 1, -1)


def two_key_policy(path: Path) -> Path:
    """Write it as a piano policy, and return its path: action = the goals of the two keys, each times a pose."""
    robot = load_robot("lite_piano")
    above = np.concatenate([_ABOVE, np.multiply(_MIRRORED, _ABOVE)])
    down = np.concatenate([_DOWN, np.multiply(_MIRRORED, _DOWN)])
    weights = np.zeros((2 * 88, robot.joint_count), dtype=np.float32)
    for key, arm in zip(_KEYS, (slice(0, 7), slice(7, 14)), strict=True):
        weights[key, arm] = (down - above)[arm]
    contract = contract_of(
        robot.joint_names,
        task_type="piano",
        joint_stiffness=robot.stiffness,
        joint_damping=robot.damping,
        default_joint_pos=above,
        observation=("target_keys", "key_pressed"),
    )
    return saved(path, linear_model(write_metadata(contract), matrix=weights))
