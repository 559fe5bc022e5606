"""Figures of a run, condensed while it runs: modes, tick times, faults, tracking; in constant memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from humanoid_sim.controllers.fsm import describe_safety, merge_safety
from humanoid_sim.evaluation.failure import has_run_away
from humanoid_sim.evaluation.run_figures import BaseMotion, JointUse
from humanoid_sim.messages import Event, EventKind, Mode, SafetyStatus, TickRecord
from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.recording.summary import ModeSpan
from humanoid_sim.session.pace import DurationHistogram
from humanoid_sim.session.sinks import WorkerSink
from humanoid_sim.simulation.floating_base import BaseObserver

_KEPT = 1000
"""Mode spans, faults, refusals and safety statuses beyond this many are counted but not kept."""


Tracker: TypeAlias = Callable[[int, MITState], None]
"""Compares the state of a policy step with the frame that the policy was shown."""


class RunMonitor(WorkerSink):
    """A sink that keeps the figures of the final table."""

    def __init__(
        self,
        joints: JointUse,
        tracker: Tracker | None = None,
        *,
        base: BaseObserver | None = None,
        tell: Callable[[Event], None] = lambda _: None,
    ) -> None:
        """Start empty.

        Args:
            tracker: gets the states of every policy step.
            base: sees the floating base of a simulated robot, which is free in LOCOMOTION and REMOTE; None for none.
            tell: is told of a fall when it happens, on this sink's thread.
        """
        super().__init__("monitor")
        self.joints = joints
        self._tracker = tracker
        self.base = None if base is None else BaseMotion()
        self._observer = base
        self._tell = tell
        self.spans: list[ModeSpan] = []
        self.faults: list[tuple[float, str]] = []
        self.safety: list[tuple[float, str]] = []
        """Each change to a safety status that is not OK."""
        self.refusals: list[tuple[float, str]] = []
        self.dropped = 0
        """Spans, faults, refusals and safety statuses that were not kept."""
        self.inferences = 0
        self.tick_time = DurationHistogram()
        self._span: ModeSpan | None = None
        self._safety = ""
        self.pose: FloatArray | None = None
        """Shape (nq,), the last pose in the most interesting mode that was reached, for a picture."""
        self._pose_rank = -1

    def handle_tick(self, record: TickRecord) -> None:
        """Take one tick into account."""
        state, output = record.input.state, record.output
        time = float(state.time)
        self.tick_time.add(record.duration)
        self.joints.update(state)
        control = output.control_mode
        if self._span is None or self._span.controller != control.controller_name:
            self._span = ModeSpan(control.mode, control.controller_name, control.status_message, time, time)
            self._keep(self.spans, self._span)
        else:
            self._span.end = time
            self._span.ticks += 1
        self._note_safety(time, record.input.safety)
        rank = min(int(control.mode), Mode.LOCOMOTION)
        if record.qpos is not None and rank >= self._pose_rank:
            self.pose, self._pose_rank = record.qpos, rank
        for fault in output.faults:
            self._keep(self.faults, (time, f"{fault.controller}: {fault.message}"))
        for refusal in output.refusals:
            self._keep(self.refusals, (time, refusal))
        if output.policy_step is not None:
            self.inferences += 1
            if self._tracker is not None:
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
        if all(status.is_ok for status in statuses):
            self._safety = ""
            return
        text = describe_safety(merge_safety(statuses))
        if text != self._safety:
            self._keep(self.safety, (time, text))
        self._safety = text

    def _keep(self, items: list[Any], item: Any) -> None:
        if len(items) < _KEPT:
            items.append(item)
        else:
            self.dropped += 1
