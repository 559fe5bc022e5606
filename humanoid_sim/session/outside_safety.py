"""Safety statuses of other programs, and watchdogs over those that must report. They can only ever damp.

A status stands until its source reports another one, and takes nothing away from what the robot itself reports.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated

import msgspec

from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import FieldError, InputError, blaming, number_in
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus

_SHORTEST, _LONGEST = 0.02, 3600.0  # s of a watchdog


def parse_watchdogs(texts: Sequence[str]) -> Mapping[str, float]:
    """Return the timeout, s, of each source, of `NAME:SECONDS` items."""
    found: dict[str, float] = {}
    for text in texts:
        name, _, seconds = text.rpartition(":")
        if not name.strip() or name in found or not _SHORTEST <= number_in(seconds) <= _LONGEST:
            accepted = f"NAME:SECONDS with {_SHORTEST:g} to {_LONGEST:g} s, each name once, such as lidar:0.5"
            raise InputError(f"--watchdog: is '{text}', expected {accepted}")
        found[name] = number_in(seconds)
    return found


class _Report(msgspec.Struct):
    level: Annotated[int, msgspec.Meta(ge=0)]
    source: str
    flags: int
    message: str
    stamp: int  # ns, CLOCK_MONOTONIC


class OutsideSafety:
    """Collects statuses, and adds them to the robot's own in each tick. Used on the control thread alone."""

    def __init__(self, watchdogs: Mapping[str, float], *, clock: Callable[[], int] = monotonic_ns) -> None:
        """Take the timeout of each source that must report, s; `clock` gives ns of CLOCK_MONOTONIC."""
        self._clock, self._timeouts = clock, watchdogs
        self._statuses: dict[str, SafetyStatus] = {}
        self._reported: dict[str, int] = {}  # ns, of each source's latest

    def report(self, text: str) -> str:
        """Take the status that a program sends; return what became of it, in one line.

        Raises `FieldError` if it is not a status; nothing has changed then.
        """
        with blaming("safety status", msgspec.MsgspecError, FieldError):
            report = msgspec.json.decode(text, type=_Report)
        level = SafetyLevel(min(report.level, SafetyLevel.CRITICAL))  # one of a later version is not OK either
        source = report.source or "unnamed"
        flags = SafetyFlag(report.flags & 0xFFFFFFFF)
        self._statuses[source] = SafetyStatus(level, flags, source, report.message)
        self._reported[source] = max(self._reported.get(source, 0), min(report.stamp, self._clock()))
        return f"{source} is {level.name}{': the robot is damped' if level else ''}"

    def __call__(self, statuses: tuple[SafetyStatus, ...]) -> tuple[SafetyStatus, ...]:
        """Return the robot's own statuses, and behind them those of other programs."""
        if not self._statuses and not self._timeouts:
            return statuses
        own = {status.source for status in statuses}
        outside = {**self._statuses, **{name: self._watched(name) for name in self._timeouts}}
        renamed = [replace(one, source=f"{name} (outside)") if name in own else one for name, one in outside.items()]
        return (*statuses, *renamed)

    def _watched(self, name: str) -> SafetyStatus:
        latest = self._statuses.get(name, SafetyStatus(source=name))
        timeout, reported = self._timeouts[name], self._reported.get(name, 0)
        if self._clock() - reported <= 1e9 * timeout or not latest.is_ok:
            return latest
        silence = f"silent for more than {timeout:g} s" if reported else "not reported yet"
        return SafetyStatus(SafetyLevel.FAULT, SafetyFlag.NONE, name, f"{silence} (--watchdog)")
