"""Safety statuses of other programs, and watchdogs over those that must report. They can only ever damp.

A status stands until its source reports another one: a FAULT of `lidar` ends with an OK of `lidar`, and with no other
source's. What one program says never takes anything away from what the robot itself reports.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Annotated

import msgspec

from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import FieldError, InputError, blaming, number_in
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus

_LONGEST_NAME = 80
_LONGEST_MESSAGE = 300
_SHORTEST, _LONGEST = 0.02, 3600.0  # s of a watchdog


def parse_watchdogs(texts: Sequence[str]) -> Mapping[str, float]:
    """Return the timeout, s, of each source, of `NAME:SECONDS` items. Raises `InputError` naming the item."""
    found: dict[str, float] = {}
    for text in texts:
        name, _, seconds = text.rpartition(":")
        if not name.strip() or len(name) > _LONGEST_NAME or not _SHORTEST <= number_in(seconds) <= _LONGEST:
            accepted = f"NAME:SECONDS with {_SHORTEST:g} to {_LONGEST:g} s, such as lidar:0.5"
            raise InputError(f"--watchdog: is '{text}', expected {accepted}")
        if name in found:
            raise InputError(f"--watchdog: '{name}' is given twice, expected each source once")
        found[name] = number_in(seconds)
    return MappingProxyType(found)


class _Report(msgspec.Struct):
    """The JSON that a program sends; `stamp` in ns."""

    level: Annotated[int, msgspec.Meta(ge=0)]
    source: str
    flags: int
    message: str
    stamp: int

    def status(self) -> SafetyStatus:
        level = SafetyLevel(min(self.level, SafetyLevel.CRITICAL))  # one of a later version is not OK either
        source = _plain(self.source, _LONGEST_NAME) or "unnamed"
        return SafetyStatus(level, SafetyFlag(self.flags & 0xFFFFFFFF), source, _plain(self.message, _LONGEST_MESSAGE))


class OutsideSafety:
    """Collects statuses, and adds them to the robot's own in each tick. Used on the control thread alone."""

    def __init__(
        self, watchdogs: Mapping[str, float] | None = None, *, clock: Callable[[], int] = monotonic_ns
    ) -> None:
        """Take the timeout of each source that must report, s; `clock` gives ns of CLOCK_MONOTONIC."""
        self._clock = clock
        self._statuses: dict[str, SafetyStatus] = {}
        self._timeouts = dict(watchdogs or {})
        self._reported = dict.fromkeys(self._timeouts, 0)
        """ns of the latest status of each watched source; 0: none yet."""

    def report(self, text: str) -> str:
        """Take the status that a program sends; return what became of it, in one line.

        Raises `FieldError` if it is not a status; nothing has changed then.
        """
        with blaming("safety status", msgspec.MsgspecError, FieldError):
            report = msgspec.json.decode(text, type=_Report)
        status = report.status()
        source = status.source
        if source in self._timeouts:
            self._reported[source] = max(self._reported[source], min(report.stamp, self._clock()))
        elif source not in self._statuses and status.is_ok:
            return f"{source} is OK"
        self._statuses[source] = status
        return f"{source} is {status.level.name}{'' if status.is_ok else ': the robot is damped'}"

    def __call__(self, statuses: tuple[SafetyStatus, ...]) -> tuple[SafetyStatus, ...]:
        """Return the robot's own statuses, and behind them those of other programs."""
        if not self._statuses and not self._timeouts:
            return statuses
        own = {status.source for status in statuses}
        outside = {**self._statuses, **{name: self._judged(name) for name in self._timeouts}}
        renamed = [replace(one, source=f"{name} (outside)") if name in own else one for name, one in outside.items()]
        return (*statuses, *renamed)

    def _judged(self, name: str) -> SafetyStatus:
        """Return the status of a watched source: its latest, or that it is silent."""
        latest = self._statuses.get(name, SafetyStatus(source=name))
        timeout, reported = self._timeouts[name], self._reported[name]
        if self._clock() - reported <= 1e9 * timeout or not latest.is_ok:
            return latest
        silence = f"silent for more than {timeout:g} s" if reported else "not reported yet"
        return SafetyStatus(SafetyLevel.FAULT, SafetyFlag.NONE, name, f"{silence} (--watchdog)")


def _plain(text: str, longest: int) -> str:
    """Return a text as one line of bounded length that can be printed."""
    return "".join(character for character in " ".join(text.split()) if character.isprintable())[:longest]
