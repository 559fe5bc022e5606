"""The one table of observation terms: the meaning, width and value of each. A new term is one row here.

Exporters give the same quantity different names, and `command` stands for the contract's command. Functions take
`(..., n)`, one robot or a batch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from humanoid_sim.controllers.rotation import conjugate, gravity_direction, matrix, multiply, rotate, rotate_inverse
from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.mit import (
    ANCHOR_ORIENTATION,
    ANCHOR_POSE,
    BASE_LINEAR_VELOCITY,
    EXTERN_WIDTHS,
    HEIGHT_SCAN,
    KEY_PRESSED,
    VELOCITY_COMMAND,
    Extern,
    Float32Array,
    FloatArray,
    IndexArray,
    MITState,
    point_velocity,
)

if TYPE_CHECKING:  # contracts hold terms, and terms are named by this table
    from humanoid_sim.controllers.contract import PolicyContract, Term
    from humanoid_sim.controllers.reference import Alignment, Frame, MotionReference

Convention = Literal["frame", "at", "relative", "layout", "inverse", "quaternion", "form", "sign"]
_COMMAND = "command"


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


@dataclass(frozen=True, slots=True, eq=False)
class BoundTerm:
    """A term on a robot, everything looked up once."""

    term: Term
    kind: TermKind
    contract: PolicyContract
    reference: MotionReference
    extern: Mapping[str, int]
    """Name and width of the live inputs that exist."""
    order: IndexArray
    """The joints that the term shows, as places among the robot's."""
    zero: FloatArray | float
    """rad, of these joints: subtracted from positions."""
    start: int
    """Place of the first value within one step's values."""
    stop: int
    is_plain: bool
    """Neither clipped nor scaled: most terms are, and a multiplication by 1 in every tick is not free."""

    @property
    def name(self) -> str:
        """As the exporter calls it."""
        return self.term.name

    @property
    def width(self) -> int:
        """Number of values that the policy sees, all steps of its history together."""
        return (self.stop - self.start) * self.term.history


Width = Callable[["BoundTerm"], int]
Value = Callable[["BoundTerm", ObservationContext], Any]
"""Shape (..., width), before clip and scale."""


# --- values: joints and last action ---


def _joint_position(bound: BoundTerm, context: ObservationContext) -> FloatArray:
    return context.state.joint_position[..., bound.order] - bound.zero


def _joint_velocity(bound: BoundTerm, context: ObservationContext) -> FloatArray:
    return context.state.joint_velocity[..., bound.order]


def _last_action(bound: BoundTerm, context: ObservationContext) -> Any:
    action, clip = context.last_action, bound.contract.action_clip
    if clip < np.inf:  # trainers that clip actions keep, and show, the clipped ones
        action = np.clip(action, -clip, clip)
    return action * bound.contract.action_scale if bound.term.form == "scaled" else action


# --- values: IMU and base ---


def _angular_velocity(bound: BoundTerm, context: ObservationContext) -> FloatArray:
    velocity = context.state.imu_angular_velocity
    return velocity if bound.term.frame == "body" else rotate(context.state.imu_quaternion, velocity)


def _acceleration(_bound: BoundTerm, context: ObservationContext) -> FloatArray:
    return context.state.imu_linear_acceleration


def _gravity(_bound: BoundTerm, context: ObservationContext) -> FloatArray:
    return gravity_direction(context.state.imu_quaternion)


def _quaternion(bound: BoundTerm, context: ObservationContext) -> FloatArray:
    quaternion = context.state.imu_quaternion
    return quaternion if bound.term.quaternion == "wxyz" else quaternion[..., [1, 2, 3, 0]]


def _linear_velocity(bound: BoundTerm, context: ObservationContext) -> FloatArray:
    velocity = _live_or_nan(context.state, bound.kind.input(bound.term), 3)
    return velocity if bound.term.frame == "world" else rotate_inverse(context.state.imu_quaternion, velocity)


# --- values: command, live inputs, clock ---


