"""Figures of a run, condensed while it runs: modes, tick times, faults, tracking; in constant memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TypeAlias

from humanoid_sim.controllers.fsm import describe_safety, merge_safety
from humanoid_sim.evaluation.failure import has_run_away
from humanoid_sim.evaluation.run_figures import BaseMotion, JointUse
from humanoid_sim.messages import Event, EventKind, SafetyStatus, TickRecord
from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.recording.summary import ModeSpan
from humanoid_sim.session.pace import DurationHistogram
from humanoid_sim.session.sinks import WorkerSink
from humanoid_sim.simulation.floating_base import BaseObserver

_KEPT = 1000  # newest mode spans, faults, refusals and safety statuses

Tracker: TypeAlias = Callable[[int, MITState], None]
"""Compares the state of a policy step with the frame that the policy was shown."""


class RunMonitor(WorkerSink):
    """A sink that keeps the figures of the final table."""

    def __init__(
        self,
        joints: JointUse,
        tracker: Tracker = lambda _frame, _state: None,
        *,
        base: BaseObserver | None = None,
        tell: Callable[[Event], None] = lambda _: None,
    ) -> None:
        """Start empty.

        Args:
            base: sees the floating base of a simulated robot, which is free in LOCOMOTION and REMOTE; None for none.
            tell: gets a fall when it happens, on this sink's thread.
        """
        super().__init__("monitor")
        self.joints = joints
        self._tracker = tracker
        self.base = None if base is None else BaseMotion()
        self._observer = base
        self._tell = tell
        self.spans: deque[ModeSpan] = deque(maxlen=_KEPT)
        self.faults: deque[tuple[float, str]] = deque(maxlen=_KEPT)
        self.safety: deque[tuple[float, str]] = deque(maxlen=_KEPT)
        """Each change to a safety status that is not OK."""
        self.refusals: deque[tuple[float, str]] = deque(maxlen=_KEPT)
        self.inferences = 0
        self.tick_time = DurationHistogram()
        self._safety = ""

    def handle_tick(self, record: TickRecord) -> None:
        """Take one tick into account."""
        state, output = record.input.state, record.output
        time, control = float(state.time), output.control_mode
        self.tick_time.add(record.duration)
        self.joints.update(state)
        if not self.spans or self.spans[-1].controller != control.controller_name:
            self.spans.append(ModeSpan(control.mode, control.controller_name, control.status_message, time, time))
        else:
            self.spans[-1].end = time
            self.spans[-1].ticks += 1
        self._note_safety(time, record.input.safety)
        self.faults += [(time, f"{fault.controller}: {fault.message}") for fault in output.faults]
        self.refusals += [(time, refusal) for refusal in output.refusals]
        if output.policy_step is not None:
            self.inferences += 1
            self._tracker(output.policy_step.frame, state)
        if record.qpos is not None and control.mode.is_free:
            self._watch_base(state, record.qpos)

    def _watch_base(self, state: MITState, qpos: FloatArray) -> None:
        """Watch a tick in which the base is free; one in which the simulation breaks says nothing about the robot."""
        observer, motion, time = self._observer, self.base, float(state.time)
        if observer is None or motion is None or has_run_away(state.joint_velocity):
            return
        if motion.released is None:
            motion.release(time, observer.standing_height(qpos))
        fell = motion.update(time, observer.sensed(state, qpos))
        if fell:
            self._tell(Event(time, fell, EventKind.FALL))

    def _note_safety(self, time: float, statuses: tuple[SafetyStatus, ...]) -> None:
        is_ok = all(status.is_ok for status in statuses)
        text = "" if is_ok else describe_safety(merge_safety(statuses))
        if text and text != self._safety:
            self.safety.append((time, text))
        self._safety = text
