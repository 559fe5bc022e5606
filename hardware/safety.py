"""Safety statuses of a robot's channels, rebuilt at every reading from what is observed then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from humanoid_sim.hardware.bus.open_channels import OpenChannels
from humanoid_sim.hardware.joints import JointTracker, Wiring
from humanoid_sim.hardware.motor_link import Finding
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.mit import FloatArray
from humanoid_sim.session.reactivation import HOW_TO_REACTIVATE

_WARNINGS = SafetyFlag.TX_QUEUE_OVERRUN | SafetyFlag.INVALID_FRAME  # by themselves; the others are a FAULT


class _Observed(NamedTuple):
    """Content of a channel's status; an equal one is the same status."""

    level: SafetyLevel
    flags: SafetyFlag
    joints: tuple[tuple[str, str], ...]  # finding and joint; no joint where the finding is the channel's


class SafetyWatch:
    """Builds one status for each channel.

    What is a state is reported while it lasts: a channel that is down (until it is opened afresh), a silent joint, a
    fault that the latest status reports, a mode other than RUN, a position that has lost its meaning (until
    re-activation). What is an event is reported for the receive timeout after it happened, so that an operator and a
    20 ms tick see the same. Single bus errors are counted only: CAN sends the frame again, and what is lost all the
    same shows as a silent joint or a full queue.

    A status is published when it changes, so its message holds no figure that changes from tick to tick.
    """

    def __init__(self, wiring: Wiring, sources: Sequence[str], line: OpenChannels, rx_timeout: float) -> None:
        """Begin to watch motors that are enabled now; what happened before is past. `rx_timeout` in s."""
        self._wiring, self._line, self._rx_timeout = wiring, line, rx_timeout
        self._since = line.clock()
        self._joints = tuple(wiring.on_channel(index) for index in range(len(sources)))
        self._observed = [_Observed(SafetyLevel.OK, SafetyFlag.NONE, ()) for _ in sources]
        self._statuses = [SafetyStatus(source=source) for source in sources]
        self.faults: Mapping[str, tuple[str, ...]] = {}
        """By joint, the findings of the latest statuses. A new one each time: other threads may read it."""

    def since(self, now: float) -> float:
        """Return since when events count, s, robot's clock."""
        return max(now - self._rx_timeout, self._since)

    def statuses(
        self, now: float, age: FloatArray, tracker: JointTracker, findings: Sequence[Finding]
    ) -> tuple[SafetyStatus, ...]:
        """Return one status per channel at `now`, s, robot's clock.

        Args:
            age: shape (n,), s since each joint was received.
            findings: of the robot's motors, `motor` being the joint's index.
        """
        silent = Finding(0, SafetyFlag.RX_TIMEOUT, "silent")
        jumped = Finding(0, SafetyFlag.MOTOR_FAULT, "position jumped")
        wrapped = Finding(0, SafetyFlag.MOTOR_FAULT, "turned beyond ±4π")
        found = list(findings)
        for finding, where in (
            (silent, age > self._rx_timeout),
            (jumped, tracker.jumped),
            (wrapped, tracker.wrapped),
        ):
            found += [finding._replace(motor=i) for i in np.flatnonzero(where).tolist()]
        names = self._wiring.names
        faults: dict[str, tuple[str, ...]] = {}
        for finding in found:
            faults[names[finding.motor]] = (*faults.get(names[finding.motor], ()), finding.text)
        self.faults = faults
        for index, joints in enumerate(self._joints):
            own = [(finding.flag, finding.text, names[finding.motor]) for finding in found if finding.motor in joints]
            self._update(index, own + self._bus_findings(index, self.since(now)))
        return tuple(self._statuses)

    def _bus_findings(self, index: int, since: float) -> list[tuple[SafetyFlag, str, str]]:
        channel, intruder = self._line.channels[index], self._line.notes[index].intruder
        found = [(SafetyFlag.BUS_OFF, f"down: {channel.down}", "")] if channel.down else []
        if channel.tx_full.time >= since:
            found.append((SafetyFlag.TX_QUEUE_OVERRUN, channel.tx_full.text, ""))
        if intruder.time >= since:
            found.append((SafetyFlag.INVALID_FRAME, intruder.text, ""))
        return found

    def _update(self, index: int, findings: Sequence[tuple[SafetyFlag, str, str]]) -> None:
        """Format a channel's status, if it is not what it was."""
        flags = SafetyFlag.NONE
        for flag, _, _ in findings:
            flags |= flag
        level = SafetyLevel.FAULT if flags & ~_WARNINGS else SafetyLevel.WARNING if findings else SafetyLevel.OK
        observed = _Observed(level, flags, tuple(dict.fromkeys((text, joint) for _, text, joint in findings)))
        if observed != self._observed[index]:
            self._observed[index] = observed
            message = _message(observed, len(self._joints[index]))
            self._statuses[index] = SafetyStatus(level, flags, self._statuses[index].source, message)


def _message(observed: _Observed, joint_count: int) -> str:
    """Return each finding once with its joints: `silent: left_elbow_pitch, left_wrist_yaw`."""
    joints: dict[str, list[str]] = {}
    for text, joint in observed.joints:
        joints.setdefault(text, []).append(joint)
    words = []
    for text, names in joints.items():
        where = f"all {joint_count} motors" if 2 < joint_count == len(names) else ", ".join(filter(None, names))
        words.append(f"{text}: {where}" if where else text)
    if observed.level is SafetyLevel.FAULT:
        words.append(f"fix that, then {HOW_TO_REACTIVATE}")
    return "; ".join(words)
