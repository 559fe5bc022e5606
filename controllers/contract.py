"""Contract of a checkpoint: all that it needs to run, in one frozen struct, whatever file it came from.

The annotations of its fields are the one table of them: the checks at construction go by it, and so does whatever reads
a contract from a file, writes it, or shows it. A new field is one line here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_type_hints

import numpy as np

from humanoid_sim.controllers.parameters import joint_tuple, number, per_joint
from humanoid_sim.controllers.term_kinds import TERM_KINDS, TermKind, live_kind, term_kind
from humanoid_sim.controllers.terms import HeightScan, QuaternionOrder, Term
from humanoid_sim.errors import FieldError
from humanoid_sim.mit import (
    BASE,
    EXTERN_WIDTHS,
    HEIGHT_SCAN,
    VELOCITY_COMMAND,
    FloatArray,
    frozen_array,
    point_velocity,
)

TaskType = Literal["tracking", "piano", "locomotion"]
HistoryLayout = Literal["per_term", "per_step"]
ModelDamping = Literal["undecided", "keep", "drop"]
Speed = Literal["command", "planar", "forward"]
JOINT_LIMITS = "joint_limits"

_OWNER = "PolicyContract"


@dataclass(frozen=True, slots=True)
class Form:
    """Form of a field of the contract: the values that it holds, and whether a source has to state it."""

    kind: Literal[
        "choice", "names", "text", "flag", "number", "limit", "values", "limits", "pairs", "steps", "axes", "structure"
    ]
    """`limit`: a number that may be infinite; `values`: one number for each joint; `limits`: one limit for each joint;
    `pairs`: least and greatest for each joint; `axes`: pairs for vx, vy and yaw rate; `steps`: whole numbers;
    `structure`: fields of its own."""
    joints: str = ""
    """The field that names the joints: of values and pairs those in their order, of names those that may be named."""
    minimum: float = -np.inf
    """Smallest accepted value."""
    may_be_empty: bool = False
    """True if a list of names may be empty."""
    choices: tuple[str, ...] = ()
    in_metadata: bool = False
    """True if it is one of the thirteen keys of a model's metadata."""
    is_required: bool = False
    """True if some source has to state it; a kind of observation term may require another field."""
    instead: tuple[str | None, ...] = ()
    """Other accepted values."""


def _choice(choices: Any, *, in_metadata: bool = False) -> Form:
    return Form("choice", choices=get_args(choices), in_metadata=in_metadata)


def _stated_values(joints: str, minimum: float = -np.inf) -> Form:
    return Form("values", joints, minimum, in_metadata=True, is_required=True)


class LiveTopic(NamedTuple):
    """Topic on which other programs publish a live input, as `std_msgs/msg/Float32MultiArray`."""

    name: str
    timeout: float | None = None
    """s after its arrival from which a value is stale, also infinite; None: not stated."""


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

    period: float | None = None
    """s of one gait cycle; None: `frequency` says how fast it is."""
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
    frequency: FloatArray | None = None
    """Shape (p, 2), speeds that are commanded, ascending, and the gait cycles per second, Hz, at each: linear between
    them, constant beyond; None: 1 / period, whatever is commanded."""
    speed: Speed = "command"
    """Speed by which `frequency` is looked up: the magnitude of (vx, vy, yaw rate), of (vx, vy), or of vx."""

    def __post_init__(self) -> None:
        owner = "PhaseRule"
        set_field = object.__setattr__
        if (self.period is None) == (self.frequency is None):
            both = "neither is given" if self.period is None else "both are given"
            raise FieldError(f"{owner}.period: {both}, expected a period, or a frequency for each speed")
        if self.period is not None:
            set_field(self, "period", number(owner, "period", self.period, above=True))
        if self.frequency is not None:
            set_field(self, "frequency", self._checked_frequency(self.frequency))
        if self.speed not in get_args(Speed):
            raise FieldError(f"{owner}.speed: is {self.speed!r}, expected one of {', '.join(get_args(Speed))}")
        offsets = frozen_array(owner, "offsets", self.offsets)
        if offsets.ndim != 1 or not offsets.size or not np.isfinite(offsets).all():
            raise FieldError(f"{owner}.offsets: is {self.offsets}, expected one finite angle per foot")
        set_field(self, "offsets", offsets)
        set_field(self, "standing_threshold", number(owner, "standing_threshold", self.standing_threshold))
        if self.standing_value is not None:
            set_field(self, "standing_value", number(owner, "standing_value", self.standing_value, minimum=-np.inf))

    @staticmethod
    def _checked_frequency(value: Any) -> FloatArray:
        table = frozen_array("PhaseRule", "frequency", value)
        is_table = table.ndim == 2 and table.shape[1] == 2 and len(table) > 0 and bool(np.isfinite(table).all())
        if not is_table or not (np.diff(table[:, 0]) > 0.0).all() or not (table[:, 1] > 0.0).all():
            accepted = "[speed, Hz] once or more, speeds ascending, frequencies > 0"
            raise FieldError(f"PhaseRule.frequency: is {table.tolist()}, expected {accepted}")
        return table


