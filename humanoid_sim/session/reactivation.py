"""An operator's wish to have the robot verified and enabled afresh, as a relaunch would, without ending the session."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence

from humanoid_sim.client import Answer
from humanoid_sim.errors import RobotError
from humanoid_sim.messages import EventKind, Mode
from humanoid_sim.robots.robot import Robot

REACTIVATE = "reactivate"
"""Name of the operator's request. It is not an intent, because the FSM takes no part in it except to begin again."""

HOW_TO_REACTIVATE = "press e (or: mode reactivate)"
"""Instruction to the operator once the cause of a fault is fixed."""

REACTIVABLE = (Mode.ZERO_TORQUE, Mode.DAMPING)
"""Modes in which it is granted."""


class Reactivation:
    """Requested on any thread, served by the session between two ticks."""

    def __init__(self, warnings: Callable[[], Sequence[str]] = tuple) -> None:
        """Start with nothing requested.

        `warnings` are what an operator should know about the robot once it is active, one line each: a joint whose
        encoder slipped is read wrongly from here on, and no flag says so.
        """
        self._warnings = warnings
        self._asked = threading.Event()
        self.answer: Answer | None = None
        """To the latest request; None until it is served."""

    @property
    def is_asked(self) -> bool:
        """Return whether a request waits."""
        return self._asked.is_set()

    def request(self) -> None:
        """Ask for it."""
        self.answer = None
        self._asked.set()

    def serve(self, robot: Robot, mode: Mode) -> tuple[str, EventKind]:
        """Activate the robot again if the mode allows it; what became of it, one line, and as what to record it.

        A fresh start follows an activation that failed too: what the robot then is nobody knows, and no torque is the
        answer to that.
        """
        self._asked.clear()
        if refusal := reactivation_refusal(mode):
            self.answer = Answer(False, refusal)
            return refusal, EventKind.NOTE
        try:
            robot.activate()
        except RobotError as error:
            self.answer = Answer(False, f"REACTIVATE failed: {flattened(str(error))}")
        else:
            told = ("reactivated: the robot is verified and enabled afresh", *self._warnings())
            self.answer = Answer(True, "; warning: ".join(told))
        return self.answer.text, EventKind.FRESH_START


def reactivation_refusal(mode: Mode) -> str:
    """Return why it is refused in a mode; empty where it is granted."""
    if mode in REACTIVABLE:
        return ""
    return f"REACTIVATE refused: requires {' or '.join(mode.name for mode in REACTIVABLE)}, mode is {mode.name}"


def flattened(text: str) -> str:
    """Return a message that lists what is wrong line by line, for where there is one line only."""
    if not text:
        return ""
    first, *items = (line.strip() for line in text.splitlines())
    return " ".join((first, "; ".join(item.removeprefix("- ") for item in items))).strip()
