"""Repeats a recorded run: its inputs through the same supervisor, with the recorded actions in the policy's place.

Nothing else enters a tick, so the outputs must be the recorded ones, bit for bit, on any machine: NaN equals NaN of the
same bits, 0.0 is not -0.0.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import EventKind, PolicyStep, SessionHeader, TickOutput, TickRecord
from humanoid_sim.mit import COMMAND_FIELDS
from humanoid_sim.recording.reader import Entry, Recording

_UNSIGNED = {4: np.uint32, 8: np.uint64}


@dataclass(frozen=True, slots=True)
class Difference:
    """One value that differs from the recorded one."""

    field: str
    """Field of `TickOutput`, such as `command.position`."""
    where: str
    """The joint, or the index; empty for a field without parts."""
    recorded: str
    replayed: str

    def __str__(self) -> str:
        place = f" of {self.where}" if self.where else ""
        return f"{self.field}{place}: recorded {self.recorded}, replayed {self.replayed}"


def first_difference(header: SessionHeader, recorded: TickOutput, replayed: TickOutput) -> Difference | None:
    """Return the first field that differs, causes before consequences; None if the outputs are identical."""
    return next(_differences(header, recorded, replayed), None)


def _differences(header: SessionHeader, recorded: TickOutput, replayed: TickOutput) -> Iterator[Difference]:
    yield from _policy_steps(header, recorded.policy_step, replayed.policy_step)
    for name in ("faults", "policy_error", "refusals"):
        yield from _plain(name, getattr(recorded, name), getattr(replayed, name))
    before, now = recorded.control_mode, replayed.control_mode
    yield from _plain("control_mode.mode", before.mode.name, now.mode.name)
    for name in ("controller_name", "status_message"):
        yield from _plain(f"control_mode.{name}", getattr(before, name), getattr(now, name))
    for name in COMMAND_FIELDS:
        arrays = getattr(recorded.command, name), getattr(replayed.command, name)
        yield from _arrays(f"command.{name}", *arrays, header.joint_names)
    yield from _standby(recorded, replayed)
    yield from _plain("quit", recorded.quit, replayed.quit)


def _policy_steps(
    header: SessionHeader, recorded: PolicyStep | None, replayed: PolicyStep | None
) -> Iterator[Difference]:
    if recorded is None or replayed is None:
        yield from _plain("policy_step", _presence(recorded), _presence(replayed))
        return
    yield from _plain("policy_step.frame", recorded.frame, replayed.frame)
    labels = tuple(f"{term}[{index}]" for term, width in header.observation_terms for index in range(width))
    yield from _arrays("policy_step.observation", recorded.observation, replayed.observation, labels)
    yield from _arrays("policy_step.action", recorded.action, replayed.action, ())


def _standby(recorded: TickOutput, replayed: TickOutput) -> Iterator[Difference]:
    before, now = recorded.standby, replayed.standby
    if before is None or now is None:
        yield from _plain("standby", _presence(before), _presence(now))
        return
    for name in ("current_segment", "total_segments", "is_finished"):
        yield from _plain(f"standby.{name}", getattr(before, name), getattr(now, name))
    if struct.pack("<d", before.progress) != struct.pack("<d", now.progress):
        yield Difference("standby.progress", "", *_shown(np.float64(before.progress), np.float64(now.progress)))


def _presence(value: object) -> str:
    return "none" if value is None else "one"


def _plain(field: str, recorded: object, replayed: object) -> Iterator[Difference]:
    """Values whose equality is exact: texts, integers, records of these."""
    if recorded != replayed:
        yield Difference(field, "", repr(recorded), repr(replayed))


def _arrays(
    field: str, recorded: npt.NDArray[Any], replayed: npt.NDArray[Any], labels: tuple[str, ...]
) -> Iterator[Difference]:
    if recorded.shape != replayed.shape:
        yield Difference(field, "", f"shape {recorded.shape}", f"shape {replayed.shape}")
    elif recorded.tobytes() != replayed.tobytes():
        bits = _UNSIGNED[recorded.itemsize]
        before, now = (np.ascontiguousarray(array).reshape(-1) for array in (recorded, replayed))
        index = int(np.argmax(before.view(bits) != now.view(bits)))
        where = labels[index] if index < len(labels) else f"[{index}]"
        yield Difference(field, where, *_shown(before[index], now[index]))


def _shown(recorded: np.floating[Any], replayed: np.floating[Any]) -> tuple[str, str]:
    """Both values, with their bits where the digits are the same."""
    texts = str(recorded), str(replayed)
    if texts[0] != texts[1]:
        return texts
    return f"{texts[0]} (bits {_bits(recorded)})", f"{texts[1]} (bits {_bits(replayed)})"


def _bits(value: np.floating[Any]) -> str:
    return f"0x{value.tobytes()[::-1].hex()}"


Policy = Callable[[npt.NDArray[np.float32], int], npt.ArrayLike]
"""`(observation of shape (N,), frame) -> action of shape (M,)`."""


StackBuilder = Callable[[SessionHeader, Policy], Supervisor]
"""Makes the control stack of a recorded run again, around another policy."""


class RecordedPolicy:
    """Stands in for the policy: answers what it answered then, and fails where it failed then."""

    _output: TickOutput | None = None

    def expect(self, output: TickOutput) -> None:
        """Set the recorded output of the tick that comes next."""
        self._output = output

    def __call__(self, observation: npt.NDArray[np.float32], frame: int) -> npt.NDArray[np.float32]:
        """Return the recorded action. Raises `RuntimeError`, with the recorded reason, if there was none."""
        if self._output is not None:
            if self._output.policy_step is not None:
                return self._output.policy_step.action
            if self._output.policy_error is not None:
                raise RuntimeError(self._output.policy_error)
        raise RuntimeError("the recording has no policy step in this tick")


@dataclass(slots=True)
class InferenceReport:
    """Comparison of a model's answers to the recorded observations with the recorded actions."""

    tolerance: float = 0.0
    """Largest difference that still counts as the same answer: absolute up to an action of 1, relative beyond."""
    steps: int = 0
    differing: int = 0
    """Steps with any bit different."""
    beyond: int = 0
    """Steps whose difference is beyond the tolerance, is not finite, or is one of shape."""
    max_difference: float = 0.0
    """Largest difference of an action that is finite in both."""
    first_tick: int | None = None
    first_time: float | None = None
    """s, robot's clock."""
    first_frame: int | None = None

    @property
    def is_same(self) -> bool:
        """There were steps to compare, and every answer is the recorded one within the tolerance."""
        return self.steps > 0 and not self.beyond

    def add(self, record: TickRecord, step: PolicyStep, answer: npt.ArrayLike) -> None:
        """Compare one answer."""
        action = np.asarray(answer, dtype=np.float32)
        self.steps += 1
        if action.shape == step.action.shape and action.tobytes() == step.action.tobytes():
            return
        self.differing += 1
        if self.first_tick is None:
            self.first_tick, self.first_time = record.index, float(record.input.state.time)
            self.first_frame = step.frame
        if action.shape != step.action.shape:
            self.beyond += 1
            return
        recorded, now = step.action.astype(np.float64), action.astype(np.float64)
        with np.errstate(invalid="ignore"):
            difference = np.where(np.isnan(recorded) & np.isnan(now) | (recorded == now), 0.0, np.abs(now - recorded))
            allowed = self.tolerance * np.maximum(np.abs(recorded), 1.0)
        self.beyond += not (difference <= allowed).all()
        finite = difference[np.isfinite(difference)]
        self.max_difference = max(self.max_difference, float(finite.max(initial=0.0)))


