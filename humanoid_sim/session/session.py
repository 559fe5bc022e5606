"""The control loop: read, collect, step, write, hand out, wait for the deadline.

Everything that decides is in `Supervisor.step`. This loop only moves data, keeps time, and makes sure that however a
run ends the robot is damped and then closed.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from time import perf_counter, sleep

from humanoid_sim.controllers.base import DAMPING, Fault
from humanoid_sim.controllers.parameters import command_problem
from humanoid_sim.controllers.supervisor import NOT_DRIVEN, STARTED, Supervisor, SupervisorMemory
from humanoid_sim.errors import RobotError
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
from humanoid_sim.mit import FloatArray, MITCommand, MITState
from humanoid_sim.recording.sink import Sink
from humanoid_sim.robots.robot import Robot
from humanoid_sim.session.losses import Interruption
from humanoid_sim.session.pace import LoopSettings, Pace
from humanoid_sim.session.realtime import punctual_threads, real_time
from humanoid_sim.session.requests import Requests
from humanoid_sim.session.rest import RestDetector
from humanoid_sim.session.sinks import SinkGroup
from humanoid_sim.session.sources import ExternSource, IntentSource

_DAMPING_TIME = 3.0  # s at most that the end of a run stays in DAMPING for the joints to come to rest


@dataclass(frozen=True, slots=True)
class SessionResult:
    """Outcome of a run."""

    ticks: int
    reason: str
    duration: float  # s on the robot's clock
    wall_time: float  # s
    overruns: int
    skipped: int  # deadlines that passed while a tick was still running
    failures: tuple[str, ...]
    """A robot that is not confirmed to be without torque; sinks that raised on the control thread."""


@dataclass(eq=False)
class Session:
    """Owns a robot and its loop for one run; nothing moves before `run`."""

    robot: Robot
    supervisor: Supervisor
    settings: LoopSettings
    _: KW_ONLY
    header: SessionHeader
    intents: Sequence[IntentSource] = ()
    remote: Callable[[], RemoteCommand | None] = lambda: None
    externs: Sequence[ExternSource] = ()  # live inputs beside those of the robot
    sinks: Sequence[Sink] = ()
    safety_filter: Callable[[tuple[SafetyStatus, ...]], tuple[SafetyStatus, ...]] = lambda statuses: statuses
    """From the statuses that the robot reports to those that the supervisor sees."""
    qpos: Callable[[], FloatArray] | None = None  # MuJoCo's generalised position, for viewers
    mode_listener: Callable[[Mode], str] | None = None
    """Called with each new mode before its first command is written; returns a line to record."""
    requests: Requests = field(default_factory=Requests)
    interruption: Interruption | None = None  # notices that the loop stood still; one of `intents` too

    def __post_init__(self) -> None:
        self._group = SinkGroup(self.sinks, lambda: self.time)
        self._pace = Pace(self.settings.control_period, self.settings.realtime)
        self._failures: list[str] = []
        self._stop_reason = ""
        self._hurries = False  # no Event: signal handlers take no lock
        self.memory: SupervisorMemory = self.supervisor.initial()  # the control stack's after the last tick
        self.state = MITState.unknown(len(self.robot.joints))  # the robot's as last read
        self._output: TickOutput | None = None
        self._announced: Mode | None = None
        self._ticks = 0
        self._first_time: float | None = None

    @property
    def time(self) -> float:
        """s, the robot's clock as of the last reading."""
        return float(self.state.time)

    @property
    def mode(self) -> Mode:
        """The mode of the last tick; ZERO_TORQUE before the first."""
        return Mode.ZERO_TORQUE if self._output is None else self._output.control_mode.mode

    @property
    def is_ending(self) -> bool:
        return bool(self._stop_reason)

    def event(self, text: str, kind: EventKind = EventKind.NOTE) -> None:
        """Hand something that happened to the sinks, now; may be called from any thread."""
        self._group.event(text, kind)

    def request_stop(self, reason: str) -> None:
        """End the run through DAMPING. May be called from a signal handler; a second call does not wait for rest."""
        if self._stop_reason:
            self._hurries = True
        self._stop_reason = self._stop_reason or reason

    def run(self) -> SessionResult:
        """Activate the robot, and loop until the end; whatever ends the run, the robot is damped and closed.

        Raises `RobotError` if the robot cannot be activated, `InputError` if a sink cannot start.
        """
        begin = perf_counter()
        # Left in reverse: the robot is closed before any sink may take its time.
        with contextlib.ExitStack() as stack, contextlib.ExitStack() as robot:
            robot.callback(self._close_robot)
            with contextlib.nullcontext() if self.settings.simulated else punctual_threads(behind=20):
                self._group.start(self.header, stack)
            if not self.settings.simulated:
                self.event(f"real-time settings: {'; '.join(stack.enter_context(real_time()))}")
            self.robot.activate()
            try:
                self._loop()
                self._rest()
            except BaseException as error:
                self._damp_now()
                self.event(f"ended by {type(error).__name__}: {error}", EventKind.FAILURE)
                raise
        first = self.time if self._first_time is None else self._first_time
        return SessionResult(
            ticks=self._ticks,
            reason=self._stop_reason,
            duration=self.time - first + self.settings.control_period * bool(self._ticks),
            wall_time=perf_counter() - begin,
            overruns=self._pace.overruns,
            skipped=self._pace.skipped,
            failures=(*self._failures, *self._group.failures),
        )

    def _loop(self) -> None:
        period, limit = self.settings.control_period, self.settings.duration
        while not self._stop_reason:
            if self.requests.is_reactivation:
                self._begin_afresh()
            self.tick()
            if self._first_time is None:
                self._first_time = self.time
            if self._output is not None and self._output.quit:
                self._stop_reason = "QUIT"
            elif limit is not None and self.time - self._first_time >= limit - 0.5 * period:
                self._stop_reason = f"duration of {limit:g} s reached"
            elif any(source.finished for source in self.intents):
                self._stop_reason = "script finished"

    def _begin_afresh(self) -> None:
        kind, answer = self.requests.serve(self.robot, self.mode)
        if self.interruption is not None:
            self.interruption.restart()
        if kind is EventKind.FRESH_START:
            self.memory = self.supervisor.initial(STARTED if answer.granted else NOT_DRIVEN)
            self._output = self._announced = None
            self._pace.restart()
        self.event(answer.text, kind)
        # What was requested while the robot was busy was meant for the state before; DAMP is meant always.
        if self._output is None and Intent.DAMP in self._collect():
            self.tick((Intent.DAMP,))

    def _rest(self) -> None:
        if self._output is None:
            return
        self.event(f"ending: {self._stop_reason}", EventKind.ENDING)
        if self.mode is not Mode.ZERO_TORQUE:
            rest = RestDetector(self.settings.control_period)
            left = round(_DAMPING_TIME / self.settings.control_period)
            self.tick((Intent.DAMP,))
            while left > 0 and not self._hurries and not rest.update(self.state):
                self._collect()  # nothing is granted any more, but requests are answered
                self.tick(())
                left -= 1
        self.tick((Intent.QUIT,))

    def _collect(self) -> tuple[Intent, ...]:
        time, output = self.time, self._output
        return tuple(intent for source in self.intents for intent in source.poll(time, output))

    def tick(self, intents: tuple[Intent, ...] | None = None) -> None:
        """Take one tick with these intents; None: those of the sources. `run` calls it."""
        start = perf_counter()
        memory = self.memory
        tick_input, output = self._decide(intents)
        if intents is None and self.interruption is not None and self.interruption.stood_still():
            self.memory = memory  # decided before the process stood still, and not yet sent: never to be sent
            tick_input, output = self._decide(None)
        mode = output.control_mode.mode
        if self.mode_listener is not None and mode is not self._announced:
            self._announced = mode
            text = self.mode_listener(mode)
            if text:
                self.event(text, EventKind.SUPPORT)
        qpos = self.qpos() if self.qpos else None
        decided = perf_counter()
        self.robot.write(output.command)
        written = perf_counter()
        overrun = self._pace.written(start, written)
        duration = (decided if self.settings.simulated else written) - start
        self._group.tick(TickRecord(self._ticks, tick_input, output, duration, overrun, qpos))
        self._ticks += 1
        if self.settings.realtime:
            self._pace.wait()

    def _decide(self, intents: tuple[Intent, ...] | None) -> tuple[TickInput, TickOutput]:
        state, safety = self.robot.read()
        self.state = state
        chosen = self._collect() if intents is None else intents  # before any data: no flood keeps a DAMP waiting
        live = {name: value for source in self.externs for name, value in source.latest().items()}
        if live:
            self.state = state = replace(state, extern={**state.extern, **live})
        tick_input = TickInput(state, self.safety_filter(safety), chosen, self.remote(), self.requests.take_policy())
        self.memory, self._output = self.supervisor.step(self.memory, tick_input)
        return tick_input, self._output

    def _close_robot(self) -> None:
        try:
            self.robot.close()
        except RobotError as error:
            self._failures.append(f"robot: {error}")
            self.event(f"failed to close the robot: {error}", EventKind.FAILURE)

    def _damp_now(self) -> None:
        """Send DAMPING's command until the joints rest, after something broke; else zero torque.

        Whatever fails here, the next tick tries again: a bus that lost one frame may take the next, and the exception
        that brought the run here is the one that is reported.
        """
        period, interrupted, ticks = self.settings.control_period, None, 0
        rest, command = RestDetector(period), MITCommand.zeros(len(self.robot.joints))
        if self.mode is not Mode.ZERO_TORQUE:
            ticks = round(_DAMPING_TIME / period)
            with contextlib.suppress(Exception):
                command = self._damping_command() or command
        for _ in range(ticks + 1):
            try:
                with contextlib.suppress(Exception):
                    self.state, _ = self.robot.read()
                with contextlib.suppress(Exception):
                    self.robot.write(command)
                if rest.update(self.state):
                    break
                if self.settings.realtime and ticks:
                    sleep(period)
            except BaseException as error:  # an impatient Ctrl-C: the robot is damped first
                interrupted = interrupted or error
        if interrupted is not None:
            raise interrupted

    def _damping_command(self) -> MITCommand | None:
        controller, tick_input = self.supervisor.controllers[DAMPING], TickInput(self.state)
        memory = controller.activate(tick_input)
        result = memory if isinstance(memory, Fault) else controller.update(memory, tick_input)
        return None if isinstance(result, Fault) or command_problem(result[1], self.robot.joints) else result[1]
