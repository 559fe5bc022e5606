"""Safety statuses of other programs, and watchdogs over those that must report. They can only ever damp.

A status stands until its source reports another one: a FAULT of `lidar` ends with an OK of `lidar`, and with no other
source's. What one program says never takes anything away from what the robot itself reports.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from humanoid_sim.client import monotonic_ns
from humanoid_sim.errors import FieldError, InputError, blaming, number_in
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus

_MOST_SOURCES = 32  # that are told apart; the fault of a further one stands until the session ends
_FURTHER = "further sources"
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
        """Take the status that a program sends, as JSON of `level`, `source`, `flags`, `message`, and `stamp` in ns.

        Return what became of it, in one line. Raises `FieldError` if it is not a status; nothing has changed.
        """
        status, stamp = _status(text)
        source, is_watched = status.source, status.source in self._timeouts
        if is_watched:
            self._reported[source] = max(self._reported[source], min(stamp, self._clock()))
        if source not in self._statuses and not is_watched:
            if status.is_ok:
                return f"{source} is OK"
            if len(self._statuses) >= _MOST_SOURCES:
                self._statuses[_FURTHER] = replace(status, source=_FURTHER)
                return f"{status.level.name}: one of more than {_MOST_SOURCES} sources, damped until the session ends"
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


def _status(text: str) -> tuple[SafetyStatus, int]:
    """Return the status in a message, and its stamp in ns."""
    with blaming("safety status: not JSON", (ValueError, RecursionError), FieldError):
        values: Any = json.loads(text)
    if not isinstance(values, dict):
        raise FieldError(f"safety status: is {text[:40]!r}, expected level, source, flags, message and stamp")
    for name, kind in (("source", str), ("message", str), ("level", int), ("flags", int), ("stamp", int)):
        if type(values.get(name)) is not kind:
            raise FieldError(f"safety status: {name}: is {values.get(name)!r}, expected {kind.__name__}")
    if values["level"] < 0:
        raise FieldError(f"safety status: level: is {values['level']}, expected 0 to 3")
    level = SafetyLevel(min(values["level"], SafetyLevel.CRITICAL))  # one of a later version is not OK either
    source = _plain(values["source"], _LONGEST_NAME) or "unnamed"
    flags = SafetyFlag(values["flags"] & 0xFFFFFFFF)
    return SafetyStatus(level, flags, source, _plain(values["message"], _LONGEST_MESSAGE)), values["stamp"]


def _plain(text: str, longest: int) -> str:
    """Return a text as one line of bounded length that can be printed."""
    return "".join(character for character in " ".join(text.split()) if character.isprintable())[:longest]
