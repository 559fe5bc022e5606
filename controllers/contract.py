"""Contract of a checkpoint: everything that it needs to run, as plain data, whatever file it came from.

Every convention that differs between exporters is a field here, so that any wiring, a wrong one too, can be written
down. What the terms of an observation mean is in `terms`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np

from humanoid_sim.controllers.parameters import one_of, per_joint, require, require_fields, require_names
from humanoid_sim.controllers.terms import TERM_NAMES, TermKind, term_kind
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import (
    BASE,
    BASE_LINEAR_VELOCITY,
    EXTERN_WIDTHS,
    HEIGHT_SCAN,
    VELOCITY_COMMAND,
    BoolArray,
    Float32Array,
    FloatArray,
    frozen_array,
    point_velocity,
)

TaskType = Literal["tracking", "piano", "locomotion"]
HistoryLayout = Literal["per_term", "per_step"]
QuaternionOrder = Literal["wxyz", "xyzw"]
JOINT_LIMITS = "joint_limits"


@dataclass(frozen=True, slots=True)
class HeightScan:
    """A grid of points around a body, and the value made of the ground's height at each of them.

    The grid lies level and turns with the body's yaw. From each point a ray goes straight down; a value is the body's
    height less that of the ground, less `offset`. The defaults are mjlab's (`RayCastSensorCfg`, `GridPatternCfg` and
    `mdp.height_scan` of 1.6.0).
    """

    at: str = BASE  # the body in the grid's middle: `base`, `imu`, or the name of a site or body
    grid: tuple[float, float] = (1.6, 1.0)  # m, length along the body's x and y
    resolution: float = 0.1  # m between two points
    offset: float = 0.0  # m
    range: float = 5.0  # m, length of a ray, and the value of one that hits nothing

    def __post_init__(self) -> None:
        checks = {
            "resolution": (0.0 < self.resolution < np.inf, "m > 0"),
            "range": (0.0 < self.range < np.inf, "m > 0"),
            "grid": (len(self.grid) == 2 and all(0.0 <= side < np.inf for side in self.grid), "two lengths, m >= 0"),
        }
        require_fields("HeightScan", self, checks)

    @property
    def count(self) -> int:
        return len(self.points)

    @property
    def points(self) -> FloatArray:
        """Shape (count, 2), m, x and y from the grid's middle, in the order of the values: x changes first."""
        # Those within the grid, however a multiple of the resolution is rounded.
        x, y = (np.arange(int(side / self.resolution + 1e-6) + 1) * self.resolution - 0.5 * side for side in self.grid)
        return np.column_stack([np.tile(x, len(y)), np.repeat(y, len(x))])


