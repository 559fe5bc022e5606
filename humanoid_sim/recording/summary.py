"""Summary of a recorded run, made in one pass over the file."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.run_figures import JointUse
from humanoid_sim.messages import Event, EventKind, Mode, SafetyStatus, TickRecord
from humanoid_sim.recording.reader import Recording, TopicCount
from humanoid_sim.robots.description import RobotDescription


@dataclass(slots=True)
class ModeSpan:
    """A stretch of a run in which one controller was in control."""

    mode: Mode
    controller: str
    reason: str
    """The status message with which it began."""
    start: float
    """s, robot's clock."""
    end: float
    """s, robot's clock, of its last tick."""
    ticks: int = 1


@dataclass(frozen=True, slots=True)
class Remark:
    """Something said at a time: an event, a refusal, a fault, a change of a safety status."""

    time: float
    """s, robot's clock."""
    kind: str
    text: str


@dataclass(slots=True)
class Summary:
    """The figures of one recording."""

    recording: Recording
    ticks: int = 0
    missing: int = 0
    """Ticks that are known to be missing: later ones are there."""
    first_time: float = math.nan
    """s, robot's clock."""
    last_time: float = math.nan
    overruns: int = 0
    policy_steps: int = 0
    mean_duration: float = 0.0
    """s of wall time per tick."""
    max_duration: float = 0.0
    timeline: list[ModeSpan] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    topics: dict[str, TopicCount] = field(default_factory=dict)
    joints: JointUse | None = None
    """None where the recording does not say what robot it is of."""

    @property
    def duration(self) -> float:
        """Time from the first tick to the last, s on the robot's clock."""
        return self.last_time - self.first_time if self.ticks else 0.0

    @property
    def started(self) -> str:
        """Return when the run began: ISO 8601, UTC."""
        try:
            return datetime.fromtimestamp(self.recording.header.start_time_ns // 10**9, UTC).isoformat()
        except (OverflowError, ValueError, OSError):
            return f"{self.recording.header.start_time_ns} ns"

    def as_json(self) -> dict[str, Any]:
        """Return the figures as JSON values; times that are no finite numbers are null."""
        header = self.recording.header
        return {
            "file": str(self.recording.path),
            "bytes": self.recording.size,
            "complete": self.recording.is_complete,
            "damage": self.recording.damage,
            "robot": header.robot,
            "joint_names": list(header.joint_names),
            "control_period": header.control_period,
            "started": self.started,
            "ticks": self.ticks,
            "missing_ticks": self.missing,
            "duration": _finite(self.duration),
            "overruns": self.overruns,
            "policy_steps": self.policy_steps,
            "tick_seconds": {"mean": _finite(self.mean_duration), "max": _finite(self.max_duration)},
            "timeline": [
                {
                    "mode": span.mode.name,
                    "controller": span.controller,
                    "start": _finite(span.start),
                    "end": _finite(span.end),
                    "ticks": span.ticks,
                    "reason": span.reason,
                }
                for span in self.timeline
            ],
            "words": [{"time": _finite(said.time), "kind": said.kind, "text": said.text} for said in self.remarks],
            "effort": None if self.joints is None else self.joints.effort(),
            "joints": None if self.joints is None else self.joints.rows(),
            "topics": {name: {"type": topic.schema, "messages": topic.messages} for name, topic in self.topics.items()},
            "observation_terms": [list(term) for term in header.observation_terms],
            "documents": dict(header.documents),
            "attachments": {name: len(data) for name, data in header.attachments.items()},
        }


def summarize(recording: Recording) -> Summary:
    """Read a recording to its end. Raises as `Recording.entries` does."""
    summary = Summary(recording, joints=_joints(recording))
    safety: dict[str, SafetyStatus] = {}
    for entry in recording.entries():
        if isinstance(entry, Event):
            summary.remarks.append(Remark(entry.time, "fall" if entry.kind is EventKind.FALL else "event", entry.text))
        else:
            _add_tick(summary, entry, safety)
    if summary.ticks:
        summary.mean_duration /= summary.ticks
    summary.topics = recording.topics
    return summary


def _joints(recording: Recording) -> JointUse | None:
    try:
        robot = RobotDescription.from_json(recording.header.documents["robot"])
    except (KeyError, InputError):
        return None
    if robot.joint_names != recording.header.joint_names:
        return None
    return JointUse(robot.joint_names, robot.effort_limit, robot.lower, robot.upper)


def _add_tick(summary: Summary, record: TickRecord, safety: dict[str, SafetyStatus]) -> None:
    time, output = float(record.input.state.time), record.output
    if not summary.ticks:
        summary.first_time = time
    summary.missing = record.index - summary.ticks
    summary.ticks += 1
    summary.last_time = time
    summary.overruns += record.overrun
    if summary.joints is not None:
        summary.joints.update(record.input.state)
    summary.policy_steps += output.policy_step is not None
    summary.mean_duration += record.duration
    summary.max_duration = max(summary.max_duration, record.duration)
    for status in record.input.safety:
        before = safety.get(status.source)
        if status != before and (before is not None or not status.is_ok):
            flags = f" {status.flags.name}" if status.flags else ""
            text = f"{status.source}: {status.level.name}{flags} {status.message}".rstrip()
            summary.remarks.append(Remark(time, "safety", text))
        safety[status.source] = status
    for fault in output.faults:
        text = f"{fault.controller} -> {fault.fallback}: {fault.message}"
        summary.remarks.append(Remark(time, "bug" if fault.is_bug else "fault", text))
    summary.remarks += [Remark(time, "refused", text) for text in output.refusals]
    control = output.control_mode
    last = summary.timeline[-1] if summary.timeline else None
    if last is None or last.controller != control.controller_name:
        summary.timeline.append(ModeSpan(control.mode, control.controller_name, control.status_message, time, time))
    else:
        last.end = time
        last.ticks += 1


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
