"""Values of observation terms and their bounds, from state, last action, motion, clock and live inputs.

`term_kinds` says which of these functions belong to which kind of term. They take `(..., n)`, one robot or a batch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.rotation import conjugate, gravity_direction, matrix, multiply, rotate, rotate_inverse
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import (
    ANCHOR_POSE,
    EXTERN_WIDTHS,
    HEIGHT_SCAN,
    VELOCITY_COMMAND,
    Extern,
    Float32Array,
    FloatArray,
    IndexArray,
    MITState,
)

if TYPE_CHECKING:  # contracts hold terms, whose kinds are made of the functions below
    from humanoid_sim.controllers.contract import PolicyContract
    from humanoid_sim.controllers.reference import Alignment, Frame, MotionReference
    from humanoid_sim.controllers.term_kinds import TermKind
    from humanoid_sim.controllers.terms import Term

__all__ = ["Bounds", "Limits", "ObservationContext", "Request", "Resolve", "Source", "live_command"]

_BEYOND_STOP = 0.5
"""rad by which a joint may be pressed into its stop."""
_ANY_POSITION = 100.0
"""rad, of a joint without limits."""


@dataclass(frozen=True, slots=True, eq=False)
class ObservationContext:
    """Everything that a term may read."""

    state: MITState
    last_action: Float32Array
    """Shape (..., m), raw."""
    reference: MotionReference
    frame: Frame
    """Shape (...)."""
    alignment: Alignment | None = None
    """Alignment of the reference with the robot, made at activation."""
    phase: FloatArray = field(default_factory=lambda: np.empty(0))
    """Shape (..., k), rad."""


@dataclass(frozen=True, slots=True)
class Request:
    """A term, and the sources from which it can be made."""

    term: Term
    kind: TermKind
    """Kind that the term has under the contract."""
    contract: PolicyContract
    robot_joints: tuple[str, ...]
    reference: MotionReference
    extern: Mapping[str, int]
    """Name and width of the live inputs that exist."""

    def missing(self, what: str) -> FieldError:
        """Return the refusal of a term whose source does not exist."""
        return FieldError(f"observation term '{self.term.name}' needs {what}, and there is none")


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """Bounds of a robot's states and its policy's actions."""

    lower: FloatArray
    """Shape (n,), rad, the robot's joint order; -inf where there is none."""
    upper: FloatArray
    """Shape (n,), likewise."""
    action: float
    """Largest magnitude of a raw action."""


Source = Callable[[ObservationContext], Any]
"""A term's value, shape (..., width), before clip and scale."""
Resolve = Callable[[Request], tuple[int, Source]]
"""Width and value of a term. Raises a FieldError if what it needs is not there."""
Bounds = Callable[[Request, Limits], tuple[npt.ArrayLike, npt.ArrayLike]]
"""Least and greatest values of a term on any robot, shape (width,) or scalar, before clip and scale."""


# --- joints and last action ---


def joint_position(request: Request) -> tuple[int, Source]:
    """Shape (..., k), rad, less the default pose unless the term says otherwise."""
    order = _joint_order(request)
    if not request.kind.is_relative(request.term):
        return len(order), lambda context: context.state.joint_position[..., order]
    default = _default_pose(request)
    return len(order), lambda context: context.state.joint_position[..., order] - default


def joint_position_bounds(request: Request, limits: Limits) -> tuple[FloatArray, FloatArray]:
    """Return a little beyond the robot's stops."""
    order = _joint_order(request)
    low, high = limits.lower[order] - _BEYOND_STOP, limits.upper[order] + _BEYOND_STOP
    zero = _default_pose(request) if request.kind.is_relative(request.term) else 0.0
    return (
        np.where(np.isfinite(low), low, -_ANY_POSITION) - zero,
        np.where(np.isfinite(high), high, _ANY_POSITION) - zero,
    )


def joint_velocity(request: Request) -> tuple[int, Source]:
    """Shape (..., k), rad/s."""
    order = _joint_order(request)
    return len(order), lambda context: context.state.joint_velocity[..., order]


def joint_names(term: Term, contract: PolicyContract) -> tuple[str, ...]:
    """Return the names of the joints that a term shows, in its order."""
    return contract.joint_names if term.joints is None else term.joints


def _joint_order(request: Request) -> IndexArray:
    names = joint_names(request.term, request.contract)
    return joint_indices(names, request.robot_joints, "joint_names of the policy")


def _default_pose(request: Request) -> FloatArray:
    contract, names = request.contract, joint_names(request.term, request.contract)
    order = joint_indices(names, contract.joint_names, "joint_names of the policy")
    pose: FloatArray = contract.default_joint_pos[order]
    return pose


