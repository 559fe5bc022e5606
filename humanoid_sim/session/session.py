"""The control loop: read, collect, step, write, hand out, wait for the deadline.

Everything that decides is in `Supervisor.step`. This loop only moves data, keeps time, and makes sure that however a
run ends the robot is damped and then closed.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter, sleep
from typing import Protocol

import numpy as np

from humanoid_sim.controllers.supervisor import Supervisor, SupervisorMemory
from humanoid_sim.messages import Intent, Mode, RemoteCommand, SafetyStatus, TickInput, TickOutput
from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.robots.interface import Robot
from humanoid_sim.session.sink import SessionHeader, Sink, TickRecord
from humanoid_sim.session.sources import ExternSource, IntentSource, RemoteSource

__all__ = ["LoopSettings", "Session", "SessionResult"]

_REST_VELOCITY = 0.02
"""rad/s below which a joint counts as come to rest."""
_SPIN = 0.0002
"""s before a deadline that are spent spinning: `sleep` wakes up to this much late on a common kernel."""
_BACKLOG_LIMIT = 2000
"""Ticks that the slowest sink may lag behind before a run without deadlines waits for it."""


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """How the loop keeps time, and how it ends."""

    control_period: float
    """s"""
    realtime: bool = True
    """Keep real time. A simulated robot may run as fast as it can instead."""
    simulated: bool = False
    """Writing to the robot also advances its physics, which then does not count as a tick's own time."""
    duration: float | None = None
    """s on the robot's clock after which the run ends; None: when a source says so, or QUIT."""
    damping_time: float = 3.0
    """s at most that the end of a run stays in DAMPING for the joints to come to rest."""


@dataclass(frozen=True, slots=True)
class SessionResult:
    """How a run ended."""

    ticks: int
    reason: str
    duration: float
    """s on the robot's clock."""
    wall_time: float
    """s"""
    overruns: int
    skipped: int
    """Deadlines that passed while a tick was still running."""


class SafetyFilter(Protocol):
    """Adds to what the robot reports."""

    def __call__(self, statuses: tuple[SafetyStatus, ...]) -> tuple[SafetyStatus, ...]:
        """The statuses that the supervisor sees."""


def _unfiltered(statuses: tuple[SafetyStatus, ...]) -> tuple[SafetyStatus, ...]:
    return statuses


