"""From what was heard, and what was not, to one safety status per channel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from humanoid_sim.hardware.adapter.joint_tracking import JointTracker
from humanoid_sim.hardware.adapter.wiring import AdapterSettings
from humanoid_sim.hardware.bus.channel import Channel
from humanoid_sim.hardware.bus.events import BusEvent
from humanoid_sim.hardware.robstride.fields import FaultBit, MotorMode, StatusFault, WarningBit, flag_names
from humanoid_sim.hardware.robstride.messages import Status
from humanoid_sim.hardware.robstride.motor_table import MotorSlot, MotorTable
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.mit import FloatArray

__all__ = ["SafetyWatch"]


_WARNINGS = SafetyFlag.TX_QUEUE_OVERRUN | SafetyFlag.INVALID_FRAME
"""Flags that are a WARNING by themselves, as a finding without a flag is; the others are a FAULT."""

_HOT = "motor_overtemperature"
"""The name of that bit in status and fault report alike."""

_Finding = tuple[SafetyFlag, str, str]
"""A flag, what was found, and the joint; no joint where the finding is the channel's."""


class SafetyWatch:
    """Builds the statuses afresh at every reading, from what is observed then.

    What is a state is reported while it lasts: a channel that is down (until it is opened afresh), a silent joint, a
    fault that the latest status reports, a mode other than RUN, a position that has lost its meaning (until
    re-activation). What is an event is reported for the receive timeout after it happened, so that an operator and a
    20 ms tick see the same. Single bus errors are counted only: CAN sends the frame again, and what is lost all the
    same shows as a silent joint or a full queue. A burst of them has no flag of its own, and is a WARNING.

    Messages hold no figures that change from tick to tick: a status is published when it changes.
    """

    def __init__(
        self, settings: AdapterSettings, table: MotorTable, channels: Sequence[Channel], *, since: float
    ) -> None:
        """Begin to watch enabled motors.

        Args:
            settings: the robot's.
            table: what is heard of its motors.
            channels: in the order of the wiring's indices.
            since: s, robot's clock; what happened before is past.
        """
        wiring = settings.wiring
        self._names = wiring.names
        self._table = table
        self._channels = channels
        self._joints = tuple(wiring.on_channel(index) for index in range(len(channels)))
        self._rx_timeout = settings.rx_timeout
        self._since = since
        self._ok = tuple(SafetyStatus(source=str(channel.address)) for channel in channels)

    def statuses(self, now: float, age: FloatArray, tracker: JointTracker) -> tuple[SafetyStatus, ...]:
        """One status per channel.

        Args:
            now: s, robot's clock.
            age: shape (n,), s since each joint was heard.
            tracker: what became of the positions.
        """
        recent = max(now - self._rx_timeout, self._since)
        silent = age > self._rx_timeout
        return tuple(self._status(index, recent, silent, tracker) for index in range(len(self._channels)))

    def _status(self, index: int, recent: float, silent: npt.NDArray[np.bool_], tracker: JointTracker) -> SafetyStatus:
        joints = self._joints[index]
        findings = [*self._bus(index, recent)]
        for i in joints:
            if silent[i]:
                findings.append((SafetyFlag.RX_TIMEOUT, "silent", self._names[i]))
            findings += self._motor(self._table.slots[i], recent, tracker)
        if not findings:
            return self._ok[index]
        flags = SafetyFlag.NONE
        for flag, _, _ in findings:
            flags |= flag
        level = SafetyLevel.FAULT if flags & ~_WARNINGS else SafetyLevel.WARNING
        return SafetyStatus(level, flags, self._ok[index].source, _in_words(findings, len(joints)))

    def _bus(self, index: int, recent: float) -> Iterator[_Finding]:
        channel, notes = self._channels[index], self._table.channels[index]
        if down := channel.down:
            yield SafetyFlag.BUS_OFF, f"down: {down}", ""
        if text := channel.recent(BusEvent.TX_FULL, recent):
            yield SafetyFlag.TX_QUEUE_OVERRUN, text, ""
        if text := channel.recent(BusEvent.BURST, recent):
            yield SafetyFlag.NONE, text, ""
        if text := channel.recent(BusEvent.UNREADABLE, recent):
            yield SafetyFlag.INVALID_FRAME, text, ""
        if notes.intruder.time >= recent:
            yield SafetyFlag.INVALID_FRAME, notes.intruder.text, ""

    def _motor(self, slot: MotorSlot, recent: float, tracker: JointTracker) -> Iterator[_Finding]:
        name = self._names[slot.joint]
        sample, alarm, report = slot.sample, slot.alarm, slot.report
        if sample is not None and alarm is not None and (alarm is sample or alarm.time >= recent):
            yield from _alarm(name, alarm.status)
        if report is not None and (report.faults or report.warnings):
            yield from _report(name, report.faults, report.warnings)
        if tracker.jumped[slot.joint]:
            yield SafetyFlag.MOTOR_FAULT, "position jumped", name
        if tracker.wrapped[slot.joint]:
            yield SafetyFlag.MOTOR_FAULT, "turned beyond ±4π", name
        if slot.invalid.time >= recent:
            yield SafetyFlag.INVALID_FRAME, f"sent a {slot.invalid.text}", name


def _alarm(name: str, status: Status) -> Iterator[_Finding]:
    for fault in flag_names(status.faults):
        yield SafetyFlag.MOTOR_FAULT, fault, name
    if status.faults & StatusFault.MOTOR_OVERTEMPERATURE:
        yield SafetyFlag.TEMPERATURE_LIMIT, _HOT, name
    if status.mode is not MotorMode.RUN:
        yield SafetyFlag.MOTOR_FAULT, f"left run mode (mode {status.mode.name.lower()})", name


def _report(name: str, faults: FaultBit, warnings: WarningBit) -> Iterator[_Finding]:
    for fault in flag_names(faults):
        yield SafetyFlag.MOTOR_FAULT, fault, name
    if faults & FaultBit.MOTOR_OVERTEMPERATURE:
        yield SafetyFlag.TEMPERATURE_LIMIT, _HOT, name
    hot = warnings & WarningBit.MOTOR_OVERTEMPERATURE_WARNING
    for warning in flag_names(warnings):
        yield SafetyFlag.TEMPERATURE_LIMIT if hot else SafetyFlag.MOTOR_FAULT, warning, name


def _in_words(findings: Sequence[_Finding], joint_count: int) -> str:
    """Each finding once with its joints: `silent: left_elbow_pitch, left_wrist_yaw`, or `silent: all 7 motors`."""
    joints: dict[str, dict[str, None]] = {}
    for _, what, name in findings:
        joints.setdefault(what, {})[name] = None
    words = []
    for what, names in joints.items():
        everyone = f"all {joint_count} motors" if 2 < joint_count == len(names) else ", ".join(names)
        words.append(f"{what}: {everyone}" if everyone else what)
    return "; ".join(words)
