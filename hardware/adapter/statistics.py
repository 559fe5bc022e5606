"""Statistics of a run over the bus, for an operator and for a summary."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

from humanoid_sim.hardware.adapter.control import MotorControl
from humanoid_sim.hardware.adapter.robot_motors import RobotMotors
from humanoid_sim.hardware.adapter.wiring import AdapterSettings
from humanoid_sim.hardware.bus.events import ChannelCounters
from humanoid_sim.hardware.bus.frame import bus_load
from humanoid_sim.hardware.motors import MotorFigures


@dataclass(frozen=True, slots=True)
class ChannelStatistics:
    """One channel while it was open, at every activation of the session."""

    source: str
    counters: ChannelCounters
    strangers: Mapping[str, int]
    """Frames that concern no motor of this robot, by what they are."""
    intrusions: int
    """Frames by which another host commands our motors."""
    elapsed: float
    """s"""

    @property
    def load(self) -> float:
        """Estimate of the share of a 1 Mbit/s bus that was in use, 0 to 1, from the frames' number."""
        frames = self.counters.sent + self.counters.received
        return bus_load(frames / self.elapsed) if self.elapsed > 0.0 else 0.0


@dataclass(frozen=True, slots=True)
class RobotStatistics:
    """The robot since the session began: `reactivate` ends nothing of it."""

    channels: tuple[ChannelStatistics, ...]
    commanded: int
    """Commands to motors, each one frame."""
    acknowledged: int
    """Commands that a status answered. Old firmware sends its reports as answers, which then count as such."""
    unconfirmed: int
    """Commands to motors of a family that answers none; not part of those above."""
    reports: int
    """Statuses that motors sent by themselves."""
    invalid_frames: int
    """Frames of our motors that could not be read."""
    saturations: Mapping[str, Mapping[str, int]]
    """By joint and field of the command: how often a value was cut off at the end of its range."""
    bounded: Mapping[str, int]
    """By joint: how often the position was moved so that the MIT law stays within the effort limit."""
    temperature: Mapping[str, float]
    """By joint, °C, as last heard."""
    warmest: Mapping[str, float]
    """By joint, °C, the most that was read while the motors were prepared or enabled."""
    faults: Mapping[str, tuple[str, ...]]
    """By joint, what the latest safety statuses say of its motor; joints of which they say nothing are left out."""
    refused: int
    """Commands that were not sent: the motors were not enabled, or a value was not finite."""

    def lines(self) -> tuple[str, ...]:
        """In words, one line each."""
        lines = [
            f"{self.commanded} motor commands, {self.acknowledged} acknowledged, {self.reports} active reports"
            + (f", {self.unconfirmed} commands to motors that answer none" if self.unconfirmed else "")
            + (f", {self.refused} command sets refused" if self.refused else "")
        ]
        for channel in self.channels:
            counters = channel.counters
            parts = [
                f"{counters.sent} frames sent, {counters.received} received, about {100.0 * channel.load:.0f} % load"
            ]
            parts += [
                f"{count} {what}"
                for what, count in (
                    ("times the outgoing queue was full", counters.retries),
                    ("commands superseded", counters.superseded),
                    ("stale commands dropped", counters.stale),
                    ("overruns", counters.overruns),
                    ("send errors", counters.send_errors),
                    ("receive errors", counters.receive_errors),
                    ("frames of another master", channel.intrusions),
                    *channel.strangers.items(),
                )
                if count
            ]
            lines.append(f"{channel.source}: {', '.join(parts)}")
            if counters.error_frames:
                classes = ", ".join(f"{what} {count} times" for what, count in dict(counters.error_classes).items())
                lines.append(f"warning: {channel.source}: {counters.error_frames} CAN error frames: {classes}")
        if self.invalid_frames:
            lines.append(f"{self.invalid_frames} frames of the robot's motors could not be read")
        for joint, saturated in self.saturations.items():
            cut = ", ".join(f"{field} {count} times" for field, count in saturated.items())
            lines.append(f"{joint}: cut off at the motor's range: {cut}")
        if self.bounded:
            most = ", ".join(f"{joint} {count} times" for joint, count in self.bounded.items())
            lines.append(f"position moved to keep within the effort limit: {most}")
        if self.warmest:
            joint = max(self.warmest, key=lambda name: self.warmest[name])
            lines.append(f"warmest motor: {joint}, {self.warmest[joint]:.1f} °C")
        return tuple(lines)


def gather_statistics(
    settings: AdapterSettings,
    motors: RobotMotors | None,
    control: MotorControl | None,
    now: float,
    past: RobotStatistics | None = None,
) -> RobotStatistics:
    """Return the statistics at `now`, s, robot's clock, since the channels were opened, added to those of the past."""
    figures: list[MotorFigures] = []
    found: list[ChannelStatistics] = []
    temperature: dict[str, float] = {}
    if motors is not None:
        for i, (source, channel) in enumerate(zip(motors.line.sources, motors.line.channels, strict=True)):
            notes, elapsed = motors.line.notes[i], now - motors.line.opened
            found.append(ChannelStatistics(source, channel.counters, dict(notes.strangers), notes.intrusions, elapsed))
        figures = motors.figures()
        warmth = zip(settings.wiring.names, motors.readings().temperature.tolist(), strict=True)
        temperature = {name: value for name, value in warmth if not math.isnan(value)}
    latest = RobotStatistics(
        channels=tuple(found),
        commanded=sum(motor.commanded for motor in figures if motor.acknowledged is not None),
        acknowledged=sum(motor.acknowledged or 0 for motor in figures),
        unconfirmed=sum(motor.commanded for motor in figures if motor.acknowledged is None),
        reports=sum(motor.reports for motor in figures),
        invalid_frames=sum(motor.invalid_frames for motor in figures),
        saturations={} if control is None else control.encoder.saturations,
        bounded={} if control is None else control.encoder.bounded,
        temperature=temperature,
        warmest={} if control is None else control.warmest,
        faults={} if control is None else control.faults,
        refused=0 if control is None else control.refused,
    )
    return latest if past is None else _together(past, latest)


def _together(past: RobotStatistics, latest: RobotStatistics) -> RobotStatistics:
    """Return sums and maxima of both; what tells of the present is the latest's."""
    counts = ("commanded", "acknowledged", "unconfirmed", "reports", "invalid_frames", "refused")
    sums = {name: _sum(getattr(past, name), getattr(latest, name)) for name in (*counts, "saturations", "bounded")}
    before, after = ({channel.source: channel for channel in each.channels} for each in (past, latest))
    warmest = {joint: max(warmth, past.warmest.get(joint, warmth)) for joint, warmth in latest.warmest.items()}
    return replace(latest, channels=tuple(_sum(before, after).values()), warmest={**past.warmest, **warmest}, **sums)


def _sum(past: Any, latest: Any) -> Any:
    """Return the sums of all numbers, of the same names in mappings and of the same fields; a text stays."""
    if isinstance(latest, Mapping):
        both = {name: _sum(past[name], latest[name]) for name in past if name in latest}
        return {**past, **latest, **both}
    if is_dataclass(latest) and not isinstance(latest, type):
        names = [field.name for field in fields(latest)]
        return replace(latest, **{name: _sum(getattr(past, name), getattr(latest, name)) for name in names})
    return latest if isinstance(latest, str) else past + latest
