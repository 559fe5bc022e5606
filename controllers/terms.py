"""The one table of observation terms: the meaning, width and value of each. A new term is one row here.

Exporters give the same quantity different names, and `command` stands for the contract's command. Functions take
`(..., n)`, one robot or a batch.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from humanoid_sim.controllers.rotation import (
    conjugate,
    gravity_direction,
    matrix,
    multiply,
    rotate,
    rotate_inverse,
    rotation_6d,
)
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
class TermInput:
    """Everything that a term may read in one policy step."""

    state: MITState
    last_action: Float32Array  # shape (..., m), raw
    frame: Frame  # shape (...)
    alignment: Alignment | None = None  # alignment of the reference with the robot, made at activation
    phase: FloatArray = field(default_factory=lambda: np.empty(0))  # shape (..., k), rad


@dataclass(frozen=True, slots=True, eq=False)
class BoundTerm:
    """A term on a robot, everything looked up once. Raises `FieldError` if its source is missing."""

    term: Term
    kind: TermKind
    contract: PolicyContract
    reference: MotionReference
    extern: Mapping[str, int]  # name and width of the live inputs that exist
    order: IndexArray  # the joints that the term shows, as places among the robot's
    zero: FloatArray | float  # rad, of these joints: subtracted from positions
    is_plain: bool  # neither clipped nor scaled: most terms are, and a multiplication by 1 in every step is not free
    start: int  # place of the first value within one step's values
    stop: int = field(init=False)

    def __post_init__(self) -> None:
        check_sources(self)
        width = self.kind.width if isinstance(self.kind.width, int) else _WIDTHS[self.kind.width](self)
        object.__setattr__(self, "stop", self.start + width)

    @property
    def name(self) -> str:
        """As the exporter calls it."""
        return self.term.name

    @property
    def width(self) -> int:
        """Number of values that the policy sees, all steps of its history together."""
        return (self.stop - self.start) * self.term.history


_WIDTHS: Mapping[str, Callable[[BoundTerm], int]] = {
    "joints": lambda bound: len(bound.order),
    "2 policy joints": lambda bound: 2 * len(bound.contract.joint_names),
    "actions": lambda bound: bound.contract.action_count,
    "feet": lambda bound: len(bound.contract.phase.offsets) if bound.contract.phase else 0,
    "2 feet": lambda bound: 2 * len(bound.contract.phase.offsets) if bound.contract.phase else 0,
    "table": lambda bound: bound.reference.terms[bound.kind.name].shape[1],
    "input": lambda bound: bound.extern[bound.kind.reads],
}
Value = Callable[[BoundTerm, TermInput], Any]  # shape (..., width), before clip and scale


def _joint_position(bound: BoundTerm, now: TermInput) -> FloatArray:
    return now.state.joint_position[..., bound.order] - bound.zero


def _last_action(bound: BoundTerm, now: TermInput) -> Any:
    action = bound.contract.clipped(now.last_action)  # trainers that clip actions keep, and show, the clipped ones
    return action * bound.contract.action_scale if bound.term.form == "scaled" else action


def _angular_velocity(bound: BoundTerm, now: TermInput) -> FloatArray:
    velocity = now.state.imu_angular_velocity
    return velocity if bound.term.frame == "body" else rotate(now.state.imu_quaternion, velocity)


def _quaternion(bound: BoundTerm, now: TermInput) -> FloatArray:
    quaternion = now.state.imu_quaternion
    return quaternion if bound.term.quaternion == "wxyz" else quaternion[..., [1, 2, 3, 0]]


def _linear_velocity(bound: BoundTerm, now: TermInput) -> FloatArray:
    velocity = _live_or_nan(now.state, bound.kind.input(bound.term), 3)
    return velocity if bound.term.frame == "world" else rotate_inverse(now.state.imu_quaternion, velocity)


def live_command(state: MITState, contract: PolicyContract) -> FloatArray:
    """Return the velocity command within the contract's ranges, shape (3,): zero if there is none, or it is too old."""
    live = _live_input(state, VELOCITY_COMMAND, 3)
    command = np.zeros(3) if live is None else live.at(state.time)
    ranges = contract.command_ranges
    return command if ranges is None else np.clip(command, ranges[:, 0], ranges[:, 1])


