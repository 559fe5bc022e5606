"""One safety status per channel, from received and missing data."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from humanoid_sim.hardware.adapter.joint_tracking import JointTracker
from humanoid_sim.hardware.adapter.robot_motors import RobotMotors
from humanoid_sim.hardware.adapter.wiring import AdapterSettings
from humanoid_sim.hardware.bus.events import BusEvent
from humanoid_sim.hardware.motors import STOPPED, Finding
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.mit import FloatArray
from humanoid_sim.session.reactivation import HOW_TO_REACTIVATE

_WARNINGS = SafetyFlag.TX_QUEUE_OVERRUN | SafetyFlag.INVALID_FRAME
"""Flags that are a WARNING by themselves, as a finding without a flag is; the others are a FAULT."""
_SILENT = "silent"


class SafetyWatch:
    """Builds the statuses afresh at every reading, from what is observed then.

    What is a state is reported while it lasts: a channel that is down (until it is opened afresh), a silent joint, a
    fault that the latest status reports, a mode other than RUN, a position that has lost its meaning (until
    re-activation). What is an event is reported for the receive timeout after it happened, so that an operator and a
    20 ms tick see the same. Single bus errors are counted only: CAN sends the frame again, and what is lost all the
    same shows as a silent joint or a full queue. A burst of them, or a flood, has no flag of its own, and is a WARNING.

    Where nobody asked or commanded for longer than the CAN timeout, this program stood still: that explains joints that
    were not heard until now, and motors that have stopped without a fault.

    Messages hold no figures that change from tick to tick: a status is published when it changes.
    """

    def __init__(self, settings: AdapterSettings, motors: RobotMotors, *, since: float) -> None:
        """Begin to watch motors that were enabled at `since`, s, robot's clock; what happened before is past."""
        wiring = settings.wiring
        self._names = wiring.names
        self._motors = motors
        self._channels = channels = motors.line.channels
        self._joints = tuple(wiring.on_channel(index) for index in range(len(channels)))
        self._rx_timeout = settings.rx_timeout
        self._since = self._beat = since
        self._can_timeout = settings.can_timeout
        self._continued, self._standstill = -math.inf, 0.0
        """End and duration of this program's latest standstill, s."""
        self._stopped_by_it: set[int] = set()
        self._ok = tuple(SafetyStatus(source=source) for source in settings.sources)
        self.faults: Mapping[str, tuple[str, ...]] = {}
        """By joint, what the latest statuses say of its motor. A new one each time: other threads may look."""

    def beat(self, now: float) -> None:
        """Note a sign of life of this program, s, robot's clock."""
        if now - self._beat > self._can_timeout:
            self._continued, self._standstill = now, now - self._beat
        self._beat = now

    def statuses(self, now: float, age: FloatArray, tracker: JointTracker) -> tuple[SafetyStatus, ...]:
        """Return one status per channel at `now`, s, robot's clock; `age`: shape (n,), s since each joint was heard."""
        self.beat(now)
        recent = max(now - self._rx_timeout, self._since)
        silent = age > self._rx_timeout
        faults: dict[str, tuple[str, ...]] = {}
        statuses = tuple(self._status(index, recent, silent, tracker, faults) for index in range(len(self._channels)))
        self.faults = faults
        return statuses

    def _status(
        self,
        index: int,
        recent: float,
        silent: npt.NDArray[np.bool_],
        tracker: JointTracker,
        faults: dict[str, tuple[str, ...]],
    ) -> SafetyStatus:
        """Return the status of one channel; adds what it says of each joint to `faults`."""
        joints = self._joints[index]
        findings = [*self._bus(index, recent)]
        stood_still = self._continued >= recent
        unexplained: set[str] = set()
        for i in joints:
            own = [*self._motor(i, recent, tracker)]
            if silent[i]:
                own.insert(0, (SafetyFlag.RX_TIMEOUT, _SILENT, self._names[i]))
            if own:
                faults[self._names[i]] = told = tuple(dict.fromkeys(what for _, what, _ in own))
                findings += own
                if stood_still and STOPPED in told:
                    self._stopped_by_it.add(i)
                explained = {_SILENT: stood_still, STOPPED: i in self._stopped_by_it}
                unexplained.update(what for what in told if not explained.get(what))
        if not findings:
            return self._ok[index]
        flags = SafetyFlag.NONE
        for flag, _, _ in findings:
            flags |= flag
        level = SafetyLevel.FAULT if flags & ~_WARNINGS else SafetyLevel.WARNING
        words = _in_words(findings, len(joints))
        advice = _advice(flags, int(silent[list(joints)].sum()), len(joints))
        if any(name for _, _, name in findings) and not unexplained and not flags & SafetyFlag.BUS_OFF:
            advice = f"find out why this program stood still for {self._standstill:.1f} s"
        if advice:
            words = f"{words}; {advice}, then {HOW_TO_REACTIVATE}"
        return SafetyStatus(level, flags, self._ok[index].source, words)

    def _bus(self, index: int, recent: float) -> Iterator[Finding]:
        channel, notes = self._channels[index], self._motors.line.notes[index]
        if down := channel.down:
            yield SafetyFlag.BUS_OFF, f"down: {down}", ""
        if notes.flood.time >= recent:
            yield SafetyFlag.NONE, notes.flood.text, ""
        if text := channel.recent(BusEvent.TX_FULL, recent):
            yield SafetyFlag.TX_QUEUE_OVERRUN, text, ""
        if text := channel.recent(BusEvent.BURST, recent):
            yield SafetyFlag.NONE, text, ""
        if text := channel.recent(BusEvent.UNREADABLE, recent):
            yield SafetyFlag.INVALID_FRAME, text, ""
        if notes.intruder.time >= recent:
            yield SafetyFlag.INVALID_FRAME, notes.intruder.text, ""

    def _motor(self, joint: int, recent: float, tracker: JointTracker) -> Iterator[Finding]:
        name = self._names[joint]
        yield from self._motors.findings(joint, recent)
        if tracker.jumped[joint]:
            yield SafetyFlag.MOTOR_FAULT, "position jumped", name
        if tracker.wrapped[joint]:
            yield SafetyFlag.MOTOR_FAULT, "turned beyond ±4π", name


def _in_words(findings: Sequence[Finding], joint_count: int) -> str:
    """Each finding once with its joints: `silent: left_elbow_pitch, left_wrist_yaw`, or `silent: all 7 motors`.

    One that begins with `is` follows its joint: `left_elbow_pitch is too hot`.
    """
    joints: dict[str, dict[str, None]] = {}
    for _, what, name in findings:
        joints.setdefault(what, {})[name] = None
    words = []
    for what, names in joints.items():
        everyone = f"all {joint_count} motors" if 2 < joint_count == len(names) else ", ".join(names)
        if what.startswith("is "):
            words.append(f"{everyone} {what if len(names) == 1 else f'are {what[3:]}'}")
        else:
            words.append(f"{what}: {everyone}" if everyone else what)
    return "; ".join(words)


def _advice(flags: SafetyFlag, silent: int, joint_count: int) -> str:
    """Say what to do about a channel's flags before the robot is activated again; empty for what clears by itself."""
    if flags & SafetyFlag.BUS_OFF or 1 < silent == joint_count:
        return "check its cable, terminators and supply"
    if flags & SafetyFlag.RX_TIMEOUT:
        return "check its plug" if silent == 1 else "check their plugs"
    if flags & SafetyFlag.TEMPERATURE_LIMIT:
        return "let it cool"
    return "find the cause" if flags & SafetyFlag.MOTOR_FAULT else ""