def live_command(state: MITState, contract: PolicyContract) -> FloatArray:
    """Return the velocity command within the contract's ranges, shape (3,): zero if there is none, or it is too old."""
    live = _live_input(state, VELOCITY_COMMAND, 3)
    command = np.zeros(3) if live is None else live.at(state.time)
    ranges = contract.command_ranges
    return command if ranges is None else np.clip(command, ranges[:, 0], ranges[:, 1])


def _command(part: slice) -> Value:
    return lambda bound, context: live_command(context.state, bound.contract)[..., part]


def _phase(*functions: Callable[[FloatArray], FloatArray]) -> Value:
    """Return functions of the phase of each foot, one after the other; 0 without a phase."""

    def value(_bound: BoundTerm, context: ObservationContext) -> FloatArray:
        values = np.concatenate([function(context.phase) for function in functions], axis=-1)
        return np.where(np.isnan(values), 0.0, values)

    return value


def _extern(bound: BoundTerm, context: ObservationContext) -> FloatArray:
    """Return what a robot reports beside its state, as it is; zeros while it is missing or too old."""
    width = bound.stop - bound.start
    live = _live_input(context.state, bound.kind.reads, width)
    return np.zeros(width) if live is None else live.at(context.state.time)


def _live(bound: BoundTerm, context: ObservationContext) -> FloatArray:
    return _live_or_nan(context.state, bound.kind.reads, bound.stop - bound.start)


def _live_input(state: MITState, name: str, width: int) -> Extern | None:
    """Return a live input, its shape checked: assigned unchecked, one value would fill every slot."""
    live = state.extern.get(name)
    if live is not None and live.value.shape not in ((width,), (*state.joint_position.shape[:-1], width)):
        raise FieldError(f"MITState.extern['{name}']: has shape {live.value.shape}, expected ({width},)")
    return live


def _live_or_nan(state: MITState, name: str, width: int) -> FloatArray:
    """Return a live input; NaN where it is missing or too old, so that the policy stops instead of believing zeros."""
    live = _live_input(state, name, width)
    if live is None:
        return np.full(width, np.nan)
    return np.where(live.is_fresh(state.time)[..., None], live.value, np.nan)


# --- values: the motion ---


def _motion_command(bound: BoundTerm, context: ObservationContext) -> FloatArray:
    position: Any = context.reference.term("reference_joint_pos", context.frame)
    if bound.kind.is_relative(bound.term):
        position = position - bound.contract.default_joint_pos
    return np.concatenate([position, context.reference.term("reference_joint_vel", context.frame)], axis=-1)


def anchor_quaternion(state: MITState) -> FloatArray:
    """Return the anchor body's orientation, shape (..., 4), w x y z: of its pose, or else by itself; NaN without."""
    if ANCHOR_POSE in state.extern:
        return _live_or_nan(state, ANCHOR_POSE, EXTERN_WIDTHS[ANCHOR_POSE])[..., 3:]
    return _live_or_nan(state, ANCHOR_ORIENTATION, 4)


def _anchor_position(bound: BoundTerm, context: ObservationContext) -> FloatArray:
    pose = _live_or_nan(context.state, ANCHOR_POSE, EXTERN_WIDTHS[ANCHOR_POSE])
    offset = context.reference.anchor(context.frame, context.alignment)[0] - pose[..., :3]
    return offset if bound.term.frame == "world" else rotate_inverse(pose[..., 3:], offset)


def _anchor_orientation(bound: BoundTerm, context: ObservationContext) -> FloatArray:
    target = context.reference.anchor(context.frame, context.alignment)[1]
    relative = multiply(conjugate(anchor_quaternion(context.state)), target)
    rotation = matrix(conjugate(relative) if bound.term.inverse else relative)
    if bound.term.layout == "two_rows":
        return rotation[..., :2, :].reshape(*rotation.shape[:-2], 6)
    columns = rotation[..., :, :2]
    if bound.term.layout == "columns":
        columns = np.swapaxes(columns, -1, -2)
    return columns.reshape(*rotation.shape[:-2], 6)


