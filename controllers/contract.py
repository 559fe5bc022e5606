"""What a checkpoint needs to run: one frozen struct, whatever file it came from."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np

from humanoid_sim.controllers.parameters import joint_tuple, number, per_joint
from humanoid_sim.controllers.terms import QuaternionOrder, Term
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import FloatArray, frozen_array

__all__ = ["HistoryLayout", "PhaseRule", "PolicyContract", "TaskType", "TensorNames"]

TaskType = Literal["tracking", "piano", "locomotion"]
HistoryLayout = Literal["per_term", "per_step"]

_OWNER = "PolicyContract"


@dataclass(frozen=True, slots=True)
class TensorNames:
    """Names of the tensors of a model; empty ones are found by their place."""

    observation: str = ""
    action: str = ""
    time_step: str = ""
    """Input that selects a frame of a motion inside the graph."""


@dataclass(frozen=True, slots=True, eq=False)
class PhaseRule:
    """The gait clock of policies that observe one: an angle per foot, and how it moves from one step to the next."""

    period: float
    """s of one gait cycle."""
    offsets: FloatArray = field(default_factory=lambda: np.array([0.0, np.pi]))
    """Shape (k,), rad, of the k feet at activation."""
    advance_first: bool = True
    """The first observation shows the phase one step on, not the offsets themselves."""
    standing_threshold: float = 0.0
    """Magnitude of the velocity command below which the robot stands; 0: it never does."""
    standing_value: float | None = np.pi
    """rad, shown for every foot while standing; None: sine and cosine are both 0."""
    standing_restarts: bool = True
    """Walking on starts from the offsets again; false: the clock runs on while the robot stands."""

    def __post_init__(self) -> None:
        owner = "PhaseRule"
        set_field = object.__setattr__
        set_field(self, "period", number(owner, "period", self.period, above=True))
        offsets = frozen_array(owner, "offsets", self.offsets)
        if offsets.ndim != 1 or not offsets.size or not np.isfinite(offsets).all():
            raise FieldError(f"{owner}.offsets: is {self.offsets}, expected one finite angle per foot")
        set_field(self, "offsets", offsets)
        set_field(self, "standing_threshold", number(owner, "standing_threshold", self.standing_threshold))
        if self.standing_value is not None:
            set_field(self, "standing_value", number(owner, "standing_value", self.standing_value, minimum=-np.inf))


@dataclass(frozen=True, slots=True, eq=False)
class PolicyContract:
    """Everything that a checkpoint needs to run, checked against itself.

    Every convention that differs between exporters is a field here or in `Term`, so that any wiring can be written
    down.
    """

    task_type: TaskType
    """Selects the layout of the motion reference."""
    joint_names: tuple[str, ...]
    """The full articulation, n joints; the order of the per-joint arrays."""
    action_joint_names: tuple[str, ...]
    """The m joints that the action drives, in its order; the others are pinned to position 0."""
    joint_stiffness: FloatArray
    """Shape (n,), N·m/rad."""
    joint_damping: FloatArray
    """Shape (n,), N·m·s/rad."""
    default_joint_pos: FloatArray
    """Shape (n,), rad."""
    observation: Sequence[Term | str]
    """The flat observation, term by term; a plain name becomes the term with its usual conventions."""
    command_names: tuple[str, ...]
    """Runtime command terms."""
    action_scale: FloatArray
    """Shape (m,) or scalar, rad per unit of action."""
    policy_dt: float
    """s"""
    body_names: tuple[str, ...]
    """Bodies that the motion reference describes, b of them."""
    dataset_repo_id: str = ""
    """Where the default motion comes from; empty for none."""
    lookahead_steps: tuple[int, ...] = ()
    """Policy steps ahead of the present one that `target_keys_future` shows (piano)."""
    action_offset: FloatArray | None = None
    """Shape (m,) or scalar, rad, added to the scaled action; None: the default pose of the driven joints."""
    action_clip: float = float("inf")
    """Magnitude at which a raw action is clipped before it is scaled."""
    position_clip: FloatArray | None = None
    """Shape (m, 2) or (1, 2), rad, least and greatest position that leaves as a command; None: any."""
    history_layout: HistoryLayout = "per_term"
    """Of terms that show more than one step: each term's steps together, or each step's terms together."""
    command_ranges: FloatArray | None = None
    """Shape (3, 2), the least and greatest vx, vy (m/s) and yaw rate (rad/s) that the policy knows; None: any."""
    phase: PhaseRule | None = None
    """The gait clock of policies that observe one."""
    anchor_body: str = ""
    """The body that the reference's anchor terms compare."""
    align_reference: bool = True
    """Lay the reference onto the robot at activation: turned to its heading, moved to where it stands."""
    reference_quaternion: QuaternionOrder = "wxyz"
    """Order in which the motion's source gives quaternions."""
    tensors: TensorNames = field(default_factory=TensorNames)
    """Names in the model's graph."""
    provenance: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Field to the source it came from."""

    def __post_init__(self) -> None:
        set_field = object.__setattr__
        if self.task_type not in get_args(TaskType):
            raise FieldError(
                f"{_OWNER}.task_type: is {self.task_type!r}, expected one of {', '.join(get_args(TaskType))}"
            )
        set_field(self, "joint_names", joint_tuple(_OWNER, self.joint_names, "joint_names"))
        set_field(self, "action_joint_names", joint_tuple(_OWNER, self.action_joint_names, "action_joint_names"))
        strangers = [joint for joint in self.action_joint_names if joint not in self.joint_names]
        if strangers:
            raise FieldError(
                f"{_OWNER}.action_joint_names: {', '.join(strangers)} not in joint_names: {', '.join(self.joint_names)}"
            )
        for name in ("joint_stiffness", "joint_damping"):
            set_field(self, name, per_joint(_OWNER, name, getattr(self, name), self.joint_names, minimum=0.0))
        set_field(
            self, "default_joint_pos", per_joint(_OWNER, "default_joint_pos", self.default_joint_pos, self.joint_names)
        )
        set_field(self, "action_scale", per_joint(_OWNER, "action_scale", self.action_scale, self.action_joint_names))
        self._check_observation()
        self._check_action()
        set_field(self, "policy_dt", number(_OWNER, "policy_dt", self.policy_dt, above=True))
        for name in ("command_names", "body_names"):
            set_field(self, name, joint_tuple(_OWNER, getattr(self, name), name, may_be_empty=True))
        self._check_lookahead()
        self._check_command()
        set_field(self, "provenance", MappingProxyType(dict(self.provenance)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled through the constructor: a read-only mapping cannot be, and arrays would come back writable."""
        values = [getattr(self, f.name) for f in fields(self)]
        return type(self), (*values[:-1], dict(self.provenance))

    def _check_observation(self) -> None:
        if isinstance(self.observation, str) or not isinstance(self.observation, Iterable):
            raise FieldError(f"{_OWNER}.observation: is {self.observation!r}, expected a sequence of terms")
        terms = tuple(term if isinstance(term, Term) else Term(term) for term in self.observation)
        joint_tuple(_OWNER, [term.name for term in terms], "observation")
        for term in terms:
            strangers = [joint for joint in term.joints or () if joint not in self.joint_names]
            if strangers:
                raise FieldError(
                    f"{_OWNER}.observation: term '{term.name}' shows {', '.join(strangers)}, not in joint_names"
                )
        object.__setattr__(self, "observation", terms)
        if self.history_layout not in get_args(HistoryLayout):
            accepted = ", ".join(get_args(HistoryLayout))
            raise FieldError(f"{_OWNER}.history_layout: is {self.history_layout!r}, expected one of {accepted}")
        lengths = sorted({term.history for term in terms})
        if self.history_layout == "per_step" and len(lengths) > 1:
            raise FieldError(f"{_OWNER}.history_layout: per_step needs one history for all terms, they have {lengths}")
        if self.reference_quaternion not in get_args(QuaternionOrder):
            raise FieldError(
                f"{_OWNER}.reference_quaternion: is {self.reference_quaternion!r}, "
                f"expected one of {', '.join(get_args(QuaternionOrder))}"
            )

    def _check_action(self) -> None:
        offset = self.action_offset
        if offset is None:
            driven = [self.joint_names.index(name) for name in self.action_joint_names]
            offset = self.default_joint_pos[driven]
        set_field = object.__setattr__
        set_field(self, "action_offset", per_joint(_OWNER, "action_offset", offset, self.action_joint_names))
        clip = self.action_clip
        if isinstance(clip, bool) or not isinstance(clip, int | float | np.floating) or not clip > 0.0:
            raise FieldError(f"{_OWNER}.action_clip: is {clip!r}, expected a number > 0")
        set_field(self, "action_clip", float(clip))
        if self.position_clip is not None:
            limits = frozen_array(_OWNER, "position_clip", self.position_clip)
            count = len(self.action_joint_names)
            if limits.shape not in ((1, 2), (count, 2)) or not (limits[:, 0] <= limits[:, 1]).all():
                raise FieldError(
                    f"{_OWNER}.position_clip: is {limits.tolist()}, expected [least, greatest] for each of "
                    f"{count} action joints, or one for all"
                )
            set_field(self, "position_clip", frozen_array(_OWNER, "position_clip", np.broadcast_to(limits, (count, 2))))

    def _check_command(self) -> None:
        if self.command_ranges is None:
            return
        ranges = frozen_array(_OWNER, "command_ranges", self.command_ranges)
        if ranges.shape != (3, 2) or not (ranges[:, 0] <= ranges[:, 1]).all():
            raise FieldError(
                f"{_OWNER}.command_ranges: is {ranges.tolist()}, expected [least, greatest] for vx, vy and yaw rate"
            )
        object.__setattr__(self, "command_ranges", ranges)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The observation terms, in order, every one written out."""
        return tuple(term for term in self.observation if isinstance(term, Term))

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of the observation terms, in order."""
        return tuple(term.name for term in self.terms)

    def _check_lookahead(self) -> None:
        if not isinstance(self.lookahead_steps, Iterable):
            raise FieldError(f"{_OWNER}.lookahead_steps: is {self.lookahead_steps!r}, expected integers >= 0")
        steps = tuple(self.lookahead_steps)
        if any(isinstance(step, bool) or not isinstance(step, int | np.integer) or step < 0 for step in steps):
            raise FieldError(f"{_OWNER}.lookahead_steps: is {steps}, expected integers >= 0")
        if "target_keys_future" in self.observation_names and not steps:
            raise FieldError(f"{_OWNER}.lookahead_steps: is empty, but the observation has target_keys_future")
        object.__setattr__(self, "lookahead_steps", tuple(int(step) for step in steps))

    @property
    def action_count(self) -> int:
        """m, the width of the action."""
        return len(self.action_joint_names)