def last_action(request: Request) -> tuple[int, Source]:
    """Shape (..., m), as the network answered, or times the action scale."""
    contract = request.contract
    count, clip = contract.action_count, contract.action_clip
    factor = 1.0 if request.term.form == "raw" else contract.action_scale
    if np.isinf(clip):
        return count, lambda context: context.last_action * factor
    # Trainers that clip actions keep, and show, the clipped ones.
    return count, lambda context: np.clip(context.last_action, -clip, clip) * factor


def action_bounds(request: Request, limits: Limits) -> tuple[npt.ArrayLike, npt.ArrayLike]:
    """Return the limit of a raw action, or the contract's clip."""
    magnitude: npt.ArrayLike = min(limits.action, request.contract.action_clip)
    if request.term.form == "scaled":
        magnitude = magnitude * np.abs(request.contract.action_scale)
    return np.negative(magnitude), magnitude


# --- IMU and base ---


def angular_velocity(request: Request) -> tuple[int, Source]:
    """Shape (..., 3), rad/s."""
    if request.term.frame == "body":
        return 3, lambda context: context.state.imu_angular_velocity
    return 3, lambda context: rotate(context.state.imu_quaternion, context.state.imu_angular_velocity)


def imu_quaternion(request: Request) -> tuple[int, Source]:
    """Shape (..., 4)."""
    if request.term.quaternion == "wxyz":
        return 4, lambda context: context.state.imu_quaternion
    return 4, lambda context: context.state.imu_quaternion[..., [1, 2, 3, 0]]


def acceleration(_: Request) -> tuple[int, Source]:
    """Shape (..., 3), m/s², body frame."""
    return 3, lambda context: context.state.imu_linear_acceleration


def gravity(_: Request) -> tuple[int, Source]:
    """Shape (..., 3), body frame."""
    return 3, lambda context: gravity_direction(context.state.imu_quaternion)


def linear_velocity(request: Request) -> tuple[int, Source]:
    """Shape (..., 3), m/s, of the base's origin, or of another point of the robot; the body frame is the IMU's."""
    name = request.kind.input(request.term)
    if request.term.frame == "world":
        return 3, lambda context: _nan_when_stale(context.state, name, 3)

    def in_body(context: ObservationContext) -> FloatArray:
        return rotate_inverse(context.state.imu_quaternion, _nan_when_stale(context.state, name, 3))

    return 3, in_body


# --- live inputs and the clock ---


def live(request: Request) -> tuple[int, Source]:
    """Return a live input as it is, zero when it is missing or too old."""
    name = request.kind.name
    width = request.extern[name]
    zeros = np.zeros(width)

    def source(context: ObservationContext) -> FloatArray:
        heard = _live_input(context.state, name, width)
        # Never heard counts like too old: nothing pressed, no velocity asked for.
        return zeros if heard is None else heard.at(context.state.time)

    return width, source


def declared(request: Request) -> tuple[int, Source]:
    """Return a live input of the width that its term declares; not a number where it is missing or too old."""
    width = request.extern[request.kind.name]
    if width != request.term.width:
        raise FieldError(f"observation term '{request.term.name}': width is {request.term.width}, expected {width}")
    return heard(request)


def heard(request: Request) -> tuple[int, Source]:
    """Return a live input as it is; not a number where it is missing or too old."""
    name, width = request.kind.name, request.extern[request.kind.name]
    return width, lambda context: _nan_when_stale(context.state, name, width)


def height_scan(request: Request) -> tuple[int, Source]:
    """Shape (..., rays), m; not a number where it is missing or too old."""
    known, count = request.extern.get(HEIGHT_SCAN), request.term.height_scan.count
    if known is None:
        raise request.missing("a height scan: a simulation makes it, on a robot a program has to send it")
    if known != count:
        raise FieldError(f"observation term '{request.term.name}': has {count} rays, but the robot's scan has {known}")
    return heard(request)


def height_scan_bounds(request: Request, _: Limits) -> tuple[float, float]:
    """Return the least and greatest value of a scan, m."""
    return request.term.height_scan.bounds


def live_command(state: MITState, contract: PolicyContract) -> FloatArray:
    """Return the velocity command within the contract's ranges, shape (3,): zero if there is none, or it is too old."""
    heard = _live_input(state, VELOCITY_COMMAND, 3)
    command = np.zeros(3) if heard is None else heard.at(state.time)
    ranges = contract.command_ranges
    return command if ranges is None else np.clip(command, ranges[:, 0], ranges[:, 1])


def velocity_command(part: slice) -> Resolve:
    """Return some of vx, vy in m/s and the yaw rate in rad/s."""

    def resolve(request: Request) -> tuple[int, Source]:
        contract = request.contract
        return part.stop - part.start, lambda context: live_command(context.state, contract)[..., part]

    return resolve


