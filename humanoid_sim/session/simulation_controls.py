"""Controls of a simulation that a robot cannot have: push it, and begin a new recording with the robot at its start.

For motors, emulated ones too, there are those of the default, which refuse every request.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from humanoid_sim.client import Answer
from humanoid_sim.errors import InputError, number_in
from humanoid_sim.session.sinks import SinkGroup

PUSH, RESET = SIMULATION_WORDS = ("push", "reset")


@dataclass(slots=True)
class SimulationControls:
    """Requests of operators, and what stands of them. For the control thread alone."""

    push: Callable[[float, float, str], None] | None = None
    """Pushes the robot: vx and vy in m/s, and a body, '' for the base. Raises `InputError`. None: there are motors."""
    record_push: Callable[[str], None] = lambda _: None
    """Records a line about a push."""
    bodies: Sequence[str] = ()
    start_over: Callable[[SinkGroup], None] = lambda _: None
    """Begins the next recording, in the place of the one among the sinks. Raises `InputError` if it cannot."""
    _is_reset_asked: bool = False

    def takes_reset(self) -> bool:
        """Return whether a reset was asked for; then it no longer is."""
        asked, self._is_reset_asked = self._is_reset_asked, False
        return asked

    def request(self, word: str, rest: str) -> Answer:
        """Do what one of `SIMULATION_WORDS` asks for; `rest` is what follows it."""
        try:
            if self.push is None:
                raise InputError("it is for a simulation alone; this session drives motors, real or emulated ones")
            if word == RESET:
                self._is_reset_asked = True
                return Answer(True, "the simulated robot begins again, in a new recording")
            first, _, body = rest.strip().partition(" ")
            numbers = [number_in(number) for number in first.split(",")]
            if len(numbers) != 2 or any(map(math.isnan, numbers)):
                raise InputError(f"is '{rest.strip()[:40]}', expected VX,VY in m/s, and a body")
            self.push(numbers[0], numbers[1], body)
            return Answer(True, f"pushed{body and f' at {body}'} by {first} m/s")
        except InputError as error:
            return Answer(False, f"{word.upper()} refused: {error}")

    def told(self) -> dict[str, Any] | None:
        """Return what operators are shown, as JSON; None where there are motors."""
        return None if self.push is None else {"bodies": list(self.bodies)}
