"""The control loop: read, collect, step, write, hand out, wait for the deadline.

Everything that decides is in `Supervisor.step`. This loop only moves data, keeps time, and makes sure that however a
run ends the robot is damped and then closed.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter, sleep
from typing import TypeAlias

from humanoid_sim.controllers.base import Controller
from humanoid_sim.controllers.live_inputs import LiveInputs
from humanoid_sim.controllers.supervisor import NOT_DRIVEN, STARTED, Supervisor, SupervisorMemory
from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.messages import (
    EventKind,
    Intent,
    Mode,
    RemoteCommand,
    SafetyStatus,
    SessionHeader,
    TickInput,
    TickOutput,
    TickRecord,
)
from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.robots.robot import Robot
from humanoid_sim.session.losses import Interruption
from humanoid_sim.session.pace import DurationHistogram, LoopSettings, Pace
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.realtime import punctual_threads, real_time
from humanoid_sim.session.rest import RestDetector, damp_without_supervisor
from humanoid_sim.session.simulation_controls import SimulationControls
from humanoid_sim.session.sinks import Sink, SinkGroup
from humanoid_sim.session.sources import ExternSource, IntentSource, PolicySelection, RemoteSource

_PATIENCE = 0.001
"""s between two looks at a sink that lags."""


@dataclass(frozen=True, slots=True)
class SessionResult:
    """Outcome of a run."""

    ticks: int
    reason: str
    duration: float
    """s on the robot's clock."""
    wall_time: float
    """s"""
    overruns: int
    skipped: int
    """Deadlines that passed while a tick was still running."""
    jitter: DurationHistogram
    """Delay of each tick's start after its due time; empty without real time."""
    measures: tuple[str, ...] = ()
    """Measures taken for timely scheduling, one line each."""
    failures: tuple[str, ...] = ()
    """A robot that is not confirmed to be without torque; sinks that raised on the control thread, and were left out
    from then on, each with its exception."""


