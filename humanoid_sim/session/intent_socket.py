"""Intents from other programs on the machine: a Unix datagram socket that only its user can reach.

It carries intents, `reactivate`, selections of a policy, pushes of a simulated robot and safety statuses alone, so that
no flood of data keeps a DAMP waiting: it is drained completely in every tick before anything else comes in.
`humanoid_sim.client.Intake.ask` is the other end.
"""

from __future__ import annotations

import contextlib
import math
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from humanoid_sim.client import Answer, monotonic_ns
from humanoid_sim.controllers.fsm import refused
from humanoid_sim.errors import FieldError, InputError, number_in
from humanoid_sim.messages import Intent, Mode, TickOutput, TickRecord
from humanoid_sim.recording.sink import Sink
from humanoid_sim.session.datagrams import Mailbox, Message, read_message
from humanoid_sim.session.outside_safety import OutsideSafety
from humanoid_sim.session.requests import REACTIVATE, RESET, Requests
from humanoid_sim.session.sources import IntentSource

_INTENTS = {intent.value: intent for intent in Intent}
_FRESH = frozenset({*_INTENTS, REACTIVATE, RESET, "policy", "push"}) - {Intent.DAMP.value}
"""Words that count only if they were meant for the robot as it is."""
_OLDEST = 0.5  # s, of CLOCK_MONOTONIC, since what the sender of such a word had seen


@dataclass(eq=False)
class IntentSocket(IntentSource, Sink):
    """A source of intents, and a sink that learns what became of them.

    Raises `InputError` if the socket cannot be opened.
    """

    path: Path
    requests: Requests = field(default_factory=Requests)
    tell: Callable[[str], None] = lambda _: None  # records a line: who requested what
    safety: OutsideSafety = field(default_factory=lambda: OutsideSafety({}))
    push: Callable[[float, float, str], None] | None = None
    """Pushes a simulated robot by vx and vy, m/s, at a body, '' for the base; None for motors."""

    def __post_init__(self) -> None:
        self._mailbox = Mailbox(self.path)
        self._waiting: list[Message] = []  # requests that a tick decides
        self._mode, self._entered, self._polled = Mode.ZERO_TORQUE, 0, 0

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Return all intents since the last call; what else was requested is done, or waits for the tick."""
        self._note_mode(output)
        intents: list[Intent] = []
        answers: list[tuple[Message, Answer]] = []
        for datagram, sender in self._mailbox.take():
            request = read_message(datagram, sender)
            try:
                answer = self._serve(request, intents)
            except (FieldError, InputError) as error:
                answer = Answer(False, f"{request.word[:40].upper()} refused: {error}")
                self.tell(f"{answer.text}; requested by {request.producer}")
            if answer is None:
                self._waiting.append(request)
            else:
                answers.append((request, answer))
        _send(answers)
        return intents

    def _note_mode(self, output: TickOutput | None) -> None:
        """Note when the robot became passive: what was meant for it before does not count after."""
        mode, now = Mode.ZERO_TORQUE if output is None else output.control_mode.mode, monotonic_ns()
        if mode is not self._mode and mode in (Mode.DAMPING, Mode.ZERO_TORQUE):
            # The tick that entered it polled before it was published; a fresh start happens between two ticks.
            self._entered = now if output is None else self._polled
        self._mode, self._polled = mode, now

    def _serve(self, request: Message, intents: list[Intent]) -> Answer | None:
        """Do what was requested, or add it to the tick's intents; the answer, or None if the tick decides it."""
        is_simulated = self.push is not None
        if request.word in _FRESH:
            self._require_fresh(request)
        match request.word, request.rest:
            case word, "" if word in _INTENTS:
                intents.append(_INTENTS[word])
                self.tell(f"{word.upper()} requested by {request.producer}")
                return None
            case word, _ if word == REACTIVATE or (word == RESET and is_simulated):
                self.requests.reactivate(is_reset=word == RESET)
                return None
            case "policy", name if name:
                self.requests.policy = name
                return None
            case "safety", status:
                return Answer(True, self.safety.report(status))
            case "push", push if is_simulated:
                return Answer(True, self._pushed(push, request.producer))
        simulated = ("push", RESET) if is_simulated else ()
        known = ", ".join([*_INTENTS, REACTIVATE, "policy NAME", "safety", *simulated])
        raise InputError(f"means nothing, expected one of {known}")

    def _require_fresh(self, request: Message) -> None:
        """Refuse what was meant for the robot as it was some time ago, or before it was last damped."""
        age = request.age()
        if not 0.0 <= age <= _OLDEST:
            raise InputError(
                f"too late, meant for the robot of {age:.2f} s ago, at most {_OLDEST:g} s; look, and ask again"
            )
        if request.stamp < self._entered:
            raise InputError(
                f"the robot went to {self._mode.name} meanwhile, which its sender had not seen; look, and ask again"
            )

    def _pushed(self, push: str, producer: str) -> str:
        assert self.push is not None
        first, _, body = push.partition(" ")
        numbers = [number_in(number) for number in first.split(",")]
        if len(numbers) != 2 or any(map(math.isnan, numbers)):
            raise InputError(f"is '{push[:40]}', expected VX,VY in m/s, and a body")
        self.push(numbers[0], numbers[1], body)
        text = f"pushed{body and f' at {body}'} by {first} m/s"
        self.tell(f"{text}; requested by {producer}")
        return text

    def tick(self, record: TickRecord) -> None:
        """Answer the requests that this tick decided."""
        if not self._waiting:
            return
        decided = [(request, self._decided(request, record)) for request in self._waiting]
        self._waiting = [request for request, answer in decided if answer is None]
        _send([(request, answer) for request, answer in decided if answer is not None])

    def _decided(self, request: Message, record: TickRecord) -> Answer | None:
        """Return what became of a request in a tick; None if nothing has yet."""
        output, control = record.output, record.output.control_mode
        match request.word:
            case word if word in (REACTIVATE, RESET):
                return self.requests.answer
            case Intent.DAMP.value:  # granted if the robot is damped, whatever else came in that tick
                is_granted = control.mode in (Mode.DAMPING, Mode.ZERO_TORQUE)
            case "policy":
                is_refused = any(text.startswith("policy ") for text in output.refusals)
                is_granted = request.rest == record.input.policy and not is_refused
            case word:
                intent = _INTENTS[word]
                is_refused = any(text.startswith(refused(intent, "")) for text in output.refusals)
                is_granted = intent in record.input.intents and not is_refused
        return Answer(is_granted, f"{control.mode.name} ({control.controller_name}): {control.status_message}")

    def close(self) -> None:
        done = (Intent.DAMP.value, Intent.QUIT.value)
        _send([(request, Answer(request.word in done, "the session has ended")) for request in self._waiting])
        self._mailbox.close()


def _send(answers: Sequence[tuple[Message, Answer]]) -> None:
    """Send from a socket of its own: answers that nobody takes would fill that of the intents."""
    if not answers:
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as end:
        for request, answer in answers:
            with contextlib.suppress(OSError):  # the sender did not wait, or gave no address
                end.sendto(f"{answer.granted:d}{request.token}\n{answer.text}".encode(), request.sender)
