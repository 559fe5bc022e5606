"""Faults that are injected deliberately, for demonstrations and tests of the safety path: `--inject nan_policy@5`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.errors import InputError, meant, number_in
from humanoid_sim.messages import RemoteCommand, SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.session.sources import RemoteSource

FaultKind = Literal["nan_policy", "safety", "silent_remote"]

_PULSE = 0.1
"""s that an injected safety status lasts."""


@dataclass(frozen=True, slots=True)
class Injection:
    """One fault and when it begins."""

    kind: FaultKind
    time: float
    """s on the robot's clock."""

    def __str__(self) -> str:
        return f"{self.kind}@{self.time:g}"


def parse_injections(texts: Sequence[str]) -> tuple[Injection, ...]:
    """Parse `FAULT@SECONDS` items.

    `nan_policy`: from then on the policy answers NaN. `safety`: a FAULT status with MOTOR_FAULT for 0.1 s.
    `silent_remote`: from then on no remote command arrives. Raises `InputError` naming the item and what is accepted.
    """
    injections = []
    for text in texts:
        kind, _, seconds = text.partition("@")
        time, kinds = number_in(seconds), get_args(FaultKind)
        if kind not in kinds or not time >= 0.0:
            wrong = f"--inject: is '{text}'{'' if kind in kinds else meant(kind, kinds)}"
            raise InputError(f"{wrong}, expected FAULT@SECONDS with FAULT one of {', '.join(kinds)}")
        injections.append(Injection(kinds[kinds.index(kind)], time))
    return tuple(injections)


class Injector:
    """Applies injections to what the control loop reads. Without any it changes nothing."""

    def __init__(self, injections: Sequence[Injection], clock: Callable[[], float]) -> None:
        """Take the faults to apply; `clock` is the robot's, s."""
        self._start = dict.fromkeys(get_args(FaultKind), math.inf)
        for injection in injections:
            self._start[injection.kind] = min(self._start[injection.kind], injection.time)
        self._pulses = tuple(injection.time for injection in injections if injection.kind == "safety")
        self._clock = clock
        self._pending = list(injections)

    @property
    def pending(self) -> tuple[str, ...]:
        """Those that have had no effect yet: their time has not come, or nothing asked what they would have changed."""
        return tuple(str(injection) for injection in self._pending)

    def policy(self, policy: Policy) -> Policy:
        """Return the policy, answering NaN from the injected time on."""
        if math.isinf(self._start["nan_policy"]):
            return policy

        def failing(observation: npt.NDArray[np.float32], frame: int) -> npt.ArrayLike:
            action = np.asarray(policy(observation, frame))
            return np.full_like(action, np.nan) if self._takes_effect("nan_policy") else action

        return failing

    def safety(self, statuses: tuple[SafetyStatus, ...]) -> tuple[SafetyStatus, ...]:
        """Return the statuses, with an injected one while it lasts."""
        now = self._clock()
        if not any(0.0 <= now - start < _PULSE for start in self._pulses):
            return statuses
        self._takes_effect("safety")
        injected = SafetyStatus(
            SafetyLevel.FAULT, SafetyFlag.MOTOR_FAULT, "injected", "motor fault, injected deliberately"
        )
        return (*statuses, injected)

    def remote(self, source: RemoteSource) -> RemoteSource:
        """Return the source, silent from the injected time on."""
        if math.isinf(self._start["silent_remote"]):
            return source
        return _SilencedRemote(source, lambda: self._takes_effect("silent_remote"))

    def _takes_effect(self, kind: FaultKind) -> bool:
        """Return whether a fault has begun; it is no longer pending then."""
        now = self._clock()
        if now < self._start[kind]:
            return False
        if self._pending:
            self._pending = [other for other in self._pending if other.kind != kind or other.time > now]
        return True


class _SilencedRemote:
    """Repeats the last command from before the silence, as a source whose sender has died would."""

    def __init__(self, source: RemoteSource, is_silent: Callable[[], bool]) -> None:
        self._source, self._is_silent = source, is_silent
        self._last: RemoteCommand | None = None

    def latest(self) -> RemoteCommand | None:
        if not self._is_silent():
            self._last = self._source.latest()
        return self._last