@dataclass(frozen=True, slots=True, eq=False)
class Term:
    """One observation term. Processing order: the value, its conventions, clip, scale, history."""

    name: str  # as the exporter calls it
    kind: str = ""  # meaning: a name of `TERM_KINDS`, `command`, or the name of a live input; empty: by its name
    scale: FloatArray | float = 1.0  # scalar, or one factor per value. 0 feeds zeros
    clip: tuple[float, float] | None = None  # bounds before scaling
    history: int = 1  # number of policy steps that are shown, this one included
    history_order: Literal["oldest_first", "newest_first"] = "oldest_first"
    frame: Literal["body", "world"] = "body"  # for velocities and the anchor position
    at: str = BASE  # for the velocity of the base, which point's: `base` for its origin, `imu`, or the name of a site
    relative: bool | None = None  # less the default pose: joint positions (None: true), motion command (None: false)
    layout: Literal["rows", "columns", "two_rows"] = "rows"  # of six orientation values, two columns by rows
    inverse: bool = False  # for the anchor orientation: seen from the reference instead of from the robot
    quaternion: QuaternionOrder = "wxyz"  # for terms that are quaternions
    form: Literal["raw", "scaled"] = "raw"  # for the last action: the network's output, or that times the action scale
    joints: tuple[str, ...] | None = None  # for joint positions and velocities, in this order; None: all, the policy's
    scan: HeightScan | None = None  # for a height scan: its grid; None: mjlab's
    width: int | None = None  # number of values of a live input that no kind of term expresses; None: the kind's
    timeout: float | None = None  # s after arrival from which a live input is stale; None: 0.5

    def __post_init__(self) -> None:
        where, put = f"observation term '{self.name}'", partial(object.__setattr__, self)
        put("kind", self.kind or (self.name if self.width else TERM_NAMES.get(self.name, self.name)))
        put("scale", frozen_array(where, "scale", self.scale))
        has_scan = self.kind == HEIGHT_SCAN and self.width is None
        if has_scan and self.scan is None:
            put("scan", HeightScan())
        usual = term_kind(self.kind, is_declared=self.width is not None)
        is_reported = self.kind in EXTERN_WIDTHS or self.kind.startswith(BASE_LINEAR_VELOCITY)
        is_sent = usual.topic and not is_reported  # else it is the robot's, or made of its state: nobody else's to send
        live = "of a live input; a width declares one, as in width: 2"
        checks = {
            "scale": (np.ndim(self.scale) <= 1 and np.isfinite(self.scale).all(), "a finite number, or one per value"),
            "clip": (self.clip is None or self.clip[0] <= self.clip[1], "a lower and an upper bound"),
            "kind": (self.width is None or re.fullmatch(r"[A-Za-z_]\w*", self.kind, re.ASCII), "a ROS 2 name"),
            "history": (self.history >= 1, "a whole number >= 1"),
            "scan": (self.scan is None or has_scan, "none: only a height_scan has one"),
            "width": (self.width is None or (self.width >= 1 and is_sent), "none: only a live input has one, >= 1"),
            "timeout": (self.timeout is None or (is_sent and self.timeout > 0.0), f"seconds > 0, or .inf, {live}"),
        }
        require_fields(where, self, checks)
        if self.joints is not None:
            require_names(f"{where}.joints", self.joints)

    def process(self, value: FloatArray) -> FloatArray:
        """Clip, then scale, a value of shape (..., width)."""
        if self.clip is not None:
            value = np.clip(value, *self.clip)
        return value * self.scale


class LiveTopic(NamedTuple):
    """Topic on which other programs publish a live input, as `std_msgs/msg/Float32MultiArray`."""

    name: str
    timeout: float | None = None  # s after its arrival from which a value is stale, also infinite; None: not stated


@dataclass(frozen=True, slots=True)
class TensorNames:
    """Names of the tensors of a model; empty ones are found by their place."""

    observation: str = ""
    action: str = ""
    time_step: str = ""  # input that selects a frame of a motion inside the graph


@dataclass(frozen=True, slots=True, eq=False)
class PhaseRule:
    """The gait clock of policies that observe one: an angle per foot, and how it moves from one step to the next."""

    period: float  # s of one gait cycle
    offsets: FloatArray = field(default_factory=lambda: np.array([0.0, np.pi]))  # (k,), rad, of each foot at activation
    advance_first: bool = True  # the first observation shows the phase one step on, not the offsets themselves
    standing_threshold: float = 0.0  # magnitude of the velocity command below which the robot stands; 0: it never does
    standing_value: float | None = np.pi  # rad, shown for every foot while standing; None: sine and cosine are both 0
    standing_restarts: bool = True  # walking on starts from the offsets again; False: the clock runs on while standing

    def __post_init__(self) -> None:
        offsets = frozen_array("PhaseRule", "offsets", self.offsets)
        object.__setattr__(self, "offsets", offsets)
        checks = {
            "period": (0.0 < self.period < np.inf, "seconds > 0"),
            "offsets": (offsets.ndim == 1 and len(offsets) and np.isfinite(offsets).all(), "one angle per foot"),
            "standing_threshold": (0.0 <= self.standing_threshold < np.inf, "a number >= 0"),
        }
        require_fields("PhaseRule", self, checks)