SafetyFilter: TypeAlias = Callable[[tuple[SafetyStatus, ...]], tuple[SafetyStatus, ...]]
"""From the statuses that the robot reports to those that the supervisor sees."""


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
        live: LiveInputs | None = None,
        sinks: Sequence[Sink] = (),
        safety_filter: SafetyFilter = lambda statuses: statuses,
        qpos: Callable[[], FloatArray] | None = None,
        mode_listener: Callable[[Mode], str] | None = None,
        reactivation: Reactivation | None = None,
        interruption: Interruption | None = None,
        simulation: SimulationControls | None = None,
        selection: PolicySelection | None = None,
    ) -> None:
        """Put the parts together; nothing moves before `run`.

        Args:
            externs: live inputs beside those of the robot.
            live: likewise, made of each tick's state.
            safety_filter: adds to what the robot reports.
            qpos: MuJoCo's generalised position, for viewers.
            mode_listener: told of each new mode before its first command is written; what it answers, if anything, is
                recorded as an event.
            interruption: notices that the loop stood still; one of the sources of `intents` too.
            simulation: what operators may ask of a simulation alone; None for motors.
            selection: requests for another of the loaded policies.
        """
        self._robot = robot
        self._supervisor = supervisor
        self._settings = settings
        self._header = header
        self._intents = tuple(intents)
        self._remote = remote
        self._externs = tuple(externs)
        self._live = live
        self._sinks = SinkGroup(sinks, lambda: self.time)
        self._safety_filter = safety_filter
        self._qpos = qpos
        self._mode_listener = mode_listener
        self._reactivation = reactivation
        self._interruption = interruption
        self._simulation = simulation or SimulationControls()
        self._selection = selection or PolicySelection()
        self._failures: list[str] = []
        self._stop_reason = ""
        self._hurry = threading.Event()
        self.memory: SupervisorMemory = supervisor.initial()
        """The control stack's memory after the last tick."""
        self._output: TickOutput | None = None
        self.state = MITState.unknown(len(robot.joints))
        """The robot's state as last read."""
        self._index = 0
        self._ticks = 0
        self._pace = Pace(settings.control_period, realtime=settings.realtime)
        self._first_time: float | None = None

    @property
    def time(self) -> float:
        """s, the robot's clock as of the last reading; other threads may ask."""
        return float(self.state.time)

    @property
    def mode(self) -> Mode:
        """The mode of the last tick; ZERO_TORQUE before the first."""
        return Mode.ZERO_TORQUE if self._output is None else self._output.control_mode.mode

    @property
    def controllers(self) -> Mapping[str, Controller]:
        """Controllers that are available at present, by name."""
        return self._supervisor.controllers

    @property
    def is_ending(self) -> bool:
        """True if something has asked for the end."""
        return bool(self._stop_reason)

    def event(self, text: str, kind: EventKind = EventKind.NOTE) -> None:
        """Hand something that happened outside the ticks to the sinks, now; may be called from any thread."""
        self._sinks.event(text, kind)

    def request_stop(self, reason: str) -> None:
        """End the run through DAMPING. May be called from a signal handler; a second call does not wait for rest."""
        if self._stop_reason:
            self._hurry.set()
        self._stop_reason = self._stop_reason or reason

    def run(self) -> SessionResult:
        """Activate the robot, and loop until the end.

        Whatever ends the run (its duration, QUIT, a signal, an exception), the robot is damped, from ZERO_TORQUE
        directly, and closed; an exception is raised again afterwards.

        Raises:
            RobotError: if the robot cannot be activated.
            InputError: if a sink cannot start.
        """
        begin = perf_counter()
        # Left in reverse: the robot is closed before any sink may take its time.
        with contextlib.ExitStack() as stack, contextlib.ExitStack() as robot:
            robot.callback(self._close_robot)
            with punctual_threads(behind=20) if self._settings.punctual else contextlib.nullcontext():
                self._sinks.start(self._header, stack)
            measures = stack.enter_context(real_time()) if self._settings.punctual else ()
            if measures:
                self._sinks.event(f"real-time settings: {'; '.join(measures)}")
            self._robot.activate()
            try:
                self._loop()
                self._rest()
            except BaseException as error:
                self._damp_now()
                self._sinks.event(f"ended by {type(error).__name__}: {error}", EventKind.FAILURE)
                raise
        first = self.time if self._first_time is None else self._first_time
        return SessionResult(
            ticks=self._ticks,
            reason=self._stop_reason,
            duration=self.time - first + self._settings.control_period * bool(self._ticks),
            wall_time=perf_counter() - begin,
            overruns=self._pace.overruns,
            skipped=self._pace.skipped,
            jitter=self._pace.jitter,
            measures=measures,
            failures=(*self._failures, *self._sinks.failures),
        )

    def _loop(self) -> None:
        """Ticks until something ends the run."""
        period, limit = self._settings.control_period, self._settings.duration
        while not self._stop_reason:
            if self._simulation.takes_reset():
                self._start_over()
            if self._reactivation is not None and self._reactivation.is_asked:
                self._begin_afresh(self._reactivation)
            self.tick()
            if self._first_time is None:
                self._first_time = self.time
            if self._output is not None and self._output.quit:
                self._stop_reason = "QUIT"
            elif limit is not None and self.time - self._first_time >= limit - 0.5 * period:
                self._stop_reason = f"duration of {limit:g} s reached"
            elif any(source.finished for source in self._intents):
                self._stop_reason = "script finished"

    def _start_over(self) -> None:
        """End the recording, and begin another one with the robot at its start."""
        self._sinks.event("ending: reset", EventKind.ENDING)
        try:
            self._simulation.start_over(self._sinks)
        except InputError as error:
            self._failures.append(f"recording: {error}")
            self._sinks.event(f"nothing is recorded from here on: {error}", EventKind.FAILURE)
        self._robot.activate()
        self.memory, self._output, self._index = self._supervisor.initial(), None, 0
        self._pace.restart()
        self._sinks.event("reset: the simulated robot is at its start")

    def _begin_afresh(self, reactivation: Reactivation) -> None:
        """Activate the robot again, if the mode allows it, and put the control stack back to its start."""
        told, kind = reactivation.serve(self._robot, self.mode)
        if self._interruption is not None:
            self._interruption.restart()
        if kind is EventKind.FRESH_START:
            has_failed = reactivation.answer is not None and not reactivation.answer.granted
            self.memory = self._supervisor.initial(NOT_DRIVEN if has_failed else STARTED)
            self._output = None
            self._pace.restart()
        self._sinks.event(told, kind)
        # What was asked for while the robot was busy was meant for the state before; DAMP is meant always.
        if self._output is None and Intent.DAMP in self._collect():
            self.tick((Intent.DAMP,))

    def _rest(self) -> None:
        """DAMPING until the joints are at rest, then QUIT; from ZERO_TORQUE QUIT at once.

        Also after a QUIT: granted in DAMPING, it may come while the arms still fall.
        """
        if self._output is None:
            return
        self._sinks.event(f"ending: {self._stop_reason}", EventKind.ENDING)
        if self.mode is not Mode.ZERO_TORQUE:
            rest = RestDetector(self._settings.control_period)
            left = round(self._settings.damping_time / self._settings.control_period)
            self.tick((Intent.DAMP,))
            while left > 0 and not self._hurry.is_set() and not rest.update(self.state):
                self._collect()  # nothing is granted any more, but whoever asks is answered
                self.tick(())
                left -= 1
        self.tick((Intent.QUIT,))

    def _collect(self) -> tuple[Intent, ...]:
        time, output = self.time, self._output
        return tuple(intent for source in self._intents for intent in source.poll(time, output))

    def tick(self, intents: tuple[Intent, ...] | None = None) -> None:
        """Take one turn of the loop; `run` calls it, and so does whoever wants to drive ticks by hand.

        `intents` are those of this tick; None: those of the sources.
        """
        start = self._pace.begin()
        before, memory = self.mode, self.memory
        tick_input, output = self._decide(intents)
        if self._interruption is not None:
            if intents is None and self._interruption.beat():
                self.memory = memory  # decided before the process stood still, and not yet sent: never to be sent
                tick_input, output = self._decide(intents)
            while told := self._interruption.news():
                self._sinks.event(told)
        if self._mode_listener is not None and (self.mode is not before or self._index == 0):
            told = self._mode_listener(self.mode)
            if told:
                self._sinks.event(told, EventKind.SUPPORT)
        qpos = self._qpos() if self._qpos else None
        decided = perf_counter()
        self._robot.write(output.command)
        written = perf_counter()
        overrun = self._pace.written(start, written)
        duration = (decided if self._settings.simulated else written) - start
        record = TickRecord(self._index, tick_input, output, duration, overrun, qpos)
        self._index += 1
        self._ticks += 1
        self._sinks.tick(record)
        self._wait()

    def _decide(self, intents: tuple[Intent, ...] | None) -> tuple[TickInput, TickOutput]:
        """Read, collect and step: what the tick takes in, and what the control stack makes of it."""
        state, safety = self._robot.read()
        self.state = state
        chosen = self._collect() if intents is None else intents  # before any data: no flood keeps a DAMP waiting
        if self._externs:
            live = {name: value for source in self._externs for name, value in source.latest().items()}
            state = replace(state, extern={**state.extern, **live})
        if self._live is not None:
            state = self._live.extend(state)
        self.state = state
        remote: RemoteCommand | None = self._remote.latest() if self._remote else None
        tick_input = TickInput(state, self._safety_filter(safety), chosen, remote, self._selection.take())
        self.memory, self._output = self._supervisor.step(self.memory, tick_input)
        return tick_input, self._output

    def _wait(self) -> None:
        """Wait for the deadline; without real time only for sinks that lag far behind."""
        if self._settings.realtime:
            self._pace.wait()
            return
        while self._sinks.lags() and not self._stop_reason:
            sleep(_PATIENCE)

    def _close_robot(self) -> None:
        """Close the robot; one that does not confirm it makes the run a failure, but its figures still count."""
        try:
            self._robot.close()
        except RobotError as error:
            self._failures.append(f"robot: {error}")
            self._sinks.event(f"failed to close the robot: {error}", EventKind.FAILURE)

    def _damp_now(self) -> None:
        """Last resort after an exception; sources and sinks are left out, because one of them may be what broke."""
        settings = self._settings
        self.state = damp_without_supervisor(
            self._robot,
            self._supervisor.controllers,
            self.state,
            period=settings.control_period,
            longest=0.0 if self.mode is Mode.ZERO_TORQUE else settings.damping_time,
            pause=sleep if settings.realtime else None,
        )