def _command(part: slice) -> Value:
    return lambda bound, now: live_command(now.state, bound.contract)[..., part]


def _phase(*functions: Callable[[FloatArray], FloatArray]) -> Value:
    """Return functions of the phase of each foot, one after the other; 0 without a phase."""

    def value(_bound: BoundTerm, now: TermInput) -> FloatArray:
        values = np.concatenate([function(now.phase) for function in functions], axis=-1)
        return np.where(np.isnan(values), 0.0, values)

    return value


def _live(bound: BoundTerm, now: TermInput) -> FloatArray:
    return _live_or_nan(now.state, bound.kind.reads, bound.stop - bound.start)


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


def _motion_command(bound: BoundTerm, now: TermInput) -> FloatArray:
    position: Any = bound.reference.term("reference_joint_pos", now.frame)
    if bound.kind.is_relative(bound.term):
        position = position - bound.contract.default_joint_pos
    return np.concatenate([position, bound.reference.term("reference_joint_vel", now.frame)], axis=-1)


def anchor_pose(state: MITState) -> FloatArray:
    """Return the anchor body's pose, shape (..., 7); a position of NaN where only its orientation is known."""
    if ANCHOR_POSE in state.extern or ANCHOR_ORIENTATION not in state.extern:
        return _live_or_nan(state, ANCHOR_POSE, EXTERN_WIDTHS[ANCHOR_POSE])
    quaternion = _live_or_nan(state, ANCHOR_ORIENTATION, 4)
    return np.concatenate([np.full((*quaternion.shape[:-1], 3), np.nan), quaternion], axis=-1)


def _anchor_position(bound: BoundTerm, now: TermInput) -> FloatArray:
    pose = anchor_pose(now.state)
    offset = bound.reference.anchor(now.frame, now.alignment)[0] - pose[..., :3]
    return offset if bound.term.frame == "world" else rotate_inverse(pose[..., 3:], offset)


def _anchor_orientation(bound: BoundTerm, now: TermInput) -> FloatArray:
    target = bound.reference.anchor(now.frame, now.alignment)[1]
    relative = multiply(conjugate(anchor_pose(now.state)[..., 3:]), target)
    rotation = matrix(conjugate(relative) if bound.term.inverse else relative)
    if bound.term.layout == "rows":
        return rotation_6d(rotation)
    six = rotation[..., :2, :] if bound.term.layout == "two_rows" else np.swapaxes(rotation[..., :2], -1, -2)
    return six.reshape(*rotation.shape[:-2], 6)


def _referenced(bound: BoundTerm, now: TermInput) -> Any:
    return bound.reference.term(bound.kind.name, now.frame)


@dataclass(frozen=True, slots=True)
class TermKind:
    """Description of a kind of observation term, whatever the term is called."""

    name: str
    meaning: str  # meaning in words, with its unit
    width: int | str  # number of values of one step, or the key of `_WIDTHS` that counts them
    value: Value
    _: KW_ONLY
    names: tuple[str, ...] = ()  # names that exporters use for it, beside its own
    reads: str = ""  # field of `MITState`, or live input, that it is made of; empty: the policy's memory, or its motion
    tables: tuple[str, ...] = ()  # tables of the motion that it needs
    conventions: tuple[Convention, ...] = ()  # conventions that may be mistaken: options of `Term`, or its `sign`
    relative: bool = False  # True if positions are relative to the default pose unless the term says otherwise
    requires: str = ""  # field of the contract without which it means nothing
    scales: tuple[float, ...] = (1.0,)  # scales seen in published policies
    topic: str = ""  # topic on which other programs publish it; empty: none does

    @property
    def task(self) -> Literal["", "tracking", "piano"]:
        """The task that a policy with such a term has; empty: any."""
        if self.name.startswith("target_keys"):
            return "piano"
        return "tracking" if self.tables else ""

    @property
    def is_estimate(self) -> bool:
        """True if it is made of what a simulation knows and a robot has to estimate."""
        return self.reads in (BASE_LINEAR_VELOCITY, ANCHOR_POSE)

    def is_relative(self, term: Term) -> bool:
        """Return whether the positions of such a term are less the default pose."""
        return self.relative if term.relative is None else term.relative

    def input(self, term: Term) -> str:
        """Return the field of `MITState`, or the live input, that such a term is made of; empty as in `reads`."""
        return point_velocity(term.at) if "at" in self.conventions else self.reads