@dataclass(frozen=True, slots=True, eq=False)
class PolicyContract:
    """Everything that a checkpoint needs to run: n joints, of which the action drives m.

    Raises `FieldError` at construction if the fields do not fit each other. In fields of shape (n,) or (m,) a scalar
    stands for all.
    """

    task_type: TaskType  # selects the layout of the motion reference
    joint_names: tuple[str, ...]  # the full articulation, n joints; the order of the per-joint arrays
    action_joint_names: tuple[str, ...]  # the m joints that the action drives, in its order; the others are pinned to 0
    joint_stiffness: FloatArray  # shape (n,), N·m/rad
    joint_damping: FloatArray  # shape (n,), N·m·s/rad
    default_joint_pos: FloatArray  # shape (n,), rad
    observation: Sequence[Term | str]  # term by term; a plain name becomes the term with its usual conventions
    command_names: tuple[str, ...]  # runtime command terms
    action_scale: FloatArray  # shape (m,), rad per unit of action
    policy_dt: float  # s
    body_names: tuple[str, ...] = ()  # bodies that the motion reference describes, b of them
    dataset_repo_id: str = ""  # dataset that the default motion comes from; empty for none
    lookahead_steps: tuple[int, ...] = ()  # steps ahead of this one that `target_keys_future` shows (piano)
    action_offset: FloatArray | None = None  # shape (m,), rad, added to the scaled action; None: the default pose
    action_clip: float = np.inf  # magnitude at which a raw action is clipped before it is scaled
    action_limit: float = 100.0  # magnitude of a raw action beyond which the policy has failed: few exceed ten
    position_clip: FloatArray | str | None = None
    """Shape (m, 2), or (1, 2) for all, rad, bounds of commanded positions; None: none; `joint_limits`: the robot's."""
    effort_limit: FloatArray | None = None
    """Shape (n,), N·m, of the training, infinite without; a robot with lower limits keeps them. None: the robot's."""
    model_joint_damping: Literal["undecided", "keep", "drop"] = "undecided"
    """Whether the damping of the robot's own model acts in addition to `joint_damping`. Undecided: it does."""
    history_layout: HistoryLayout = "per_term"  # of several steps: each term's together, or each step's together
    command_ranges: FloatArray | None = None  # shape (3, 2), bounds of vx, vy (m/s) and yaw rate (rad/s); None: any
    phase: PhaseRule | None = None  # the gait clock of policies that observe one
    anchor_body: str = ""  # the body that the reference's anchor terms compare
    align_reference: bool = True  # align the reference with the robot at activation: in heading and place
    reference_quaternion: QuaternionOrder = "wxyz"  # order in which the motion's source gives quaternions
    tensors: TensorNames = field(default_factory=TensorNames)  # names in the model's graph
    source: Mapping[str, str] = field(default_factory=dict)
    """Field, `phase.PART`, `tensors.PART` or `observation.TERM.OPTION` to where it came from; others: by default."""

    def __post_init__(self) -> None:
        put = partial(object.__setattr__, self)
        for name in ("joint_names", "action_joint_names", "body_names", "command_names", "lookahead_steps"):
            put(name, tuple(getattr(self, name)))
        put("observation", tuple(term if isinstance(term, Term) else Term(term) for term in self.observation))
        put("source", dict(self.source))
        owner, joints, driven = "PolicyContract", self.joint_names, self.action_joint_names
        self._check_names(owner)
        is_one_history = self.history_layout == "per_term" or len({term.history for term in self.terms}) == 1
        has_lookahead = self.lookahead_steps or "target_keys_future" not in self.observation_names
        checks = {
            "lookahead_steps": (has_lookahead, "the steps ahead that target_keys_future shows"),
            "history_layout": (is_one_history, "per_term where terms show different numbers of steps"),
            "policy_dt": (0.0 < self.policy_dt <= 1.0, "seconds > 0, at most 1"),
            "action_clip": (self.action_clip > 0.0, "a number > 0"),
            "action_limit": (self.action_limit > 0.0, "a number > 0"),
        }
        require_fields(owner, self, checks)
        one_of(owner, "task_type", self.task_type, TaskType)
        for name in ("joint_stiffness", "joint_damping"):
            put(name, per_joint(owner, name, getattr(self, name), joints, _is_gain, "a finite number >= 0"))
        put("default_joint_pos", per_joint(owner, "default_joint_pos", self.default_joint_pos, joints))
        if self.action_offset is None:
            put("action_offset", self.default_joint_pos[[joints.index(joint) for joint in driven]])
        for name in ("action_offset", "action_scale"):
            put(name, per_joint(owner, name, getattr(self, name), driven))
        if self.effort_limit is not None:
            limit = per_joint(owner, "effort_limit", self.effort_limit, joints, lambda array: array > 0.0, "N·m > 0")
            put("effort_limit", limit)
        if isinstance(self.position_clip, str):
            one_of(owner, "position_clip", self.position_clip, Literal["joint_limits"])
        elif self.position_clip is not None:
            put("position_clip", _bounds("position_clip", self.position_clip, len(driven), may_be_one=True))
        if self.command_ranges is not None:
            put("command_ranges", _bounds("command_ranges", self.command_ranges, 3))

    def _check_names(self, owner: str) -> None:
        """Check the names of joints and terms, and that all terms of one live input describe it alike."""
        require_names(f"{owner}.joint_names", self.joint_names)
        require_names(f"{owner}.action_joint_names", self.action_joint_names, self.joint_names)
        require_names(f"{owner}.observation", self.observation_names)
        for term in self.terms:
            if term.joints is not None:
                require_names(f"{owner}.observation: term '{term.name}'", term.joints, self.joint_names)
            same = [other for other in self.terms if other.kind == term.kind]
            if len({(other.width, other.timeout, other.scan) for other in same}) > 1:
                names = " and ".join(other.name for other in same)
                raise FieldError(f"{owner}.observation: {names} differ in width, timeout or scan")

    @property
    def terms(self) -> tuple[Term, ...]:
        """The observation terms, in order, every one written out."""
        return self.observation  # type: ignore[return-value]  # terms all, since construction

    @property
    def observation_names(self) -> tuple[str, ...]:
        return tuple(term.name for term in self.terms)

    def clipped(self, action: Float32Array) -> Float32Array:
        """Return raw actions, shape (..., m), as they are scaled."""
        return np.clip(action, -self.action_clip, self.action_clip) if self.action_clip < np.inf else action

    @property
    def action_count(self) -> int:
        """m, the width of the action."""
        return len(self.action_joint_names)

    def kind(self, term: Term) -> TermKind:
        """Return what a term means here; `command` stands for the motion or the velocity, as `command_names` says."""
        return term_kind(term.kind, self.command_names, is_declared=term.width is not None)

    def requires(self, name: str) -> bool:
        """Return whether the observation has a term that means nothing without this field."""
        return any(self.kind(term).requires == name for term in self.terms)

    @property
    def takes_velocity_command(self) -> bool:
        """Return whether the observation depends on the velocity command: as a term, or by the gait clock."""
        return self.phase is not None or any(self.kind(term).reads == VELOCITY_COMMAND for term in self.terms)

    @property
    def velocity_points(self) -> tuple[str, ...]:
        """Points of the robot beside its base whose velocity is observed: `imu`, or names of sites; each once."""
        points = [term.at for term in self.terms if "at" in self.kind(term).conventions]
        return tuple(point for point in dict.fromkeys(points) if point != BASE)

    @property
    def height_scan(self) -> HeightScan | None:
        """The scan of the ground that is observed; None without one."""
        return next((term.scan for term in self.terms if term.scan is not None), None)

    @property
    def live_inputs(self) -> Mapping[str, int]:
        """Name and width of the live inputs that terms declare, because no kind expresses them."""
        return {term.kind: term.width for term in self.terms if term.width is not None}

    @property
    def extern_widths(self) -> Mapping[str, int]:
        """Name and width of the live inputs that such a policy can have: of a robot in a simulation, and declared."""
        points = {point_velocity(point): 3 for point in self.velocity_points}
        scan = {} if self.height_scan is None else {HEIGHT_SCAN: self.height_scan.count}
        return {**EXTERN_WIDTHS, **points, **self.live_inputs, **scan}

    @property
    def live_topics(self) -> Mapping[str, LiveTopic]:
        """Topics of the live inputs that are observed and that other programs may publish, by name."""
        kinds = ((term, self.kind(term)) for term in self.terms)
        return {kind.reads: LiveTopic(kind.topic, term.timeout) for term, kind in kinds if kind.topic}


def _is_gain(values: FloatArray) -> BoolArray:
    gains: BoolArray = np.isfinite(values) & (values >= 0.0)
    return gains


def _bounds(name: str, value: Any, rows: int, *, may_be_one: bool = False) -> FloatArray:
    """Return least and greatest values, shape (rows, 2), from as many pairs, or from one for all."""
    pairs = frozen_array("PolicyContract", name, value)
    is_accepted = pairs.shape == (rows, 2) or (may_be_one and pairs.shape == (1, 2))
    is_accepted = is_accepted and bool((pairs[:, 0] <= pairs[:, 1]).all())
    require(is_accepted, f"PolicyContract.{name}", pairs.tolist(), f"[least, greatest] {rows} times")
    return frozen_array("PolicyContract", name, np.broadcast_to(pairs, (rows, 2)))