def _referenced(bound: BoundTerm, context: ObservationContext) -> Any:
    return context.reference.term(bound.kind.name, context.frame)


def _progress(_bound: BoundTerm, context: ObservationContext) -> FloatArray:
    return np.asarray(context.reference.progress(context.frame))[..., None]


# --- widths ---


def _per_joint(bound: BoundTerm) -> int:
    return len(bound.order)


def _per_action(bound: BoundTerm) -> int:
    return bound.contract.action_count


def _feet(times: int) -> Width:
    def width(bound: BoundTerm) -> int:
        if bound.contract.phase is None:
            raise _needs(bound.term, "the contract's phase rule")
        return times * len(bound.contract.phase.offsets)

    return width


def _of_table(bound: BoundTerm) -> int:
    return int(bound.reference.terms[bound.kind.name].shape[1])


def _of_live(bound: BoundTerm) -> int:
    """Return the width that the live input has, which must be the one that a declaration or a scan says."""
    name, term = bound.kind.reads, bound.term
    expected = term.width if term.scan is None else term.scan.count
    if name not in bound.extern:
        if expected is None and not bound.kind.topic:
            unknown = known_names("observation term", term.name, sorted({*TERM_NAMES, *bound.extern}))
            raise FieldError(f"{unknown}; a width declares a live input: {{name: {term.name}, width: 2}}")
        raise _needs(term, f"the live input '{name}'; a program sends it, or `live` from Python feeds it")
    if expected not in (None, bound.extern[name]):
        raise FieldError(f"observation term '{term.name}': is {expected} wide, but the input has {bound.extern[name]}")
    return bound.extern[name]


def _needs(term: Term, what: str) -> FieldError:
    return FieldError(f"observation term '{term.name}' needs {what}, and there is none")


# --- the table ---


@dataclass(frozen=True, slots=True)
class TermKind:
    """Description of a kind of observation term, whatever the term is called."""

    name: str
    meaning: str
    """Meaning in words, with its unit."""
    width: int | Width
    """Number of values of one step. Raises `FieldError` where what it needs is not there."""
    value: Value
    _: KW_ONLY
    names: tuple[str, ...] = ()
    """Names that exporters use for it; empty: its own name."""
    reads: str = ""
    """The field of `MITState`, or the live input, that it is made of; empty: the policy's own memory, or its motion."""
    estimate: str = ""
    """Part of it that a simulation knows and a robot has to estimate."""
    tables: tuple[str, ...] = ()
    """Tables of the motion that it needs."""
    conventions: tuple[Convention, ...] = ()
    """Conventions that may be mistaken: options of `Term`, or its `sign`."""
    relative: bool = False
    """True if positions are relative to the default pose unless the term says otherwise."""
    requires: str = ""
    """Field of the contract without which it means nothing."""
    scales: tuple[float, ...] = (1.0,)
    """Scales seen in published policies."""
    topic: str = ""
    """Topic on which other programs publish it, where the term names none; empty: none does."""

    @property
    def task(self) -> Literal["", "tracking", "piano"]:
        """The task that a policy with such a term has; empty: any."""
        if self.name.startswith("target_keys"):
            return "piano"
        return "tracking" if self.tables else ""

    def is_relative(self, term: Term) -> bool:
        """Return whether the positions of such a term are less the default pose."""
        return self.relative if term.relative is None else term.relative

    def input(self, term: Term) -> str:
        """Return the field of `MITState`, or the live input, that such a term is made of; empty as in `reads`."""
        return point_velocity(term.at) if "at" in self.conventions else self.reads

    def check_sources(self, bound: BoundTerm) -> None:
        """Raise `FieldError` if what a term is made of is not there."""
        term = bound.term
        if term.kind == _COMMAND and not bound.contract.command_names:
            raise FieldError(f"observation term '{term.name}': means a command, and command_names is empty")
        inputs = (self.input(term), ANCHOR_ORIENTATION if self.name == "motion_anchor_ori" else "")
        if self.estimate and not any(name in bound.extern for name in inputs):
            raise _needs(term, f"{self.estimate}: a simulation knows it, a robot needs an estimator for it")
        lacking = [table for table in self.tables if table not in bound.reference.terms]
        if lacking or (self.name == "progress" and not bound.reference.terms):
            raise _needs(term, f"a motion with {', '.join(lacking)}" if lacking else "a motion")


