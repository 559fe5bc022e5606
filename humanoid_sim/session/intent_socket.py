"""Intents from other programs on the machine: a Unix datagram socket that only its user can reach.

It carries intents, `reactivate`, selections of a policy, pushes of a simulated robot, safety statuses and marks alone,
so that no flood of data keeps a DAMP waiting: it is drained completely in every tick before anything else comes in.
`humanoid_sim.client.Intake.ask` is the other end.
"""

from __future__ import annotations

import contextlib
import math
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from humanoid_sim.client import Answer, monotonic_ns
from humanoid_sim.controllers.fsm import granted_intent
from humanoid_sim.errors import FieldError, InputError, blaming, number_in
from humanoid_sim.messages import Intent, Mode, TickOutput, TickRecord
from humanoid_sim.session.outside_safety import OutsideSafety
from humanoid_sim.session.reactivation import REACTIVATE, RESET, Reactivation
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import IntentSource, PolicySelection, printable

MARK = "mark"  # followed by a text for the recording
POLICY = "policy"  # followed by the name of a loaded policy
PUSH = "push"  # followed by VX,VY in m/s, and perhaps a body
_SAFETY = "safety"  # followed by a status as JSON
_INTENTS = {intent.value: intent for intent in Intent}
_FRESH = frozenset({*_INTENTS, REACTIVATE, RESET, POLICY, PUSH}) - {Intent.DAMP.value}
"""Words that count only if they were meant for the robot as it is."""
_LONGEST = 1 << 14  # bytes; no message is longer
_MOST_ANSWERS = 64  # senders that are answered in one tick: more are a flood
_MOST_LINES = 10  # events in a second


class LimitedLog:
    """Records at most so many lines a second: what other programs do may be worth one in every tick."""

    def __init__(self, tell: Callable[[str], object], clock: Callable[[], float]) -> None:
        self._tell, self._clock = tell, clock
        self._second, self._count = 0, 0

    def __call__(self, text: str) -> bool:
        second = int(self._clock())
        self._count = self._count + 1 if second == self._second else 1
        self._second = second
        if self._count > _MOST_LINES:
            return False
        self._tell(text)
        return True


def queue_length() -> int:
    """Return the number of datagrams that a Unix socket holds before its senders must wait."""
    return int(Path("/proc/sys/net/unix/max_dgram_qlen").read_text(encoding="ascii"))


def listening(path: Path) -> socket.socket:
    """Return a non-blocking datagram socket at a path. Raises `InputError` if it cannot be opened."""
    end = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
    try:
        with blaming(f"{path}: cannot listen", OSError):
            end.bind(str(path))
    except InputError:
        end.close()
        raise
    return end


class _Request(NamedTuple):
    word: str
    rest: str
    who: str
    token: str  # the request's own, which its answer repeats
    seen: int  # ns, when what its sender had seen was so
    sender: object  # address for the answer

    @property
    def intent(self) -> Intent | None:
        return None if self.rest else _INTENTS.get(self.word)


def _read(message: bytes, sender: object) -> _Request:
    lines = [printable(line) for line in message.decode(errors="replace").split("\n")]
    text, who, token, seen = (*lines, "", "", "")[:4]
    word, _, rest = text.partition(" ")
    return _Request(word, rest, who[:80] or "somebody", token, int(seen[:20]) if seen.isdecimal() else 0, sender)


class _Freshness:
    """Refuses what was requested for the robot as it was some time ago, or before it was last damped."""

    OLDEST = 0.5  # s, of CLOCK_MONOTONIC

    def __init__(self) -> None:
        self._polled = self._entered = 0
        self._mode = Mode.ZERO_TORQUE

    def poll(self, output: TickOutput | None) -> None:
        """Note the mode of the previous tick, before anything is judged."""
        mode, now = Mode.ZERO_TORQUE if output is None else output.control_mode.mode, monotonic_ns()
        if mode is not self._mode and mode in (Mode.DAMPING, Mode.ZERO_TORQUE):
            # The tick that entered it polled before it was published; a fresh start happens between two ticks.
            self._entered = now if output is None else self._polled
        self._mode, self._polled = mode, now

    def problem(self, seen: int) -> str:
        """Return why a request does not count whose sender saw the robot at `seen`, ns; empty if it does."""
        age = 1e-9 * (monotonic_ns() - seen)
        if not 0.0 <= age <= self.OLDEST:
            return f"too late, meant for the robot of {age:.2f} s ago, at most {self.OLDEST:g} s; look, and ask again"
        if seen < self._entered:
            return f"the robot went to {self._mode.name} meanwhile, which its sender had not seen; look, and ask again"
        return ""


