"""Safety statuses of a robot's channels, rebuilt at every reading from what is observed then.

What is a state is reported while it lasts: a channel that is down (until it is opened afresh), a silent joint, a fault
that the latest status reports, a mode other than RUN, a position that has lost its meaning (until re-activation). What
is an event is reported for the receive timeout after it happened. Single bus errors are counted only: CAN sends the
frame again, and what is lost all the same shows as a silent joint or a full queue.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from humanoid_sim.hardware.can_bus import Channel
from humanoid_sim.hardware.joints import JointTracker
from humanoid_sim.hardware.motor_link import Finding, Motor
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.mit import FloatArray
from humanoid_sim.session.requests import HOW_TO_REACTIVATE

_WARNINGS = SafetyFlag.TX_QUEUE_OVERRUN | SafetyFlag.INVALID_FRAME  # by themselves; the others are a FAULT


def joint_findings(motors: Sequence[Motor], age: FloatArray, rx_timeout: float, tracker: JointTracker) -> list[Finding]:
    """Return what is wrong with joints that every family has; `age`: shape (n,), s since each was received."""
    found = []
    for flag, text, where in (
        (SafetyFlag.RX_TIMEOUT, "silent", age > rx_timeout),
        (SafetyFlag.MOTOR_FAULT, "position jumped", tracker.jumped),
        (SafetyFlag.MOTOR_FAULT, "turned beyond ±4π", tracker.wrapped),
    ):
        found += [Finding(motors[i], flag, text) for i in np.flatnonzero(where).tolist()]
    return found


def channel_status(source: str, channel: Channel, findings: Iterable[Finding], since: float) -> SafetyStatus:
    """Return a channel's status: what happened to it at or after `since`, s, robot's clock, and its joints' findings.

    A status is published when it changes, so its message holds no figure that changes from tick to tick.
    """
    flags = SafetyFlag.NONE
    words: dict[str, list[str]] = {}  # by finding, its joints; none where it is the channel's
    for is_observed, flag, text in (
        (bool(channel.down), SafetyFlag.BUS_OFF, f"down: {channel.down}"),
        (channel.tx_full.time >= since, SafetyFlag.TX_QUEUE_OVERRUN, channel.tx_full.text),
        (channel.intruder.time >= since, SafetyFlag.INVALID_FRAME, channel.intruder.text),
    ):
        if is_observed:
            flags |= flag
            words[text] = []
    for motor, flag, text in findings:
        flags |= flag
        words.setdefault(text, []).append(motor.name)
    if not flags:
        return SafetyStatus(source=source)
    level = SafetyLevel.FAULT if flags & ~_WARNINGS else SafetyLevel.WARNING
    texts = [f"{text}: {', '.join(dict.fromkeys(joints))}" if joints else text for text, joints in words.items()]
    if level is SafetyLevel.FAULT:
        texts.append(f"fix that, then {HOW_TO_REACTIVATE}")
    return SafetyStatus(level, flags, source, "; ".join(texts))