@dataclass(frozen=True, slots=True, eq=False)
class PolicyContract:
    """Everything that a checkpoint needs to run, checked against itself.

    Every convention that differs between exporters is a field here or in `Term`, so that any wiring can be written
    down.
    """

    task_type: Annotated[TaskType, _choice(TaskType, in_metadata=True)]
    """Selects the layout of the motion reference."""
    joint_names: Annotated[tuple[str, ...], Form("names", in_metadata=True, is_required=True)]
    """The full articulation, n joints; the order of the per-joint arrays."""
    action_joint_names: Annotated[tuple[str, ...], Form("names", "joint_names", in_metadata=True)]
    """The m joints that the action drives, in its order; the others are pinned to position 0."""
    joint_stiffness: Annotated[FloatArray, _stated_values("joint_names", minimum=0.0)]
    """Shape (n,), N·m/rad."""
    joint_damping: Annotated[FloatArray, _stated_values("joint_names", minimum=0.0)]
    """Shape (n,), N·m·s/rad."""
    default_joint_pos: Annotated[FloatArray, _stated_values("joint_names")]
    """Shape (n,), rad."""
    observation: Annotated[Sequence[Term | str], Form("structure", in_metadata=True, is_required=True)]
    """The flat observation, term by term; a plain name becomes the term with its usual conventions."""
    command_names: Annotated[tuple[str, ...], Form("names", may_be_empty=True, in_metadata=True)]
    """Runtime command terms."""
    action_scale: Annotated[FloatArray, _stated_values("action_joint_names")]
    """Shape (m,) or scalar, rad per unit of action."""
    policy_dt: Annotated[float, Form("number", in_metadata=True, is_required=True)]
    """s"""
    body_names: Annotated[tuple[str, ...], Form("names", may_be_empty=True, in_metadata=True)]
    """Bodies that the motion reference describes, b of them."""
    dataset_repo_id: Annotated[str, Form("text", in_metadata=True)] = ""
    """Dataset that the default motion comes from; empty for none."""
    lookahead_steps: Annotated[tuple[int, ...], Form("steps", in_metadata=True)] = ()
    """Policy steps ahead of the present one that `target_keys_future` shows (piano)."""
    action_offset: Annotated[FloatArray | None, Form("values", "action_joint_names")] = None
    """Shape (m,) or scalar, rad, added to the scaled action; None: the default pose of the driven joints."""
    action_clip: Annotated[float, Form("limit")] = float("inf")
    """Magnitude at which a raw action is clipped before it is scaled."""
    action_limit: Annotated[float | None, Form("limit", instead=(None,))] = None
    """Magnitude of a raw action beyond which the policy has failed; None: `ACTION_LIMIT`."""
    position_clip: Annotated[
        FloatArray | str | None, Form("pairs", "action_joint_names", instead=(None, JOINT_LIMITS))
    ] = None
    """Shape (m, 2) or (1, 2), rad, least and greatest position that leaves as a command; None: any; `joint_limits`:
    those of the robot's joints."""
    effort_limit: Annotated[FloatArray | None, Form("limits", "joint_names", instead=(None,))] = None
    """Shape (n,) or scalar, N·m, the torques that the policy was trained with, infinite where it was not limited. A
    robot with lower limits keeps them. None: the robot's."""
    model_joint_damping: Annotated[ModelDamping, _choice(ModelDamping)] = "undecided"
    """Treatment, in simulation, of the damping that a robot's own model gives its joints: it acts in addition to
    `joint_damping`, or it is dropped. Undecided: it stays, and checks ask for a decision."""
    history_layout: Annotated[HistoryLayout, _choice(HistoryLayout)] = "per_term"
    """Order of terms that show more than one step: each term's steps together, or each step's terms together."""
    command_ranges: Annotated[FloatArray | None, Form("axes", instead=(None,))] = None
    """Shape (3, 2), the least and greatest vx, vy (m/s) and yaw rate (rad/s) that the policy knows; None: any."""
    phase: Annotated[PhaseRule | None, Form("structure")] = None
    """The gait clock of policies that observe one."""
    anchor_body: Annotated[str, Form("text")] = ""
    """The body that the reference's anchor terms compare."""
    align_reference: Annotated[bool, Form("flag")] = True
    """Lay the reference onto the robot at activation: turned to its heading, moved to where it stands."""
    reference_quaternion: Annotated[QuaternionOrder, _choice(QuaternionOrder)] = "wxyz"
    """Order in which the motion's source gives quaternions."""
    tensors: Annotated[TensorNames, Form("structure")] = field(default_factory=TensorNames)
    """Names in the model's graph."""
    provenance: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Field to the source it came from."""

    def __post_init__(self) -> None:
        for name, form in FORMS.items():
            object.__setattr__(self, name, self._checked(name, form, getattr(self, name)))
        lengths = sorted({term.history for term in self.terms})
        if self.history_layout == "per_step" and len(lengths) > 1:
            raise FieldError(f"{_OWNER}.history_layout: per_step needs one history for all terms, they have {lengths}")
        if "target_keys_future" in self.observation_names and not self.lookahead_steps:
            raise FieldError(f"{_OWNER}.lookahead_steps: is empty, but the observation has target_keys_future")
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled through the constructor: a read-only mapping cannot be, and arrays would come back writable."""
        values = [getattr(self, f.name) for f in fields(self)]
        return type(self), (*values[:-1], dict(self.provenance))

    @property
    def terms(self) -> tuple[Term, ...]:
        """The observation terms, in order, every one written out."""
        return tuple(term for term in self.observation if isinstance(term, Term))

    def kind(self, term: Term) -> TermKind:
        """Return what a term means here; `command` stands for the motion or the velocity, as `command_names` says."""
        return term_kind(term.kind, self.command_names) if term.width is None else live_kind(term.kind)

    def requires(self, field: str) -> bool:
        """Return whether the observation has a term that means nothing without this field."""
        return any(self.kind(term).requires == field for term in self.terms)

    @property
    def velocity_points(self) -> tuple[str, ...]:
        """Points of the robot beside its base whose velocity is observed: `imu`, or names of sites; each once."""
        points = [term.at for term in self.terms if "at" in self.kind(term).conventions]
        return tuple(point for point in dict.fromkeys(points) if point != BASE)

    @property
    def extern_widths(self) -> Mapping[str, int]:
        """Name and width of the live inputs that such a policy can have: of a robot in a simulation, and declared."""
        points = {point_velocity(point): 3 for point in self.velocity_points}
        return {**EXTERN_WIDTHS, **points, **self.sent_inputs}

    @property
    def sent_inputs(self) -> Mapping[str, int]:
        """Name and width of the live inputs that a program may send: declared ones, and a height scan."""
        scan = self.height_scan
        return {**self.live_inputs, **({} if scan is None else {HEIGHT_SCAN: scan.count})}

    @property
    def height_scan(self) -> HeightScan | None:
        """The scan of the ground that is observed; None without one."""
        return next((term.height_scan for term in self.terms if _is_scan(term)), None)

    @property
    def live_inputs(self) -> Mapping[str, int]:
        """Name and width of the live inputs that terms declare, because no kind expresses them."""
        return {term.kind: term.width for term in self.terms if term.width is not None}

    @property
    def live_topics(self) -> Mapping[str, LiveTopic]:
        """Topics of the live inputs that are observed and that other programs may publish, by name."""
        return _live_topics(self.terms)

    @property
    def live_timeouts(self) -> Mapping[str, float]:
        """Timeouts that terms state, s, by the name of the live input."""
        return {name: topic.timeout for name, topic in self.live_topics.items() if topic.timeout is not None}

    @property
    def takes_velocity_command(self) -> bool:
        """Tell whether what the policy observes depends on the velocity command: as a term, or by the gait clock."""
        return self.phase is not None or any(self.kind(term).reads == VELOCITY_COMMAND for term in self.terms)

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names of the observation terms, in order."""
        return tuple(term.name for term in self.terms)

    @property
    def action_count(self) -> int:
        """m, the width of the action."""
        return len(self.action_joint_names)

    def _checked(self, name: str, form: Form, value: Any) -> Any:
        """Return the value as it is kept; the fields before it are checked already."""
        if (value is None or isinstance(value, str)) and value in form.instead:
            return value
        if form.joints or form.kind in ("names", "axes"):
            return self._checked_arrays(name, form, value)
        match form.kind:
            case "choice":
                accepted, is_right = f"one of {', '.join(form.choices)}", value in form.choices
            case "number":
                return number(_OWNER, name, value, above=True)
            case "limit":
                is_number = isinstance(value, int | float | np.floating) and not isinstance(value, bool)
                accepted, is_right = "a number > 0", is_number and value > 0.0
                value = float(value) if is_right else value
            case "steps":
                value = tuple(value) if isinstance(value, Iterable) else value
                accepted, is_right = "integers >= 0", isinstance(value, tuple) and all(map(_is_step, value))
                value = tuple(map(int, value)) if is_right else value
            case _:
                return self._checked_terms(value) if name == "observation" else value
        if not is_right:
            raise FieldError(f"{_OWNER}.{name}: is {value!r}, expected {accepted}")
        return value

    def _checked_arrays(self, name: str, form: Form, value: Any) -> Any:
        match form.kind:
            case "names":
                names = joint_tuple(_OWNER, value, name, may_be_empty=form.may_be_empty)
                strangers = [joint for joint in names if form.joints and joint not in self.joint_names]
                if strangers:
                    known = ", ".join(self.joint_names)
                    raise FieldError(f"{_OWNER}.{name}: {', '.join(strangers)} not in {form.joints}: {known}")
                return names
            case "limits":
                return self._checked_limits(name, form, value)
            case "pairs" | "axes":
                return self._checked_pairs(name, form, value)
        if value is None:  # the offset of an action that is counted from the default pose
            value = self.default_joint_pos[[self.joint_names.index(joint) for joint in self.action_joint_names]]
        return per_joint(_OWNER, name, value, getattr(self, form.joints), minimum=form.minimum)

    def _checked_limits(self, name: str, form: Form, value: Any) -> FloatArray:
        limits, joints = frozen_array(_OWNER, name, value), getattr(self, form.joints)
        if limits.shape not in ((), (len(joints),)) or not (limits > 0.0).all():
            accepted = f"a number > 0 for each of {len(joints)} joints, or one for all"
            raise FieldError(f"{_OWNER}.{name}: is {limits.tolist()}, expected {accepted}")
        return frozen_array(_OWNER, name, np.broadcast_to(limits, len(joints)))

    def _checked_pairs(self, name: str, form: Form, value: Any) -> FloatArray:
        limits = frozen_array(_OWNER, name, value)
        if form.kind == "axes":
            rows, shapes, what = 3, [(3, 2)], "vx, vy and yaw rate"
        else:
            rows = len(getattr(self, form.joints))
            shapes, what = [(1, 2), (rows, 2)], f"each of {rows} action joints, or one for all"
        if limits.shape not in shapes or not (limits[:, 0] <= limits[:, 1]).all():
            raise FieldError(f"{_OWNER}.{name}: is {limits.tolist()}, expected [least, greatest] for {what}")
        return frozen_array(_OWNER, name, np.broadcast_to(limits, (rows, 2)))

    def _checked_terms(self, value: Any) -> tuple[Term, ...]:
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise FieldError(f"{_OWNER}.observation: is {value!r}, expected a sequence of terms")
        terms = tuple(term if isinstance(term, Term) else Term(term) for term in value)
        joint_tuple(_OWNER, [term.name for term in terms], "observation")
        scans = [term for term in terms if _is_scan(term)]
        for other in scans[1:]:
            if other.height_scan != scans[0].height_scan:
                both = f"'{scans[0].name}' and '{other.name}'"
                raise FieldError(f"{_OWNER}.observation: terms {both} have different height scans, expected one")
        for term in terms:
            for option in ("width", "topic", "timeout"):
                same = [getattr(other, option) for other in terms if other.kind == term.kind]
                if same.count(same[0]) < len(same):
                    raise FieldError(
                        f"{_OWNER}.observation: live input '{term.kind}' has {option}s {same}, expected one"
                    )
            strangers = [joint for joint in term.joints or () if joint not in self.joint_names]
            if strangers:
                raise FieldError(
                    f"{_OWNER}.observation: term '{term.name}' shows {', '.join(strangers)}, not in joint_names"
                )
        owners: dict[str, str] = {}
        for name, topic in _live_topics(terms).items():
            if owners.setdefault(topic.name, name) != name:
                both = f"'{owners[topic.name]}' and '{name}'"
                raise FieldError(f"{_OWNER}.observation: live inputs {both} have the topic {topic.name}, expected two")
        return terms


def _live_topics(terms: Iterable[Term]) -> dict[str, LiveTopic]:
    kinds = ((term, live_kind(term.kind) if term.width is not None else TERM_KINDS.get(term.kind)) for term in terms)
    return {
        kind.reads: LiveTopic(term.topic or kind.topic, term.timeout)
        for term, kind in kinds
        if kind is not None and kind.topic
    }


def live_topic(contract: PolicyContract | None, name: str) -> LiveTopic | None:
    """Return the topic of a live input, observed or not; None for one that no other program publishes."""
    usual = TERM_KINDS.get(name)
    default = LiveTopic(usual.topic) if usual is not None and usual.topic else None
    return default if contract is None else contract.live_topics.get(name, default)


def _is_scan(term: Term) -> bool:
    return term.kind == HEIGHT_SCAN and term.width is None


def _is_step(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and bool(value >= 0)


FORMS: Mapping[str, Form] = MappingProxyType(
    {
        name: hint.__metadata__[0]
        for name, hint in get_type_hints(PolicyContract, include_extras=True).items()
        if hasattr(hint, "__metadata__")
    }
)
"""By the field's name, in order; all fields but the provenance."""
