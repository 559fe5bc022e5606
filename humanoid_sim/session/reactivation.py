"""An operator's wish to have the robot verified and enabled afresh, as a relaunch would, without ending the session."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from humanoid_sim.errors import RobotError
from humanoid_sim.messages import Mode
from humanoid_sim.robots.robot import Robot

__all__ = ["REACTIVATE", "Reactivation", "is_fresh_start", "one_line"]

REACTIVATE = "reactivate"
"""What operators call it, beside the intents: it is none, because the FSM takes no part in it but to begin again."""

_DONE = "reactivated"
_FAILED = "REACTIVATE failed"
_FROM = (Mode.ZERO_TORQUE, Mode.DAMPING)


def is_fresh_start(event: str) -> bool:
    """Whether an event of a session says that the control stack began again, in ZERO_TORQUE: a replay must do likewise.

    After an activation that failed too: what the robot then is nobody knows, and no torque is the answer to that.
    """
    return event.startswith((_DONE, _FAILED))


class Reactivation:
    """Requested on any thread, served by the session between two ticks."""

    def __init__(self, warnings: Callable[[], Sequence[str]] = tuple) -> None:
        """Start with nothing requested.

        Args:
            warnings: what an operator should know about the robot once it is active, one line each: a joint whose
                encoder slipped is read wrongly from here on, and no flag says so.
        """
        self._warnings = warnings
        self._asked = threading.Event()
        self.answer = ""
        """What became of the latest request; empty until it is served."""

    @property
    def is_asked(self) -> bool:
        """Whether a request waits."""
        return self._asked.is_set()

    def request(self) -> None:
        """Ask for it."""
        self.answer = ""
        self._asked.set()

    def serve(self, robot: Robot, mode: Mode) -> str:
        """Activate the robot again if the mode allows it; what became of it, one line."""
        self._asked.clear()
        if mode not in _FROM:
            names = " or ".join(mode.name for mode in _FROM)
            self.answer = f"REACTIVATE refused: requires {names}, mode is {mode.name}"
            return self.answer
        try:
            robot.activate()
        except RobotError as error:
            self.answer = f"{_FAILED}: {one_line(str(error))}"
        else:
            told = (f"{_DONE}: the robot is verified and enabled afresh", *self._warnings())
            self.answer = "; warning: ".join(told)
        return self.answer


def one_line(text: str) -> str:
    """A message that lists what is wrong line by line, for where there is one line only."""
    first, *items = (line.strip() for line in text.splitlines())
    return " ".join((first, "; ".join(item.removeprefix("- ") for item in items))).strip()
