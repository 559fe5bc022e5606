"""Repeats a recorded run: its inputs through the same supervisor, with the recorded actions in the policy's place.

Nothing else enters a tick, so the outputs must be the recorded ones, bit for bit, on any machine: NaN equals NaN of the
same bits, 0.0 is not -0.0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.messages import Event, EventKind, SessionHeader, TickOutput
from humanoid_sim.recording.reader import Recording
from humanoid_sim.stack import rebuild_supervisor

_CAUSES_FIRST = (
    "policy_step", "faults", "policy_error", "refusals", "control_mode", "command", "standby", "quit"
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Difference:
    """One value that differs from the recorded one."""

    field: str  # of `TickOutput`, such as `command.position`
    where: str  # the joint, or the index; empty for a field without parts
    recorded: str
    replayed: str


def first_difference(header: SessionHeader, recorded: TickOutput, replayed: TickOutput) -> Difference | None:
    """Return the first field that differs, causes before consequences; None if the outputs are identical."""
    for field in _CAUSES_FIRST:
        pairs = zip(_leaves(field, getattr(recorded, field)), _leaves(field, getattr(replayed, field)), strict=False)
        for (name, before), (_, now) in pairs:
            if not isinstance(before, np.ndarray) or not isinstance(now, np.ndarray):
                if type(before) is not type(now) or before != now:
                    return Difference(name, "", repr(before), repr(now))
            elif before.shape != now.shape:
                return Difference(name, "", f"shape {before.shape}", f"shape {now.shape}")
            elif before.tobytes() != now.tobytes():
                rows = enumerate(zip(before.ravel(), now.ravel(), strict=True))
                index, (old, new) = next(row for row in rows if row[1][0].tobytes() != row[1][1].tobytes())
                return Difference(name, _part(header, name, index), str(old), str(new))
    return None


def _leaves(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield a field, or the fields of a part, by name; numbers with a fraction as arrays, whose bits count."""
    if is_dataclass(value):
        for part in fields(value):
            yield from _leaves(f"{name}.{part.name}", getattr(value, part.name))
    else:
        yield name, np.array(value) if isinstance(value, float) else value


def _part(header: SessionHeader, name: str, index: int) -> str:
    """Return the name of one number of a field."""
    labels: list[str] = []
    if name.startswith("command."):
        labels = list(header.joint_names)
    elif name == "policy_step.observation":
        labels = [f"{term}[{i}]" for term, width in header.observation_terms for i in range(width)]
    return labels[index] if index < len(labels) else f"[{index}]"


class RecordedPolicy:
    """Stands in for the policy: answers what it answered then, and fails where it failed then."""

    output: TickOutput | None = None  # the recorded one of the tick that comes next

    def __call__(self, observation: npt.NDArray[np.float32], frame: int) -> npt.NDArray[np.float32]:
        """Return the recorded action. Raises `RuntimeError`, with the recorded reason, if there was none."""
        if self.output is not None and self.output.policy_step is not None:
            return self.output.policy_step.action
        error = None if self.output is None else self.output.policy_error
        raise RuntimeError(error or "the recording has no policy step in this tick")


@dataclass(slots=True)
class RepeatReport:
    """Result of repeating a run."""

    ticks: int = 0  # repeated and found identical
    difference: Difference | None = None
    tick: int | None = None  # index of the tick that differs, or before which ticks are missing
    time: float | None = None  # s, robot's clock, of that tick
    missing: int = 0  # ticks missing from the recording before `tick`: nothing after them is repeated
    complete: bool = False
    damage: str = ""

    @property
    def is_identical(self) -> bool:
        """True if there are ticks, none is missing up to the recording's end, and all are repeated bit for bit."""
        is_sound = self.complete or self.damage.startswith("cut")
        return self.ticks > 0 and self.difference is None and not self.missing and is_sound


def repeat_run(recording: Recording) -> RepeatReport:
    """Repeat a run up to its end, the first difference or the first missing tick.

    Where an operator had the robot reactivated, the control stack begins again as it did then. Raises `InputError` if
    the recording cannot be read, or its header does not describe a control stack.
    """
    policy = RecordedPolicy()
    stack = rebuild_supervisor(recording.header, policy)
    report, memory, is_fresh = RepeatReport(), stack.initial(), False
    for record in recording.entries():
        if isinstance(record, Event):
            is_fresh = is_fresh or record.kind is EventKind.FRESH_START
            continue
        if is_fresh:
            memory, is_fresh = stack.initial(record.output.control_mode.status_message), False
        report.missing = record.index - report.ticks
        if not report.missing:
            policy.output = record.output
            memory, output = stack.step(memory, record.input)
            report.difference = first_difference(recording.header, record.output, output)
        if report.missing or report.difference is not None:
            report.tick, report.time = record.index, float(record.input.state.time)
            break
        report.ticks += 1
    report.complete, report.damage = recording.is_complete, recording.damage
    return report