def phase(*functions: Callable[[FloatArray], FloatArray]) -> Resolve:
    """Functions of the phase of each foot, one after the other; 0 where there is no phase."""

    def resolve(request: Request) -> tuple[int, Source]:
        if request.contract.phase is None:
            raise request.missing("the contract's phase rule")

        def source(context: ObservationContext) -> FloatArray:
            values = [function(context.phase) for function in functions]
            value = np.concatenate(values, axis=-1) if len(values) > 1 else values[0]
            return np.where(np.isnan(value), 0.0, value)

        return len(functions) * len(request.contract.phase.offsets), source

    return resolve


def _live_input(state: MITState, name: str, width: int) -> Extern | None:
    """Return the live input, its shape checked: assigned unchecked, one value would fill every slot."""
    heard = state.extern.get(name)
    if heard is not None and heard.value.shape not in ((width,), (*state.joint_position.shape[:-1], width)):
        raise FieldError(f"MITState.extern['{name}']: has shape {heard.value.shape}, expected ({width},)")
    return heard


def _nan_when_stale(state: MITState, name: str, width: int) -> FloatArray:
    """Get an estimate that is missing or too old: not a number, so that the policy stops instead of believing zeros."""
    heard = _live_input(state, name, width)
    if heard is None:
        return np.full(width, np.nan)
    return np.where(heard.is_fresh(state.time)[..., None], heard.value, np.nan)


# --- the motion ---


def motion_command(request: Request) -> tuple[int, Source]:
    """Shape (..., 2 n), the reference's joint positions and velocities, rad and rad/s."""
    if "reference_joint_pos" not in request.reference.terms:
        raise request.missing("a motion with joint positions and velocities")
    n = len(request.contract.joint_names)
    offset = request.contract.default_joint_pos if request.kind.is_relative(request.term) else np.zeros(n)

    def source(context: ObservationContext) -> FloatArray:
        position = context.reference.term("reference_joint_pos", context.frame) - offset
        velocity = context.reference.term("reference_joint_vel", context.frame)
        return np.concatenate([position, velocity], axis=-1)

    return 2 * n, source


def motion_command_bounds(request: Request, _: Limits) -> tuple[float, float]:
    """Return what the motion holds, and the default pose."""
    tables = [request.reference.terms[name] for name in ("reference_joint_pos", "reference_joint_vel")]
    largest = max(float(np.abs(table).max()) for table in tables)
    magnitude = largest + float(np.abs(request.contract.default_joint_pos).max())
    return -magnitude, magnitude


def anchor_position(request: Request) -> tuple[int, Source]:
    """Shape (..., 3), m, of the reference's anchor body from the robot's."""
    if "anchor_pos" not in request.reference.terms:
        raise request.missing("a motion with the poses of the anchor body")
    in_world = request.term.frame == "world"

    def source(context: ObservationContext) -> FloatArray:
        pose = _nan_when_stale(context.state, ANCHOR_POSE, EXTERN_WIDTHS[ANCHOR_POSE])
        target, _ = context.reference.anchor(context.frame, context.alignment)
        offset = target - pose[..., :3]
        return offset if in_world else rotate_inverse(pose[..., 3:], offset)

    return 3, source


def anchor_orientation(request: Request) -> tuple[int, Source]:
    """Shape (..., 6), two columns or rows of the matrix of the anchor body's orientation as seen from the robot's."""
    if "anchor_pos" not in request.reference.terms:
        raise request.missing("a motion with the poses of the anchor body")
    term = request.term

    def source(context: ObservationContext) -> FloatArray:
        pose = _nan_when_stale(context.state, ANCHOR_POSE, EXTERN_WIDTHS[ANCHOR_POSE])
        _, target = context.reference.anchor(context.frame, context.alignment)
        relative = multiply(conjugate(pose[..., 3:]), target)
        rotation = matrix(conjugate(relative) if term.inverse else relative)
        if term.layout == "two_rows":
            return rotation[..., :2, :].reshape(*rotation.shape[:-2], 6)
        columns = rotation[..., :, :2]
        if term.layout == "columns":
            columns = np.swapaxes(columns, -1, -2)
        return columns.reshape(*rotation.shape[:-2], 6)

    return 6, source


def referenced(request: Request) -> tuple[int, Source]:
    """Return the table of the reference that has the kind's name, as it stands."""
    name = request.kind.name
    if name not in request.reference.terms:
        raise request.missing(f"a {request.kind.task} motion")
    return request.reference.terms[name].shape[1], lambda context: context.reference.term(name, context.frame)


def referenced_bounds(request: Request, _: Limits) -> tuple[float, float]:
    """Return what the table holds, and at least 1."""
    magnitude = max(1.0, float(np.abs(request.reference.terms[request.kind.name]).max()))
    return -magnitude, magnitude


def progress(request: Request) -> tuple[int, Source]:
    """Shape (..., 1), frame over last frame."""
    if not request.reference.terms:
        raise request.missing("a motion")
    return 1, lambda context: np.asarray(context.reference.progress(context.frame))[..., None]
