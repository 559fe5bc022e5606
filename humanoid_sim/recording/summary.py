"""Summary of a recorded run, made in one pass over the file."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.run_figures import JointUse
from humanoid_sim.messages import Event, EventKind, Mode, SafetyStatus, TickRecord
from humanoid_sim.recording.reader import Recording
from humanoid_sim.robots.description import RobotDescription


@dataclass(slots=True)
class ModeSpan:
    """A stretch of a run in which one controller was in control."""

    mode: Mode
    controller: str
    reason: str  # the status message with which it began
    start: float  # s, robot's clock
    end: float  # s, robot's clock, of its last tick
    ticks: int = 1


@dataclass(frozen=True, slots=True)
class Remark:
    """Something said at a time: an event, a refusal, a fault, a change of a safety status."""

    time: float  # s, robot's clock
    kind: str
    text: str


@dataclass(slots=True)
class Summary:
    """The figures of one recording; times in s on the robot's clock, of JSON's types."""

    file: str
    robot: str
    joint_count: int
    control_period: float
    started: str  # ISO 8601, UTC
    complete: bool = False
    damage: str = ""
    ticks: int = 0
    missing_ticks: int = 0  # known to be missing: later ones are there
    overruns: int = 0
    policy_steps: int = 0
    first_time: float = 0.0
    last_time: float = 0.0
    mean_duration: float = 0.0  # s of wall time per tick
    max_duration: float = 0.0
    timeline: list[ModeSpan] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)
    effort: dict[str, Any] | None = None  # `JointUse.effort`, as the rows; None where the header has no robot
    joints: list[dict[str, Any]] = field(default_factory=list)


def summarize(recording: Recording) -> Summary:
    """Read a recording to its end. Raises as `Recording.entries` does."""
    header = recording.header
    started = datetime.fromtimestamp(header.start_time_ns // 10**9, UTC).isoformat()
    summary = Summary(str(recording.path), header.robot, len(header.joint_names), header.control_period, started)
    safety: dict[str, SafetyStatus] = {}
    joints = _joints(recording)
    for entry in recording.entries():
        if isinstance(entry, Event):
            summary.remarks.append(Remark(entry.time, "fall" if entry.kind is EventKind.FALL else "event", entry.text))
            continue
        _add_tick(summary, entry, safety)
        if joints is not None:
            joints.update(entry.input.state)
    summary.mean_duration /= max(summary.ticks, 1)
    summary.complete, summary.damage = recording.is_complete, recording.damage
    if joints is not None:
        summary.effort, summary.joints = joints.effort(), joints.rows()
    return summary


def _joints(recording: Recording) -> JointUse | None:
    try:
        robot = RobotDescription.from_json(recording.header.documents["robot"])
    except (KeyError, InputError):
        return None
    return JointUse(robot.joint_names, robot.effort_limit, robot.lower, robot.upper)


def _add_tick(summary: Summary, record: TickRecord, safety: dict[str, SafetyStatus]) -> None:
    time, output, remarks = float(record.input.state.time), record.output, summary.remarks
    if not summary.ticks:
        summary.first_time = time
    summary.last_time = time
    summary.missing_ticks = record.index - summary.ticks
    summary.ticks += 1
    summary.overruns += record.overrun
    summary.policy_steps += output.policy_step is not None
    summary.mean_duration += record.duration
    summary.max_duration = max(summary.max_duration, record.duration)
    for status in record.input.safety:
        before = safety.get(status.source)
        if status != before and (before is not None or not status.is_ok):
            flags = f" {status.flags.name}" if status.flags else ""
            remarks.append(Remark(time, "safety", f"{status.source}: {status.level.name}{flags} {status.message}"))
        safety[status.source] = status
    for fault in output.faults:
        kind = "bug" if fault.is_bug else "fault"
        remarks.append(Remark(time, kind, f"{fault.controller} -> {fault.fallback}: {fault.message}"))
    remarks += [Remark(time, "refused", text) for text in output.refusals]
    control = output.control_mode
    if summary.timeline and summary.timeline[-1].controller == control.controller_name:
        summary.timeline[-1].end = time
        summary.timeline[-1].ticks += 1
    else:
        summary.timeline.append(ModeSpan(control.mode, control.controller_name, control.status_message, time, time))