class IntentSocket(IntentSource, Sink):
    """A source of intents, and a sink that learns what became of them."""

    def __init__(
        self,
        path: Path,
        reactivation: Reactivation | None = None,
        tell: Callable[[str], None] = lambda _: None,
        safety: OutsideSafety | None = None,
        push: Callable[[float, float, str], None] | None = None,
        selection: PolicySelection | None = None,
    ) -> None:
        """Open the socket. Raises `InputError` if it cannot be opened.

        Args:
            tell: records a line: who requested what, and marks.
            push: pushes a simulated robot by vx and vy, m/s, at a body, '' for the base; None for motors.
        """
        self._socket, self._most = listening(path), queue_length() + 1
        self._reactivation, self._safety, self._push = reactivation or Reactivation(), safety or OutsideSafety({}), push
        self._selection = selection or PolicySelection()
        self._time = 0.0
        self._tell = LimitedLog(tell, lambda: self._time)
        self._waiting: list[_Request] = []
        self._reactivating: list[_Request] = []
        self._freshness = _Freshness()

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Return all intents since the last call; what else was requested is done, or waits for the tick."""
        self._time = time
        self._freshness.poll(output)
        intents: list[Intent] = []
        answers: list[tuple[_Request, Answer]] = []
        for _ in range(self._most):
            try:
                request = _read(*self._socket.recvfrom(_LONGEST))
            except OSError:  # nothing more
                break
            problem = self._freshness.problem(request.seen) if request.word in _FRESH else ""
            if not problem and request.intent is not None:
                intents.append(request.intent)
                self._waiting.append(request)
                self._tell(f"{request.intent.name} requested by {request.who}")
                continue
            try:
                answer = self._serve(request, problem)
            except (FieldError, InputError) as error:
                answer = Answer(False, f"{request.word[:40].upper()} refused: {error}")
                self._tell(f"{answer.text}; requested by {request.who}")
            if answer is not None:
                answers.append((request, answer))
        _send(answers)
        return intents

    def _serve(self, request: _Request, problem: str) -> Answer | None:
        word, rest = request.word, request.rest
        is_simulated = self._push is not None
        if problem:
            raise InputError(problem)
        if word == REACTIVATE or (word == RESET and is_simulated):
            self._reactivation.request(is_reset=word == RESET)
            self._reactivating.append(request)
            return None
        if word == POLICY and rest:
            self._selection.wanted = rest
            self._waiting.append(request)
            return None
        if word == _SAFETY:
            return Answer(True, self._safety.report(rest))
        if word == PUSH and is_simulated:
            return self._pushed(request)
        if word == MARK:
            is_recorded = self._tell(f"mark of {request.who}: {rest}".rstrip(": "))
            return Answer(is_recorded, "marked" if is_recorded else "not marked: too many lines in a second")
        simulated = (PUSH, RESET) if is_simulated else ()
        known = ", ".join([*_INTENTS, REACTIVATE, f"{POLICY} NAME", _SAFETY, MARK, *simulated])
        raise InputError(f"means nothing, expected one of {known}")

    def _pushed(self, request: _Request) -> Answer:
        assert self._push is not None
        first, _, body = request.rest.partition(" ")
        numbers = [number_in(number) for number in first.split(",")]
        if len(numbers) != 2 or any(map(math.isnan, numbers)):
            raise InputError(f"is '{request.rest[:40]}', expected VX,VY in m/s, and a body")
        self._push(numbers[0], numbers[1], body)
        text = f"pushed{body and f' at {body}'} by {first} m/s"
        self._tell(f"{text}; requested by {request.who}")
        return Answer(True, text)

    def tick(self, record: TickRecord) -> None:
        """Answer the requests that this tick decided."""
        if self._waiting:
            control = record.output.control_mode
            text = f"{control.mode.name} ({control.controller_name}): {control.status_message}"
            # DAMP first: of a flood only so many are answered.
            waiting = sorted(self._waiting, key=lambda request: request.intent is not Intent.DAMP)
            _send([(request, Answer(_is_granted(request, record), text)) for request in waiting])
            self._waiting.clear()
        if self._reactivation.answer is not None:
            answer = self._reactivation.answer
            _send([(request, answer) for request in self._reactivating])
            self._reactivating.clear()

    def close(self) -> None:
        _send([(request, Answer(True, "the session has ended")) for request in (*self._waiting, *self._reactivating)])
        self._waiting.clear()
        self._reactivating.clear()
        self._socket.close()


def _is_granted(request: _Request, record: TickRecord) -> bool:
    output = record.output
    if request.intent is Intent.DAMP:  # granted if the robot is damped, whatever else came in that tick
        return output.control_mode.mode in (Mode.DAMPING, Mode.ZERO_TORQUE)
    if request.word == POLICY:
        is_refused = any(text.startswith("policy ") for text in output.refusals)
        return request.rest == record.input.policy and not is_refused
    return request.intent is granted_intent(record.input.intents, output.refusals)


def _send(answers: Sequence[tuple[_Request, Answer]]) -> None:
    """Send from a socket of its own: answers that nobody takes would fill that of the intents."""
    if not answers:
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as end:
        for request, answer in answers[:_MOST_ANSWERS]:
            if isinstance(request.sender, str):
                with contextlib.suppress(OSError):  # the sender did not wait, or has no name
                    end.sendto(f"{answer.granted:d}{request.token}\n{answer.text}".encode(), request.sender)
