"""Controls of a simulation that a robot cannot have: pause and pace its time, push it, and begin a new recording.

For motors, emulated ones too, there are those of the default, which refuse every request.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from humanoid_sim.client import Answer
from humanoid_sim.errors import InputError, number_in
from humanoid_sim.messages import Intent
from humanoid_sim.session.reactivation import REACTIVATE
from humanoid_sim.session.sinks import SinkGroup

PAUSE, RESUME, SPEED, PUSH, RESET = SIMULATION_WORDS = ("pause", "resume", "speed", "push", "reset")
_SLOWEST, _FASTEST = 0.1, 4.0  # times real time
_NOT_IN_PAUSE = {*(intent.value for intent in Intent), REACTIVATE, PUSH} - {Intent.DAMP.value, Intent.QUIT.value}


@dataclass(slots=True)
class SimulationControls:
    """Requests of operators, and what stands of them. For the control thread alone."""

    push: Callable[[float, float, str], None] | None = None
    """Pushes the robot: vx and vy in m/s, and a body, '' for the base. Raises `InputError`. None: there are motors."""
    record_push: Callable[[str], None] = lambda _: None
    """Records a line about a push."""
    bodies: Sequence[str] = ()
    stand: Callable[[float], None] = lambda _: None
    """Tells others that the robot stands still, again, after s of wall time."""
    start_over: Callable[[SinkGroup], None] = lambda _: None
    """Begins the next recording, in the place of the one among the sinks. Raises `InputError` if it cannot."""
    problems: Mapping[str, str] = field(default_factory=dict)
    """Reason why the run takes no such request, by its word."""
    is_paused: bool = False
    speed: float = 1.0
    """Times real time."""
    _is_reset_asked: bool = False

    def takes_reset(self) -> bool:
        """Return whether a reset was asked for; then it no longer is, and no pause outlasts it."""
        asked, self._is_reset_asked = self._is_reset_asked, False
        self.is_paused = self.is_paused and not asked
        return asked

    def refusal(self, word: str) -> str:
        """Return why this may not be asked for in a pause: it would move the robot when its time goes on; else ''."""
        if not self.is_paused or word not in _NOT_IN_PAUSE:
            return ""
        return f"{word.upper()} refused: the robot's time is paused; resume, look, and ask again"

    def request(self, word: str, rest: str) -> Answer:
        """Do what one of `SIMULATION_WORDS` asks for; `rest` is what follows it."""
        try:
            if self.push is None:
                raise InputError("it is for a simulation alone; this session drives motors, real or emulated ones")
            if word in self.problems:
                raise InputError(self.problems[word])
            return Answer(True, self._done(word, rest.strip(), self.push))
        except InputError as error:
            return Answer(False, f"{word.upper()} refused: {error}")

    def _done(self, word: str, rest: str, push: Callable[[float, float, str], None]) -> str:
        first, _, body = rest.partition(" ")
        numbers = [number_in(number) for number in first.split(",")]
        if word == SPEED:
            if len(numbers) != 1 or not _SLOWEST <= numbers[0] <= _FASTEST:
                raise InputError(f"is '{rest[:40]}', expected {_SLOWEST:g} to {_FASTEST:g} times real time")
            (self.speed,) = numbers
            return f"the robot's time goes on at {self.speed:g} times real time"
        if word == PUSH:
            if len(numbers) != 2 or any(map(math.isnan, numbers)):
                raise InputError(f"is '{rest[:40]}', expected VX,VY in m/s, and a body")
            push(numbers[0], numbers[1], body)
            return f"pushed{body and f' at {body}'} by {first} m/s"
        if word == RESET:
            self._is_reset_asked = True
            return "the simulated robot begins again, in a new recording"
        self.is_paused = word == PAUSE
        return "paused: the robot's time stands still" if self.is_paused else "resumed: the robot's time goes on"

    def told(self) -> dict[str, Any] | None:
        """Return what operators are shown, as JSON; None where there are motors."""
        return (
            None
            if self.push is None
            else {
                "paused": self.is_paused,
                "speed": self.speed,
                "bodies": list(self.bodies),
                "problems": dict(self.problems),
            }
        )