_KINDS = (  # in the order of the legged_gym and Isaac Lab task configurations that most others descend from
    TermKind(
        "base_lin_vel",
        "velocity of the base, m/s: needs an estimator",
        3,
        _linear_velocity,
        reads=BASE_LINEAR_VELOCITY,
        estimate="the velocity of the base",
        conventions=("frame", "at"),
        scales=(1.0, 2.0),
    ),
    TermKind(
        "base_ang_vel",
        "angular velocity of the IMU, rad/s",
        3,
        _angular_velocity,
        names=("base_ang_vel", "imu_ang_vel", "imu_angular_velocity"),
        reads="imu_angular_velocity",
        conventions=("frame",),
        scales=(1.0, 0.25, 0.2),
    ),
    TermKind(
        "projected_gravity",
        "direction of gravity in the body frame, (0, 0, -1) upright",
        3,
        _gravity,
        reads="imu_quaternion",
        conventions=("sign",),
    ),
    TermKind(
        "imu_quaternion", "orientation of the IMU", 4, _quaternion, reads="imu_quaternion", conventions=("quaternion",)
    ),
    TermKind(
        "velocity_command",
        "commanded vx, vy in m/s and yaw rate in rad/s",
        3,
        _command(slice(0, 3)),
        names=("velocity_command", "velocity_commands", "twist"),
        reads=VELOCITY_COMMAND,
    ),
    TermKind(
        "command_lin_vel",
        "commanded vx, vy, m/s",
        2,
        _command(slice(0, 2)),
        reads=VELOCITY_COMMAND,
        scales=(1.0, 2.0),
    ),
    TermKind(
        "command_ang_vel",
        "commanded yaw rate, rad/s",
        1,
        _command(slice(2, 3)),
        reads=VELOCITY_COMMAND,
        scales=(1.0, 0.25),
    ),
    TermKind(
        "motion_command",
        "reference's joint positions and velocities, rad and rad/s",
        lambda bound: 2 * len(bound.contract.joint_names),
        _motion_command,
        names=("motion_command", "motion"),
        tables=("reference_joint_pos", "reference_joint_vel"),
        conventions=("relative",),
    ),
    TermKind(
        "motion_anchor_pos",
        "reference's anchor body from the robot's, m: needs an estimator",
        3,
        _anchor_position,
        names=("motion_anchor_pos", "motion_anchor_pos_b"),
        reads=ANCHOR_POSE,
        estimate="the position of the anchor body",
        tables=("anchor_pos",),
        conventions=("frame",),
        requires="anchor_body",
    ),
    TermKind(
        "motion_anchor_ori",
        "reference's anchor orientation from the robot's, two columns of the matrix",
        6,
        _anchor_orientation,
        names=("motion_anchor_ori", "motion_anchor_ori_b", "motion_ref_ori_b"),
        reads=ANCHOR_POSE,
        estimate="the orientation of the anchor body",
        tables=("anchor_pos",),
        conventions=("layout", "inverse"),
        requires="anchor_body",
    ),
    TermKind(
        "joint_pos",
        "joint positions, rad",
        _per_joint,
        _joint_position,
        names=("joint_pos", "joint_pos_rel", "dof_pos"),
        reads="joint_position",
        conventions=("relative",),
        relative=True,
    ),
    TermKind(
        "joint_vel",
        "joint velocities, rad/s",
        _per_joint,
        _joint_velocity,
        names=("joint_vel", "joint_vel_rel", "dof_vel"),
        reads="joint_velocity",
        scales=(1.0, 0.05, 0.1),
    ),
    TermKind(
        "actions", "last action", _per_action, _last_action, names=("actions", "last_action"), conventions=("form",)
    ),
    TermKind("sin_phase", "sine of the gait phase of each foot", _feet(1), _phase(np.sin), requires="phase"),
    TermKind("cos_phase", "cosine of the gait phase of each foot", _feet(1), _phase(np.cos), requires="phase"),
    TermKind(
        "gait_phase",
        "sines, then cosines of the gait phase",
        _feet(2),
        _phase(np.sin, np.cos),
        names=("gait_phase", "phase"),
        requires="phase",
    ),
    TermKind(
        "imu_linear_acceleration", "acceleration of the IMU, m/s²", 3, _acceleration, reads="imu_linear_acceleration"
    ),
    TermKind(
        "motion_body_pos_b",
        "reference's body positions in the base frame, m",
        _of_table,
        _referenced,
        tables=("motion_body_pos_b",),
        requires="body_names",
    ),
    TermKind(
        "motion_body_ori_b",
        "reference's body orientations in the base frame",
        _of_table,
        _referenced,
        tables=("motion_body_ori_b",),
        requires="body_names",
    ),
    TermKind("target_keys", "keys to press now, 0 or 1", _of_table, _referenced, tables=("target_keys",)),
    TermKind(
        "target_keys_future",
        "keys to press in the steps ahead",
        _of_table,
        _referenced,
        tables=("target_keys_future",),
        requires="lookahead_steps",
    ),
    TermKind("progress", "progress of the motion, 0 to 1", 1, _progress),
    TermKind(
        "key_pressed",
        "keys that are down, 0 or 1",
        _of_live,
        _live,
        reads=KEY_PRESSED,
        topic="/piano/key_state",
    ),
    TermKind(
        "height_scan",
        "height above the ground at the points of a grid, m",
        _of_live,
        _live,
        names=("height_scan", "height_scanner"),
        reads=HEIGHT_SCAN,
        scales=(1.0, 0.2),
        topic="/height_scan",
    ),
)

