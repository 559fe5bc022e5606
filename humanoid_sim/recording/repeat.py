"""Repeats a recorded run: its inputs through the same supervisor, with the recorded actions in the policy's place.

Nothing else enters a tick, so the outputs must be the recorded ones, bit for bit, on any machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from humanoid_sim.messages import EventKind, PolicyStep, SessionHeader, TickInput, TickOutput, TickRecord
from humanoid_sim.recording.difference import Difference, first_difference
from humanoid_sim.recording.reader import Entry, Recording

__all__ = ["ControlStack", "InferenceReport", "RecordedPolicy", "RepeatReport", "StackBuilder", "repeat_run"]

Policy = Callable[[npt.NDArray[np.float32], int], npt.ArrayLike]
"""`(observation of shape (N,), frame) -> action of shape (M,)`."""


class ControlStack(Protocol):
    """What of a `Supervisor` is needed here."""

    def initial(self) -> Any:
        """The memory before the first tick."""

    def step(self, memory: Any, tick_input: TickInput, /) -> tuple[Any, TickOutput]:
        """One tick."""


StackBuilder = Callable[[SessionHeader, Policy], ControlStack]
"""Makes the control stack of a recorded run again, around another policy."""


class RecordedPolicy:
    """Stands in for the policy: answers what it answered then, and fails where it failed then."""

    def __init__(self) -> None:
        """Begin without an answer."""
        self._output: TickOutput | None = None

    def expect(self, output: TickOutput) -> None:
        """Set the recorded output of the tick that comes next."""
        self._output = output

    def __call__(self, observation: npt.NDArray[np.float32], frame: int) -> npt.NDArray[np.float32]:
        """The recorded action.

        Raises:
            RuntimeError: if the policy gave none in this tick; with the recorded reason.
        """
        if self._output is not None:
            if self._output.policy_step is not None:
                return self._output.policy_step.action
            if self._output.policy_error is not None:
                raise RuntimeError(self._output.policy_error)
        raise RuntimeError("the recording has no policy step in this tick")


@dataclass(slots=True)
class InferenceReport:
    """How a model's answers to the recorded observations compare with the recorded actions."""

    steps: int = 0
    differing: int = 0
    """Steps with any bit different."""
    max_difference: float = 0.0
    """Largest difference of an action that is finite in both."""
    first_tick: int | None = None
    first_time: float | None = None
    """s, robot's clock."""
    first_frame: int | None = None

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
        if action.shape == step.action.shape:
            difference = np.abs(action.astype(np.float64) - step.action)
            finite = difference[np.isfinite(difference)]
            self.max_difference = max(self.max_difference, float(finite.max(initial=0.0)))


@dataclass(slots=True)
class RepeatReport:
    """What repeating a run showed."""

    ticks: int = 0
    """Ticks repeated and found identical."""
    difference: Difference | None = None
    tick: int | None = None
    """Index of the tick that differs, or before which ticks are missing."""
    time: float | None = None
    """s, robot's clock, of that tick."""
    gap: int = 0
    """Ticks missing from the recording before `tick`: nothing after them can be repeated."""

    @property
    def is_identical(self) -> bool:
        """Every tick that was run is in the recording up to its end, and is repeated bit for bit."""
        return self.difference is None and not self.gap


def repeat_run(
    recording: Recording,
    build: StackBuilder,
    infer: Callable[[TickRecord, PolicyStep], None] | None = None,
    entries: Iterator[Entry] | None = None,
) -> RepeatReport:
    """Repeat a run up to its end or the first difference.

    Where an operator had the robot reactivated, the control stack begins again as it did then.

    Args:
        recording: the run.
        build: makes its control stack.
        infer: called for every policy step that is reached.
        entries: the recording's, if the caller wants to see them pass; read from it otherwise.

    Raises:
        InputError: if the recording cannot be read, or its header does not describe a control stack.
    """
    policy = RecordedPolicy()
    stack = build(recording.header, policy)
    memory = stack.initial()
    report = RepeatReport()
    for record in recording.entries() if entries is None else entries:
        if not isinstance(record, TickRecord):
            memory = stack.initial() if record.kind is EventKind.FRESH_START else memory
            continue
        if record.index != report.ticks:
            report.gap = record.index - report.ticks
        else:
            policy.expect(record.output)
            memory, output = stack.step(memory, record.input)
            report.difference = first_difference(recording.header, record.output, output)
        if not report.is_identical:
            report.tick, report.time = record.index, float(record.input.state.time)
            break
        report.ticks += 1
        step = record.output.policy_step
        if infer is not None and step is not None:
            infer(record, step)
    return report