@dataclass(slots=True)
class RepeatReport:
    """Result of repeating a run."""

    ticks: int = 0
    """Ticks repeated and found identical."""
    difference: Difference | None = None
    tick: int | None = None
    """Index of the tick that differs, or before which ticks are missing."""
    time: float | None = None
    """s, robot's clock, of that tick."""
    gap: int = 0
    """Ticks missing from the recording before `tick`: nothing after them can be repeated."""
    unrepeated: int = 0
    """Ticks of the recording after that gap."""
    missing: int = 0
    """All ticks that are known to be missing, wherever they were; not counted behind a difference."""
    is_damaged: bool = False
    """Something in the file cannot be read, other than an end that is missing."""

    @property
    def can_continue(self) -> bool:
        """No tick differs so far, and none is missing."""
        return self.difference is None and not self.gap

    @property
    def is_identical(self) -> bool:
        """There are ticks, none is missing up to the recording's end, and all are repeated bit for bit."""
        return self.can_continue and self.ticks > 0 and not self.missing and not self.is_damaged


def repeat_run(
    recording: Recording,
    build: StackBuilder,
    infer: Callable[[TickRecord, PolicyStep], None] | None = None,
    entries: Iterator[Entry] | None = None,
) -> RepeatReport:
    """Repeat a run up to its end or the first difference; ticks behind a gap are only counted.

    Where an operator had the robot reactivated, the control stack begins again as it did then. Raises `InputError` if
    the recording cannot be read, or its header does not describe a control stack.

    `infer` is called for every policy step that is reached. `entries` are the recording's, for a
    caller who wants to see them pass.
    """
    policy = RecordedPolicy()
    header = recording.header
    stack = build(header, policy)
    memory = stack.initial()
    report = RepeatReport()
    following = 0
    is_fresh = False
    for record in recording.entries() if entries is None else entries:
        if not isinstance(record, TickRecord):
            is_fresh = is_fresh or (report.can_continue and record.kind is EventKind.FRESH_START)
            continue
        if is_fresh:
            memory, is_fresh = stack.initial(record.output.control_mode.status_message), False
        if record.index < following:
            report.difference = Difference("index", "", f"{record.index}, after {following - 1}", f"{following}")
        elif report.can_continue and record.index > following:
            report.gap = record.index - following
        elif report.can_continue:
            policy.expect(record.output)
            memory, output = stack.step(memory, record.input)
            report.difference = first_difference(header, record.output, output)
        if not report.can_continue and report.tick is None:
            report.tick, report.time = record.index, float(record.input.state.time)
        if report.difference is not None:
            return report
        report.missing += record.index - following
        following = record.index + 1
        if report.gap:
            report.unrepeated += 1
            continue
        report.ticks += 1
        step = record.output.policy_step
        if infer is not None and step is not None:
            infer(record, step)
    report.is_damaged = recording.is_damaged
    return report