TERM_KINDS: Mapping[str, TermKind] = MappingProxyType({kind.name: kind for kind in _KINDS})
"""Every kind by its name."""
TERM_NAMES: Mapping[str, str] = MappingProxyType(
    {name: kind.name for kind in _KINDS for name in kind.names or (kind.name,)}
)
"""Every known name of a term, and its kind's."""


def term_kind(name: str, command_names: tuple[str, ...] = ()) -> TermKind:
    """Return the kind of a term by a name of it or of the kind; any other name is that of a live input.

    Args:
        name: as an exporter or a contract has it.
        command_names: of the contract; mjlab and Isaac Lab call motion and velocity commands alike.
    """
    if name == _COMMAND:
        name = "motion_command" if "motion" in command_names else "velocity_command"
    known = TERM_KINDS.get(TERM_NAMES.get(name, name))
    return known or TermKind(name, "live input", _of_live, _extern, reads=name)


def live_kind(name: str) -> TermKind:
    """Return the kind of a live input of that name, whose width a term declares."""
    usual = TERM_KINDS.get(name)
    if usual is not None and usual.topic:
        return replace(usual, width=_of_live, value=_live)
    plain = "".join(letter if f"_{letter}".isidentifier() and letter.isascii() else "_" for letter in name)
    topic = f"/{plain}" if plain.isidentifier() else f"/_{plain}"
    return TermKind(name, "live input", _of_live, _live, reads=name, topic=topic)


def is_known(name: str) -> bool:
    """Tell whether a kind of term, or something that a robot reports, has this name, which no live input may have."""
    is_reported = name in EXTERN_WIDTHS or name.startswith(BASE_LINEAR_VELOCITY)
    return name == _COMMAND or name in TERM_KINDS or name in TERM_NAMES or is_reported


def value_names(term: Term, contract: PolicyContract) -> tuple[str, ...]:
    """Return the joint of each value of a term, where each has one; else nothing."""
    match contract.kind(term).name:
        case "joint_pos" | "joint_vel":
            return contract.joint_names if term.joints is None else term.joints
        case "motion_command":
            return contract.joint_names * 2
        case "actions":
            return contract.action_joint_names
    return ()
