"""The only place where the tests of session, operator and front ends touch names of the product.

A rewrite of session/, play/ or frontends/ changes this file and no test in tests/survive/.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import numpy as np

from humanoid_sim.messages import Event, Intent, SessionHeader, TickInput, TickOutput, TickRecord
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.losses import Interruption
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.session import Session
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import IntentSource
from humanoid_sim.stack import build_supervisor

_LITE = load_robot("lite")
JOINTS = _LITE.joint_names
REST_POSITION = np.array(_LITE.initial_position)
"""Shape (n,), rad: a pose within every limit."""
PERIOD = 0.02
"""s between two ticks of a `FakeRun`."""


# The loop alone, on a fake robot.


class VirtualClock:
    """Time passes when somebody sleeps, and a little with every look at the clock."""

    now = 100.0
    """s"""

    def read(self) -> float:
        self.now += 1e-6
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@dataclass(frozen=True)
class Ended:
    """Outcome of a run."""

    ticks: int
    overruns: int
    skipped: int
    """Deadlines that passed while a tick was still running."""
    failures: tuple[str, ...]
    """Parts that failed while the run went on."""


class FakeRun:
    """The control loop with the Lite's controllers on a fake robot; `run` blocks until it has ended."""

    def __init__(
        self,
        robot: Any,
        *,
        sinks: Sequence[Any] = (),
        intents: Callable[[int], Sequence[Intent]] = lambda _: (),
        on_step: Callable[[TickInput], object] = lambda _: None,
        duration: float | None = None,
        clock: VirtualClock | None = None,
    ) -> None:
        """Put the parts together; nothing moves yet.

        Args:
            robot: has `joints`, `activate`, `read`, `write` and `close`.
            sinks: each has `tick(record)`, `event(text)` and `close()`.
            intents: returns those of a poll by its number, one poll a tick.
            on_step: called with what the control stack is about to decide on.
            duration: s on the robot's clock; None: until QUIT or `stop`.
            clock: real time is kept on it, and a standstill of the process noticed; None: without real time.
        """
        supervisor = build_supervisor(_LITE, PERIOD, None)
        kind = type(supervisor)
        step = kind.step

        def stepped(self: Any, memory: Any, tick_input: TickInput) -> Any:
            on_step(tick_input)
            return step(self, memory, tick_input)

        self._clock = clock
        self._patches = [patch.object(kind, "step", stepped)]
        sources: list[IntentSource] = [_Source(intents)]
        interruption = None
        if clock is not None:
            interruption = Interruption(PERIOD, 0.1, clock=lambda: clock.now)
            sources.insert(0, interruption)
            for module in ("session", "pace"):
                self._patches.append(patch(f"humanoid_sim.session.{module}.perf_counter", clock.read))
                self._patches.append(patch(f"humanoid_sim.session.{module}.sleep", clock.sleep))
        self._session = Session(
            robot,
            supervisor,
            LoopSettings(PERIOD, realtime=clock is not None, duration=duration),
            header=SessionHeader("lite", JOINTS, PERIOD, 0),
            intents=sources,
            sinks=[_Sink(sink) for sink in sinks],
            interruption=interruption,
        )

    def stop(self, reason: str = "SIGTERM") -> None:
        """End the run, as the handler of a signal does."""
        self._session.request_stop(reason)

    def run(self) -> Ended:
        with ExitStack() as stack:
            for one in self._patches:
                stack.enter_context(one)
            result = self._session.run()
        return Ended(result.ticks, result.overruns, result.skipped, tuple(result.failures))


class _Source(IntentSource):
    def __init__(self, intents: Callable[[int], Sequence[Intent]]) -> None:
        self._intents, self._polls = intents, 0

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        self._polls += 1
        return self._intents(self._polls - 1)


class _Sink(Sink):
    def __init__(self, sink: Any) -> None:
        self._sink = sink

    def tick(self, record: TickRecord) -> None:
        self._sink.tick(record)

    def event(self, event: Event) -> None:
        self._sink.event(event.text)

    def close(self) -> None:
        self._sink.close()