_ANCHOR = ("anchor_pos",)
_KINDS = (  # in the order of the legged_gym and Isaac Lab task configurations that most others descend from
    TermKind("base_lin_vel", "velocity of the base, m/s: needs an estimator", 3, _linear_velocity,
             reads=BASE_LINEAR_VELOCITY, conventions=("frame", "at"), scales=(1.0, 2.0)),
    TermKind("base_ang_vel", "angular velocity of the IMU, rad/s", 3, _angular_velocity,
             names=("imu_ang_vel", "imu_angular_velocity"), reads="imu_angular_velocity", conventions=("frame",),
             scales=(1.0, 0.25, 0.2)),
    TermKind("projected_gravity", "direction of gravity in the body frame, (0, 0, -1) upright", 3,
             lambda _bound, now: gravity_direction(now.state.imu_quaternion),
             reads="imu_quaternion", conventions=("sign",)),
    TermKind("imu_quaternion", "orientation of the IMU", 4, _quaternion,
             reads="imu_quaternion", conventions=("quaternion",)),
    TermKind("velocity_command", "commanded vx, vy in m/s and yaw rate in rad/s", 3, _command(slice(0, 3)),
             names=("velocity_commands", "twist"), reads=VELOCITY_COMMAND),
    TermKind("command_lin_vel", "commanded vx, vy, m/s", 2, _command(slice(0, 2)),
             reads=VELOCITY_COMMAND, scales=(1.0, 2.0)),
    TermKind("command_ang_vel", "commanded yaw rate, rad/s", 1, _command(slice(2, 3)),
             reads=VELOCITY_COMMAND, scales=(1.0, 0.25)),
    TermKind("motion_command", "reference's joint positions and velocities, rad and rad/s",
             "2 policy joints", _motion_command, names=("motion",),
             tables=("reference_joint_pos", "reference_joint_vel"), conventions=("relative",)),
    TermKind("motion_anchor_pos", "reference's anchor body from the robot's, m: needs an estimator", 3,
             _anchor_position, names=("motion_anchor_pos_b",), reads=ANCHOR_POSE,
             tables=_ANCHOR, conventions=("frame",), requires="anchor_body"),
    TermKind("motion_anchor_ori", "reference's anchor orientation from the robot's, two columns of the matrix", 6,
             _anchor_orientation, names=("motion_anchor_ori_b", "motion_ref_ori_b"), reads=ANCHOR_POSE,
             tables=_ANCHOR, conventions=("layout", "inverse"), requires="anchor_body"),
    TermKind("joint_pos", "joint positions, rad", "joints", _joint_position,
             names=("joint_pos_rel", "dof_pos"), reads="joint_position", conventions=("relative",), relative=True),
    TermKind("joint_vel", "joint velocities, rad/s", "joints",
             lambda bound, now: now.state.joint_velocity[..., bound.order],
             names=("joint_vel_rel", "dof_vel"), reads="joint_velocity", scales=(1.0, 0.05, 0.1)),
    TermKind("actions", "last action", "actions", _last_action, names=("last_action",), conventions=("form",)),
    TermKind("sin_phase", "sine of the gait phase of each foot", "feet", _phase(np.sin), requires="phase"),
    TermKind("cos_phase", "cosine of the gait phase of each foot", "feet", _phase(np.cos), requires="phase"),
    TermKind("gait_phase", "sines, then cosines of the gait phase", "2 feet", _phase(np.sin, np.cos),
             names=("phase",), requires="phase"),
    TermKind("imu_linear_acceleration", "acceleration of the IMU, m/s²", 3,
             lambda _bound, now: now.state.imu_linear_acceleration,
             reads="imu_linear_acceleration"),
    TermKind("motion_body_pos_b", "reference's body positions in the base frame, m", "table", _referenced,
             tables=("motion_body_pos_b",), requires="body_names"),
    TermKind("motion_body_ori_b", "reference's body orientations in the base frame", "table", _referenced,
             tables=("motion_body_ori_b",), requires="body_names"),
    TermKind("target_keys", "keys to press now, 0 or 1", "table", _referenced, tables=("target_keys",)),
    TermKind("target_keys_future", "keys to press in the steps ahead", "table", _referenced,
             tables=("target_keys_future",), requires="lookahead_steps"),
    TermKind("progress", "progress of the motion, 0 to 1", 1,
             lambda bound, now: np.asarray(bound.reference.progress(now.frame))[..., None]),
    TermKind("key_pressed", "keys that are down, 0 or 1", "input", _live,
             reads=KEY_PRESSED, topic="/piano/key_state"),
    TermKind("height_scan", "height above the ground at the points of a grid, m", "input", _live,
             names=("height_scanner",), reads=HEIGHT_SCAN, scales=(1.0, 0.2), topic="/height_scan"),
)  # fmt: skip

