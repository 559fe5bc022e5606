"""How wide the terms of an observation are, without the motion that some of them show."""

from __future__ import annotations

import numpy as np

from humanoid_sim.controllers.context import EXTERN_WIDTHS
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.observation import ObservationLayout, resolve_observation
from humanoid_sim.controllers.reference import MotionReference

__all__ = ["contract_layout"]

_LIVE_KEYS = "key_pressed"


def contract_layout(contract: PolicyContract, observation_width: int | None = None) -> ObservationLayout:
    """The observation in the policy's own joint order, with empty tables in the place of the motion.

    Args:
        contract: of the policy.
        observation_width: N as the model declares it. It tells how many keys a piano policy sees, which no contract
            says; None: one key.

    Raises:
        FieldError: for an unknown term, or one that the contract does not say enough about.
    """
    one = _layout(contract, keys=1)
    if contract.task_type != "piano" or observation_width is None:
        return one
    per_key = _layout(contract, keys=2).width - one.width
    keys, rest = divmod(observation_width - (one.width - per_key), per_key) if per_key else (1, 0)
    return _layout(contract, keys) if keys > 0 and not rest else one


def _layout(contract: PolicyContract, keys: int) -> ObservationLayout:
    joints, bodies = len(contract.joint_names), len(contract.body_names)
    widths = {
        "reference_joint_pos": joints,
        "reference_joint_vel": joints,
        "anchor_pos": 3,
        "anchor_quat": 4,
        "motion_body_pos_b": 3 * bodies,
        "motion_body_ori_b": 6 * bodies,
        "target_keys": keys,
        "target_keys_future": keys * len(contract.lookahead_steps),
    }
    reference = MotionReference(1, {name: np.zeros((1, width), dtype=np.float32) for name, width in widths.items()})
    extern = {**EXTERN_WIDTHS, _LIVE_KEYS: keys}
    return resolve_observation(contract, contract.joint_names, reference, extern)
