"""An operator's wish to have the robot verified and enabled afresh, as a relaunch would, without ending the session."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from humanoid_sim.client import Answer
from humanoid_sim.errors import RobotError
from humanoid_sim.messages import EventKind, Mode
from humanoid_sim.robots.robot import Robot

REACTIVATE = "reactivate"  # no intent: the FSM takes no part in it except to begin again
RESET = "reset"  # the same for a simulated robot, in every mode
HOW_TO_REACTIVATE = "press e (or: mode reactivate)"
REACTIVABLE = (Mode.ZERO_TORQUE, Mode.DAMPING)


class Reactivation:
    """Requested by operators, served by the session between two ticks."""

    def __init__(self, warnings: Callable[[], Sequence[str]] = tuple) -> None:
        """Take `warnings` about the robot once it is active, one line each: encoders that slipped raise no flag."""
        self._warnings = warnings
        self._allowed: tuple[Mode, ...] = ()
        self.answer: Answer | None = None  # to the latest request; None until it is served

    @property
    def is_requested(self) -> bool:
        return bool(self._allowed)

    def request(self, *, is_reset: bool = False) -> None:
        """Request it, also in modes that drive a simulated robot for a reset."""
        self.answer, self._allowed = None, tuple(Mode) if is_reset else REACTIVABLE

    def serve(self, robot: Robot, mode: Mode) -> EventKind:
        """Activate the robot again if the mode allows it; `answer` says what became of it.

        A fresh start follows an activation that failed too: nobody knows what the robot then is.
        """
        allowed, self._allowed = self._allowed, ()
        if mode not in allowed:
            required = " or ".join(one.name for one in allowed)
            self.answer = Answer(False, f"REACTIVATE refused: requires {required}, mode is {mode.name}")
            return EventKind.NOTE
        try:
            robot.activate()
        except RobotError as error:
            self.answer = Answer(False, f"REACTIVATE failed: {flattened(str(error))}")
        else:
            lines = ("reactivated: the robot is verified and enabled afresh", *self._warnings())
            self.answer = Answer(True, "; warning: ".join(lines))
        return EventKind.FRESH_START


def flattened(text: str) -> str:
    """Return a message that lists what is wrong line by line, as one line."""
    first, *items = (line.strip() for line in text.splitlines() or [""])
    return " ".join((first, "; ".join(item.removeprefix("- ") for item in items))).strip()