TERM_KINDS: Mapping[str, TermKind] = {kind.name: kind for kind in _KINDS}  # every kind by its name
TERM_NAMES: Mapping[str, str] = {name: kind.name for kind in _KINDS for name in (kind.name, *kind.names)}
"""Every known name of a term, and its kind's."""
USUAL_TOPICS: Mapping[str, str] = {kind.reads: kind.topic for kind in _KINDS if kind.topic}
"""Topics of the live inputs that have a kind of their own."""


def term_kind(name: str, command_names: tuple[str, ...] = (), *, is_declared: bool = False) -> TermKind:
    """Return the kind of a term by a name of it or of the kind; any other name is that of a live input.

    By `command_names` of the contract: mjlab and Isaac Lab call motion and velocity commands alike. A live input of
    which a term declares the width has a topic of its name.
    """
    if name == _COMMAND:
        name = "motion_command" if "motion" in command_names else "velocity_command"
    known = TERM_KINDS.get(TERM_NAMES.get(name, name))
    return known or TermKind(name, "live input", "input", _live, reads=name, topic=f"/{name}" if is_declared else "")


def check_sources(bound: BoundTerm) -> None:
    """Raise `FieldError` if what a term is made of is not there, or is of another width."""
    term, kind, extern, tables = bound.term, bound.kind, bound.extern, bound.reference.terms
    where, none = f"observation term '{term.name}'", "and there is none"
    if term.kind == _COMMAND and not bound.contract.command_names:
        raise FieldError(f"{where}: means a command, and command_names is empty")
    if kind.requires == "phase" and bound.contract.phase is None:
        raise FieldError(f"{where} needs the contract's phase rule, {none}")
    lacking = [table for table in kind.tables if table not in tables]
    if lacking or (kind.name == "progress" and not tables):
        raise FieldError(f"{where} needs a motion{' with ' if lacking else ''}{', '.join(lacking)}, {none}")
    inputs = {kind.input(term), ANCHOR_ORIENTATION if kind.name == "motion_anchor_ori" else ""}
    if kind.is_estimate and not inputs & set(extern):
        known = "a simulation knows it, a robot needs an estimator for it"
        raise FieldError(f"{where} needs the {kind.input(term)}: {known}, {none}")
    if kind.width != "input":
        return
    declared = term.width if term.scan is None else term.scan.count
    if kind.reads not in extern and declared is None and not kind.topic:
        unknown = known_names("observation term", term.name, sorted({*TERM_NAMES, *extern}))
        raise FieldError(f"{unknown}; a width declares a live input: {{name: {term.name}, width: 2}}")
    if kind.reads not in extern:
        source = "a program sends it, or `live` from Python feeds it"
        raise FieldError(f"{where} needs the live input '{kind.reads}', {none}; {source}")
    if declared not in (None, extern[kind.reads]):
        raise FieldError(f"{where}: is {declared} wide, but the input has {extern[kind.reads]}")


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
