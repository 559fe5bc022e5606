"""Where each kind of observation term comes from: state, last action, motion reference, clock, live inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from humanoid_sim.controllers import motion_sources
from humanoid_sim.controllers.context import ObservationContext, Request, Source, live_input, zero_when_stale
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.controllers.rotation import gravity_direction, rotate
from humanoid_sim.controllers.terms import TERM_KINDS, Term
from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.mit import VELOCITY_COMMAND, FloatArray, MITState

__all__ = ["live_command", "resolve_source", "takes_velocity_command"]

_VELOCITY_KINDS = frozenset({"velocity_command", "command_lin_vel", "command_ang_vel"})


def resolve_source(
    term: Term,
    contract: PolicyContract,
    robot_joints: tuple[str, ...],
    reference: MotionReference,
    extern: Mapping[str, int],
) -> tuple[int, Source]:
    """Width and value of a term, before clip and scale.

    Raises:
        FieldError: if what the term needs is not there.
    """
    kind = _command_kind(term, contract) if term.kind == "command" else term.kind
    request = Request(kind, term, contract, robot_joints, reference, extern)
    if kind in _RESOLVERS:
        return _RESOLVERS[kind](request)
    if kind == "key_pressed" and kind not in extern:
        raise request.missing("a source of live key states")
    if kind in extern:
        return extern[kind], zero_when_stale(kind, extern[kind])
    raise FieldError(known_names("observation term", term.name, sorted({*TERM_KINDS, *extern})))


def takes_velocity_command(contract: PolicyContract) -> bool:
    """Whether what the policy observes depends on the velocity command: as a term, or through the gait clock."""
    kinds = {_command_kind(term, contract) if term.kind == "command" else term.kind for term in contract.terms}
    return bool(kinds & _VELOCITY_KINDS) or contract.phase is not None


def live_command(state: MITState, contract: PolicyContract) -> FloatArray:
    """The velocity command within the contract's ranges, shape (3,): zero if there is none, or it is too old."""
    live = live_input(state, VELOCITY_COMMAND, 3)
    command = np.zeros(3) if live is None else live.at(state.time)
    ranges = contract.command_ranges
    return command if ranges is None else np.clip(command, ranges[:, 0], ranges[:, 1])


def _command_kind(term: Term, contract: PolicyContract) -> str:
    if "motion" in contract.command_names:
        return "motion_command"
    if contract.command_names:
        return "velocity_command"
    raise FieldError(f"observation term '{term.name}': the contract has no command_names, expected what it stands for")


def _acceleration(context: ObservationContext) -> FloatArray:
    return context.state.imu_linear_acceleration


def _gravity(context: ObservationContext) -> FloatArray:
    return gravity_direction(context.state.imu_quaternion)


def _last_action(request: Request) -> tuple[int, Source]:
    contract = request.contract
    count, scale, clip = contract.action_count, contract.action_scale, contract.action_clip
    factor = 1.0 if request.term.form == "raw" else scale
    if np.isinf(clip):
        return count, lambda context: context.last_action * factor
    # Trainers that clip actions keep, and show, the clipped ones.
    return count, lambda context: np.clip(context.last_action, -clip, clip) * factor


def _joints(request: Request) -> tuple[int, Source]:
    contract = request.contract
    names = contract.joint_names if request.term.joints is None else request.term.joints
    order = joint_indices(names, request.robot_joints, "joint_names of the policy")
    if request.kind == "joint_vel":
        return len(order), lambda context: context.state.joint_velocity[..., order]
    if request.term.relative is False:
        return len(order), lambda context: context.state.joint_position[..., order]
    default = contract.default_joint_pos[joint_indices(names, contract.joint_names, "joint_names of the policy")]
    return len(order), lambda context: context.state.joint_position[..., order] - default


def _velocity(request: Request) -> tuple[int, Source]:
    part = {"velocity_command": slice(0, 3), "command_lin_vel": slice(0, 2), "command_ang_vel": slice(2, 3)}[
        request.kind
    ]
    contract = request.contract
    return part.stop - part.start, lambda context: live_command(context.state, contract)[..., part]


def _phase(request: Request) -> tuple[int, Source]:
    if request.contract.phase is None:
        raise request.missing("the contract's phase rule")
    feet = len(request.contract.phase.offsets)
    if request.kind == "sin_phase":
        return feet, lambda context: _of_phase(np.sin, context)
    if request.kind == "cos_phase":
        return feet, lambda context: _of_phase(np.cos, context)
    return 2 * feet, lambda context: np.concatenate([_of_phase(np.sin, context), _of_phase(np.cos, context)], axis=-1)


def _of_phase(function: Callable[[FloatArray], FloatArray], context: ObservationContext) -> FloatArray:
    """Sine or cosine; 0 where there is no phase."""
    value = function(context.phase)
    return np.where(np.isnan(value), 0.0, value)


def _angular_velocity(request: Request) -> tuple[int, Source]:
    if request.term.frame == "body":
        return 3, lambda context: context.state.imu_angular_velocity
    return 3, lambda context: rotate(context.state.imu_quaternion, context.state.imu_angular_velocity)


def _imu_quaternion(request: Request) -> tuple[int, Source]:
    if request.term.quaternion == "wxyz":
        return 4, lambda context: context.state.imu_quaternion
    return 4, lambda context: context.state.imu_quaternion[..., [1, 2, 3, 0]]


_RESOLVERS: Mapping[str, Callable[[Request], tuple[int, Source]]] = MappingProxyType(
    {
        "joint_pos": _joints,
        "joint_vel": _joints,
        "actions": _last_action,
        "base_ang_vel": _angular_velocity,
        "imu_quaternion": _imu_quaternion,
        "imu_linear_acceleration": lambda _: (3, _acceleration),
        "projected_gravity": lambda _: (3, _gravity),
        "base_lin_vel": motion_sources.linear_velocity,
        "velocity_command": _velocity,
        "command_lin_vel": _velocity,
        "command_ang_vel": _velocity,
        "motion_command": motion_sources.motion_command,
        "motion_anchor_pos": motion_sources.anchor,
        "motion_anchor_ori": motion_sources.anchor,
        "sin_phase": _phase,
        "cos_phase": _phase,
        "gait_phase": _phase,
        "motion_body_pos_b": motion_sources.referenced,
        "motion_body_ori_b": motion_sources.referenced,
        "target_keys": motion_sources.referenced,
        "target_keys_future": motion_sources.referenced,
        "progress": motion_sources.progress,
    }
)