class Session:
    """Owns a robot and its loop for one run."""

    def __init__(
        self,
        robot: Robot,
        supervisor: Supervisor,
        settings: LoopSettings,
        *,
        header: SessionHeader,
        intents: Sequence[IntentSource] = (),
        remote: RemoteSource | None = None,
        externs: Sequence[ExternSource] = (),
        sinks: Sequence[Sink] = (),
        safety_filter: SafetyFilter = _unfiltered,
        qpos: Callable[[], FloatArray] | None = None,
    ) -> None:
        """Put the parts together; nothing moves before `run`."""
        self._robot = robot
        self._supervisor = supervisor
        self._settings = settings
        self._header = header
        self._intents = tuple(intents)
        self._remote = remote
        self._externs = tuple(externs)
        self._sinks = tuple(sinks)
        self._safety_filter = safety_filter
        self._qpos = qpos
        self._stop_reason = ""
        self._hurry = threading.Event()
        self._memory: SupervisorMemory = supervisor.initial()
        self._output: TickOutput | None = None
        self._state = MITState.unknown(len(robot.joints))
        self._index = 0
        self._overruns = 0
        self._skipped = 0
        self._deadline = 0.0

    @property
    def time(self) -> float:
        """s, the robot's clock as of the last reading; other threads may ask."""
        return float(self._state.time)

    @property
    def memory(self) -> SupervisorMemory:
        """The control stack's memory after the last tick."""
        return self._memory

    @property
    def mode(self) -> Mode:
        """The mode of the last tick; ZERO_TORQUE before the first."""
        return Mode.ZERO_TORQUE if self._output is None else self._output.control_mode.mode

    def request_stop(self, reason: str) -> None:
        """End the run through DAMPING. May be called from a signal handler; a second call does not wait for rest."""
        if self._stop_reason:
            self._hurry.set()
        self._stop_reason = self._stop_reason or reason

    def run(self) -> SessionResult:
        """Activate the robot and loop until the end.

        Whatever ends the run (its duration, QUIT, a signal, an exception), the robot is damped, from ZERO_TORQUE
        directly, and closed; an exception is raised again afterwards.

        Raises:
            RobotError: if the robot cannot be activated.
            InputError: if a sink cannot start.
        """
        started: list[Sink] = []
        begin = perf_counter()
        try:
            for sink in self._sinks:
                sink.start(self._header)
                started.append(sink)
            self._robot.activate()
            try:
                self._loop()
                self._rest()
            except BaseException:
                self._damp_now()
                raise
        finally:
            self._robot.close()
            for sink in started:
                sink.close()
        return SessionResult(
            ticks=self._index,
            reason=self._stop_reason,
            duration=self._index * self._settings.control_period,
            wall_time=perf_counter() - begin,
            overruns=self._overruns,
            skipped=self._skipped,
        )

    def _loop(self) -> None:
        """Ticks until something ends the run."""
        self._deadline = perf_counter()
        first: float | None = None
        while not self._stop_reason:
            self.tick(self._collect())
            first = self.time if first is None else first
            limit = self._settings.duration
            if self._output is not None and self._output.quit:
                self._stop_reason = "QUIT"
            elif limit is not None and self.time - first >= limit - 0.5 * self._settings.control_period:
                self._stop_reason = f"duration of {limit:g} s reached"
            elif any(source.finished for source in self._intents):
                self._stop_reason = "script finished"

    def _rest(self) -> None:
        """DAMPING until the joints are at rest, then QUIT; from ZERO_TORQUE QUIT at once."""
        if self._output is None or self._output.quit:
            return
        self._announce(f"ending: {self._stop_reason}")
        left = round(self._settings.damping_time / self._settings.control_period)
        if self.mode is not Mode.ZERO_TORQUE:
            self.tick((Intent.DAMP,))
            while left > 0 and not self._hurry.is_set() and not self._is_at_rest():
                self.tick(())
                left -= 1
        self.tick((Intent.QUIT,))

    def _is_at_rest(self) -> bool:
        velocity = self._state.joint_velocity
        return bool((np.abs(velocity[np.isfinite(velocity)]) < _REST_VELOCITY).all())

    def _collect(self) -> tuple[Intent, ...]:
        time, output = self.time, self._output
        return tuple(intent for source in self._intents for intent in source.poll(time, output))

    def tick(self, intents: tuple[Intent, ...]) -> None:
        """One turn of the loop with these intents; `run` calls it, and so does whoever wants to drive ticks by hand."""
        start = perf_counter()
        state, safety = self._robot.read()
        if self._externs:
            live = {name: value for source in self._externs for name, value in source.latest().items()}
            state = replace(state, extern=live)
        self._state = state
        remote: RemoteCommand | None = self._remote.latest() if self._remote else None
        tick_input = TickInput(state, self._safety_filter(safety), intents, remote)
        self._memory, self._output = self._supervisor.step(self._memory, tick_input)
        qpos = self._qpos() if self._qpos else None
        decided = perf_counter()
        self._robot.write(self._output.command)
        written = perf_counter()
        overrun = self._next_deadline(start, written)
        duration = (decided if self._settings.simulated else written) - start
        record = TickRecord(self._index, tick_input, self._output, duration, overrun, qpos)
        self._index += 1
        for sink in self._sinks:
            sink.tick(record)
        self._wait()

    def _next_deadline(self, start: float, now: float) -> bool:
        """Set the deadline of the next tick; whether this tick missed its own.

        A missed deadline is skipped, never caught up. Without real time there are none, and a tick that took longer
        than a control period counts instead.
        """
        period = self._settings.control_period
        if not self._settings.realtime:
            overrun = now - start > period
            self._overruns += overrun
            return overrun
        self._deadline += period
        late = now - self._deadline
        if late <= 0.0:
            return False
        missed = int(late / period) + 1
        self._deadline += missed * period
        self._overruns += 1
        self._skipped += missed
        return True

    def _wait(self) -> None:
        """Wait for the deadline; without real time only for sinks that lag far behind."""
        if not self._settings.realtime:
            while any(sink.backlog > _BACKLOG_LIMIT for sink in self._sinks):
                sleep(self._settings.control_period)
            return
        while (left := self._deadline - perf_counter()) > 0.0:
            if left > _SPIN:
                sleep(left - _SPIN)

    def _announce(self, text: str) -> None:
        for sink in self._sinks:
            sink.event(self.time, text)

    def _damp_now(self) -> None:
        """Last resort after an exception: the fallback's commands until the joints rest, with nothing but the robot.

        Sources and sinks are left out, because one of them may be what broke.
        """
        state = self._state
        left = round(self._settings.damping_time / self._settings.control_period)
        intents: tuple[Intent, ...] = (Intent.DAMP,)
        if self._memory.controller == "zero_torque_controller":
            left, intents = 0, ()
        while True:
            with contextlib.suppress(Exception):  # the first exception is the one that is reported
                state, _ = self._robot.read()
            self._state = state
            self._memory, output = self._supervisor.step(self._memory, TickInput(state, intents=intents))
            self._robot.write(output.command)
            if left <= 0 or self._is_at_rest():
                return
            left, intents = left - 1, ()
            if self._settings.realtime:
                sleep(self._settings.control_period)
