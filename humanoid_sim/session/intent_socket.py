"""Intents from other programs on the machine: a Unix datagram socket that only its user can reach.

It carries intents, `reactivate`, selections of a policy, a simulation's controls, safety statuses and marks alone, so
no flood of data can keep a DAMP waiting. It is drained completely in every tick before anything else comes in, and all
of it answered.
What was asked for too long ago is refused there, before the supervisor sees it: see `sources.Freshness`.
`humanoid_sim.client.Intake.ask` is the other end.
"""

from __future__ import annotations

import math
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from humanoid_sim.client import Answer
from humanoid_sim.controllers.fsm import granted_intent
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.messages import Intent, Mode, TickOutput, TickRecord
from humanoid_sim.session.outside_safety import OutsideSafety
from humanoid_sim.session.reactivation import REACTIVATE, Reactivation
from humanoid_sim.session.simulation_controls import PUSH, SIMULATION_WORDS, SimulationControls
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import Freshness, IntentSource, PolicySelection

MARK = "mark"
"""Followed by a text, puts that text into the recording."""
_SAFETY = "safety"
"""Followed by a status as JSON, says how another program is."""
POLICY = "policy"
"""Followed by the name of a loaded policy, selects it."""
_FRESH = frozenset({*(one.value for one in Intent), REACTIVATE, POLICY, *SIMULATION_WORDS}) - {Intent.DAMP.value}
"""Words that count only if they were meant for the robot as it is."""
_LONGEST = 1 << 14
"""Bytes; no message is longer."""
_LONGEST_NAME = 80
"""Characters of a sender's or a policy's name."""
_MOST_ANSWERS = 64
"""Senders that are answered in one tick: more are a flood."""
_MOST_LINES = 10
"""Per second, and at once, that the events get from a socket: what other programs do may be worth one in every tick."""
_QUEUE_LENGTH = Path("/proc/sys/net/unix/max_dgram_qlen")


class RateLimit:
    """So many a second, and so many at once."""

    def __init__(self, rate: float, burst: int) -> None:
        """Begin with the whole burst; `rate` in 1/s."""
        self._rate, self._burst = rate, burst
        self._left, self._time = float(burst), -math.inf

    def admits(self, time: float) -> bool:
        """Return whether one more may pass now; `time` in s."""
        if time > self._time:
            self._left = min(self._left + self._rate * (time - self._time), float(self._burst))
        self._time = time
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class BoundedTelling:
    """Tells a line, unless there were too many."""

    def __init__(self, tell: Callable[[str], None], clock: Callable[[], float]) -> None:
        """Start with a second's lines; `clock` in s."""
        self._tell, self._clock, self._limit = tell, clock, RateLimit(_MOST_LINES, _MOST_LINES)

    def __call__(self, text: str) -> bool:
        """Return whether the line was told."""
        if not self._limit.admits(self._clock()):
            return False
        self._tell(text)
        return True


def queue_length() -> int:
    """Datagrams that a Unix socket holds before its senders must wait."""
    try:
        return int(_QUEUE_LENGTH.read_text())
    except (OSError, ValueError):
        return 512


def listening(path: Path) -> socket.socket:
    """Return a non-blocking datagram socket at a path, for this user alone.

    Raises `InputError` if it cannot be opened.
    """
    end = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        end.setblocking(False)
        path.unlink(missing_ok=True)  # of a process that had this id before and was killed
        end.bind(str(path))
        path.chmod(0o600)
    except OSError as error:
        end.close()
        raise InputError(f"{path}: cannot listen: {error.strerror or error}") from None
    return end


@dataclass(frozen=True, slots=True)
class _Asked:
    """A sender that waits for an answer."""

    intent: Intent | None
    """None for anything else."""
    token: str
    """The question's own, so that no answer is taken for that to another one."""
    sender: str
    policy: str = ""
    """Name of the policy to select."""


def _is_granted(asked: _Asked, record: TickRecord) -> bool:
    given, output = record.input, record.output
    if asked.intent is Intent.DAMP:  # granted if the robot is damped, whatever else came in that tick
        return output.control_mode.mode in (Mode.DAMPING, Mode.ZERO_TORQUE)
    if asked.policy:
        return asked.policy == given.policy and not any(text.startswith("policy ") for text in output.refusals)
    return asked.intent is granted_intent(given.intents, output.refusals)


