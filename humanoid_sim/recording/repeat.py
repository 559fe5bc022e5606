"""Repeats a recorded run: its inputs through the same supervisor, with the recorded actions in the policy's place.

Nothing else enters a tick, so the outputs must be the recorded ones, bit for bit, on any machine: NaN equals NaN of the
same bits, 0.0 is not -0.0.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import Event, EventKind, SessionHeader, TickOutput, TickRecord
from humanoid_sim.recording.reader import Recording
from humanoid_sim.stack import rebuild_supervisor


@dataclass(frozen=True, slots=True)
class Difference:
    """One value that differs from the recorded one."""

    field: str  # of `TickOutput`, such as `command.position`
    where: str  # the joint, or the index; empty for a field without parts
    recorded: str
    replayed: str


def first_difference(header: SessionHeader, recorded: TickOutput, replayed: TickOutput) -> Difference | None:
    """Return the first field that differs, causes before consequences; None if the outputs are identical."""
    names = "policy_step", "faults", "policy_error", "refusals", "control_mode", "command", "standby", "quit"
    for name in names:
        found = _difference(header, name, getattr(recorded, name), getattr(replayed, name))
        if found is not None:
            return found
    return None


def _difference(header: SessionHeader, name: str, recorded: Any, replayed: Any) -> Difference | None:
    if isinstance(recorded, np.ndarray):
        return _of_arrays(header, name, recorded, replayed)
    if isinstance(recorded, float):
        return _of_arrays(header, name, np.array([recorded]), np.array([replayed]))
    if name in ("policy_step", "control_mode", "command", "standby"):
        if recorded is None or replayed is None:
            texts = ["none" if value is None else "one" for value in (recorded, replayed)]
            return None if texts[0] == texts[1] else Difference(name, "", *texts)
        parts = (
            _difference(header, f"{name}.{part.name}", getattr(recorded, part.name), getattr(replayed, part.name))
            for part in fields(recorded)
        )
        return next((part for part in parts if part is not None), None)
    return None if recorded == replayed else Difference(name, "", repr(recorded), repr(replayed))


def _of_arrays(
    header: SessionHeader, name: str, recorded: npt.NDArray[Any], replayed: npt.NDArray[Any]
) -> Difference | None:
    if recorded.shape != replayed.shape:
        return Difference(name, "", f"shape {recorded.shape}", f"shape {replayed.shape}")
    if recorded.tobytes() == replayed.tobytes():
        return None
    before, now = recorded.reshape(-1), replayed.reshape(-1)
    index = next(i for i in range(len(before)) if before[i].tobytes() != now[i].tobytes())
    labels = list(header.joint_names) if name.startswith("command.") else []
    if name == "policy_step.observation":
        labels = [f"{term}[{i}]" for term, width in header.observation_terms for i in range(width)]
    where = labels[index] if index < len(labels) else f"[{index}]"
    texts = [str(values[index]) for values in (before, now)]
    if texts[0] == texts[1]:  # the digits hide the last bits
        texts = [f"{values[index]} (bits 0x{values[index].tobytes()[::-1].hex()})" for values in (before, now)]
    return Difference(name, where, *texts)


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

    ticks: int = 0
    """Ticks repeated and found identical."""
    difference: Difference | None = None
    tick: int | None = None
    """Index of the tick that differs, or before which ticks are missing."""
    time: float | None = None
    """s, robot's clock, of that tick."""
    missing: int = 0
    """Ticks missing from the recording before `tick`: nothing after them is repeated."""
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
    report = repeat_entries(recording.header, stack, policy, recording.entries())
    report.complete, report.damage = recording.is_complete, recording.damage
    return report


def repeat_entries(
    header: SessionHeader, stack: Supervisor, policy: RecordedPolicy, entries: Iterable[TickRecord | Event]
) -> RepeatReport:
    """Repeat ticks and events through a stack whose policy is `policy`."""
    report, memory, is_fresh = RepeatReport(), stack.initial(), False
    for record in entries:
        if not isinstance(record, TickRecord):
            is_fresh = is_fresh or record.kind is EventKind.FRESH_START
            continue
        if is_fresh:
            memory, is_fresh = stack.initial(record.output.control_mode.status_message), False
        report.missing = record.index - report.ticks
        if not report.missing:
            policy.output = record.output
            memory, output = stack.step(memory, record.input)
            report.difference = first_difference(header, record.output, output)
        if report.missing or report.difference is not None:
            report.tick, report.time = record.index, float(record.input.state.time)
            break
        report.ticks += 1
    return report
