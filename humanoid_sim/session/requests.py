"""Operators' requests that are no intents: to make the robot ready afresh, and to select another policy."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from humanoid_sim.client import Answer
from humanoid_sim.errors import RobotError
from humanoid_sim.messages import EventKind, Mode
from humanoid_sim.robots.robot import Robot

REACTIVATE = "reactivate"  # the robot is verified and enabled as a relaunch would, without ending the session
RESET = "reset"  # the same for a simulated robot, in every mode
HOW_TO_REACTIVATE = "press e (or: mode reactivate)"
REACTIVABLE = (Mode.ZERO_TORQUE, Mode.DAMPING)


class Requests:
    """Requests that the session serves: a fresh start between two ticks, a policy with the next tick."""

    def __init__(self, warnings: Callable[[], Sequence[str]] = tuple) -> None:
        """Take `warnings` about the robot once it is active, one line each: encoders that slipped raise no flag."""
        self._warnings = warnings
        self._allowed: tuple[Mode, ...] = ()
        self.answer: Answer | None = None  # to the latest request of a fresh start; None until it is served
        self.policy = ""  # name of the policy to select; '' for none

    @property
    def is_reactivation(self) -> bool:
        """True if a fresh start is requested."""
        return bool(self._allowed)

    def reactivate(self, *, is_reset: bool = False) -> None:
        """Request a fresh start, also in modes that drive a simulated robot for a reset."""
        self.answer, self._allowed = None, tuple(Mode) if is_reset else REACTIVABLE

    def take_policy(self) -> str:
        """Return the newest request of a policy, once."""
        policy, self.policy = self.policy, ""
        return policy

    def serve(self, robot: Robot, mode: Mode) -> tuple[EventKind, Answer]:
        """Activate the robot again if the mode allows it; return what became of it.

        A fresh start follows an activation that failed too: nobody knows what the robot then is.
        """
        allowed, self._allowed = self._allowed, ()
        if mode not in allowed:
            required = " or ".join(one.name for one in allowed)
            self.answer = Answer(False, f"REACTIVATE refused: requires {required}, mode is {mode.name}")
            return EventKind.NOTE, self.answer
        try:
            robot.activate()
        except RobotError as error:
            self.answer = Answer(False, f"REACTIVATE failed: {flattened(str(error))}")
        else:
            lines = ("reactivated: the robot is verified and enabled afresh", *self._warnings())
            self.answer = Answer(True, "; warning: ".join(lines))
        return EventKind.FRESH_START, self.answer


def flattened(text: str) -> str:
    """Return a message that lists what is wrong line by line, as one line."""
    first, *items = (line.strip() for line in text.splitlines() or [""])
    return " ".join((first, "; ".join(item.removeprefix("- ") for item in items))).strip()