class IntentSocket(IntentSource, Sink):
    """A source of intents, and a sink that learns what became of them."""

    def __init__(
        self,
        path: Path,
        reactivation: Reactivation | None = None,
        tell: Callable[[str], None] = lambda _: None,
        safety: OutsideSafety | None = None,
        simulation: SimulationControls | None = None,
        selection: PolicySelection | None = None,
    ) -> None:
        """Open the socket. Raises `InputError` if it cannot be opened.

        Args:
            path: where it will be, in a folder that only its user can enter.
            tell: records a line: who asked for what, marks, and safety statuses.
            simulation: what only a simulation can be asked for; None for motors.
            selection: takes requests for another of the loaded policies.
        """
        self._path = path
        self._socket = listening(path)
        self._most = queue_length() + 1
        self._reactivation = reactivation
        self._time = 0.0
        self._tell = BoundedTelling(tell, lambda: self._time)
        self._safety = safety
        self._waiting: list[_Asked] = []
        self._reactivating: list[_Asked] = []
        self._simulation = simulation or SimulationControls()
        self._selection = selection or PolicySelection()
        self._freshness = Freshness()

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """All intents since the last call: whatever was in the socket when this call began, and a bounded rest."""
        self._time = time
        self._freshness.follow(output)
        intents: list[Intent] = []
        asking: dict[str, None] = {}
        refused: list[tuple[_Asked, Answer]] = []
        for _ in range(self._most):
            try:
                message, sender = self._socket.recvfrom(_LONGEST)
            except OSError:  # nothing more
                break
            said, who, token, seen = (*message.decode(errors="replace").split("\n"), "", "", "")[:4]
            who = who[:_LONGEST_NAME] or "somebody"
            asked = _Asked(None, token, sender if isinstance(sender, str) else "")
            if problem := self._staleness(said.partition(" ")[0], seen):
                refused.append((asked, Answer(False, problem)))
                asking[f"{problem}; requested by {who}"] = None
                continue
            intent = self._understood(said, who, asked)
            if intent is not None:
                intents.append(intent)
                asking[f"{intent.name} requested by {who}"] = None
        for text in list(asking)[:4]:
            self._tell(text)
        self._send(refused)
        return intents

    def _staleness(self, word: str, seen: str) -> str:
        """Refuse what its sender meant for a robot that is not like that any more: all that could move it."""
        if word not in _FRESH:
            return ""
        if seen.isascii() and seen.isdecimal():
            problem = self._freshness.problem(int(seen))
        else:
            problem = "it does not say what its sender had seen; update the sender's client.py to this session's"
        return f"{word.upper()} refused: {problem}" if problem else ""

    def _understood(self, said: str, who: str, asked: _Asked) -> Intent | None:
        """Return the intent in a message; what is none is dealt with."""
        word, _, rest = said.partition(" ")
        if said == REACTIVATE and self._reactivation is not None:
            self._reactivation.request()
            self._reactivating.append(asked)
        elif word == _SAFETY and self._safety is not None:
            self._answer([asked], self._reported(self._safety, rest, who))
        elif word in SIMULATION_WORDS:
            self._control(word, rest, who, asked)
        elif word == POLICY and rest:
            name = "".join(letter if letter.isprintable() else "?" for letter in rest)[:_LONGEST_NAME]
            self._selection.request(name)
            self._waiting.append(replace(asked, policy=name))
            self._tell(f"policy {name} requested by {who}")
        elif word == MARK:
            is_told = self._tell(f"mark of {who}: {rest}".rstrip(": "))
            self._answer([asked], Answer(is_told, "marked" if is_told else "not marked: too many lines in a second"))
        else:
            try:
                intent = Intent(said)
            except ValueError:
                others = () if self._simulation.push is None else SIMULATION_WORDS
                known = ", ".join(
                    [*(intent.value for intent in Intent), REACTIVATE, f"{POLICY} NAME", _SAFETY, MARK, *others]
                )
                self._answer([asked], Answer(False, f"'{said[:40]}' means nothing, expected one of {known}"))
            else:
                self._waiting.append(replace(asked, intent=intent))
                return intent
        return None

    def _reported(self, safety: OutsideSafety, text: str, who: str) -> Answer:
        """Hand on a safety status; one that cannot be read is recorded."""
        try:
            told = safety.report(text)
        except FieldError as error:
            self._tell(f"{who}: {error}")
            return Answer(False, str(error))
        return Answer(True, told)

    def _control(self, word: str, rest: str, who: str, asked: _Asked) -> None:
        """Have the simulation controlled, or answer why not."""
        answer = self._simulation.request(word, rest)
        is_push = word == PUSH and answer.granted
        tell = self._simulation.record_push if is_push else self._tell
        tell(f"{answer.text}; requested by {who}")
        self._answer([asked], answer)

    def tick(self, record: TickRecord) -> None:
        """Answer whoever asked for something that this tick decided."""
        if self._waiting:
            control = record.output.control_mode
            text = f"{control.mode.name} ({control.controller_name}): {control.status_message}"
            # DAMP first: of a flood only so many are answered.
            waiting = sorted(self._waiting, key=lambda asked: asked.intent is not Intent.DAMP)
            self._send([(asked, Answer(_is_granted(asked, record), text)) for asked in waiting])
            self._waiting.clear()
        if self._reactivating and self._reactivation is not None and self._reactivation.answer:
            self._answer(self._reactivating, self._reactivation.answer)
            self._reactivating.clear()

    def close(self) -> None:
        """Answer whoever waits, and remove the socket. May be called twice."""
        self._answer([*self._waiting, *self._reactivating], Answer(True, "the session has ended"))
        self._waiting.clear()
        self._reactivating.clear()
        self._socket.close()
        self._path.unlink(missing_ok=True)

    def _answer(self, waiting: Sequence[_Asked], answer: Answer) -> None:
        self._send([(asked, answer) for asked in waiting])

    @staticmethod
    def _send(answers: Sequence[tuple[_Asked, Answer]]) -> None:
        if not answers:
            return
        # From a socket of their own: answers that nobody takes would fill that of the intents, and nobody else would
        # get any.
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as end:
            for asked, answer in answers[:_MOST_ANSWERS]:
                try:
                    end.sendto(f"{answer.granted:d}{asked.token}\n{answer.text}".encode(), asked.sender)
                except OSError:  # the sender did not wait, or has no name
                    continue
