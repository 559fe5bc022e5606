"""Gains and poses of a policy's contract in a robot description: all that a user's MJCF does not have."""

from __future__ import annotations

import msgspec
import numpy as np

from humanoid_sim.controllers.action import resolve_action
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.joint_order import joint_indices
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.robots.schema import DampingSettings, RobotDescription, StandbySettings

__all__ = ["with_contract"]


def with_contract(description: RobotDescription, contract: PolicyContract) -> RobotDescription:
    """The description with the contract's gains, standing in the contract's default pose.

    The joints' K_p and K_d, both standby poses and their gains, the initial position, and the K_d of damping and of the
    remote controller's passive hold become the contract's. A default pose beyond a joint's limit is moved to it, as the
    joint's stop would.

    Raises:
        InputError: the contract's joints are not the robot's.
    """
    try:
        gains = resolve_action(contract, description.joint_names)
        order = joint_indices(description.joint_names, contract.joint_names, "joints of the robot")
    except FieldError as error:
        raise InputError(f"{description.name}: {error}") from None
    stiffness, damping = _floats(gains.stiffness), _floats(gains.damping)
    pose = _floats(np.clip(contract.default_joint_pos[order], description.lower, description.upper))
    replace = msgspec.structs.replace

    def standby(settings: StandbySettings) -> StandbySettings:
        return StandbySettings(
            target_stiffness=stiffness,
            target_damping=damping,
            segment_durations=(sum(settings.segment_durations),),
            pose_segments=(pose,),
        )

    return replace(
        description,
        joints=tuple(
            replace(joint, stiffness=stiffness[i], damping=damping[i]) for i, joint in enumerate(description.joints)
        ),
        initial_position=pose,
        damping_controller=DampingSettings(damping=damping),
        standby_controller_a=standby(description.standby_controller_a),
        standby_controller_b=standby(description.standby_controller_b),
        remote_policy_controller=replace(description.remote_policy_controller, damping=damping),
    )


def _floats(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
