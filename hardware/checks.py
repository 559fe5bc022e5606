"""Findings before anything is enabled: the list that an operator reads, or the reason for a refusal."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import NamedTuple

from humanoid_sim.errors import RobotError


class Check(NamedTuple):
    """One line of the list."""

    verdict: str  # `ok`, `warning`, `question`, which an option answers, or `problem`: the robot is not enabled
    subject: str  # the joint or the channel
    text: str

    def __str__(self) -> str:
        mark = "" if self.verdict == "ok" else f"{self.verdict}: "
        return f"{mark}{self.subject}: {self.text}"


class CheckList:
    """Checks in the order in which they were made; `robot` begins a refusal."""

    def __init__(self, robot: str = "") -> None:
        self._robot = robot
        self.all: list[Check] = []

    def passed(self, subject: str, text: str) -> None:
        """Note that something is right; one line collects all that is right with a subject."""
        for i, check in enumerate(self.all):
            if check.subject == subject and check.verdict == "ok":
                self.all[i] = Check("ok", subject, f"{check.text}; {text}")
                return
        self.all.append(Check("ok", subject, text))

    def warn(self, subject: str, text: str) -> None:
        """Note something that an operator should know."""
        self.all.append(Check("warning", subject, text))

    def question(self, subject: str, text: str) -> None:
        """Note something that an operator has to accept before the robot is enabled."""
        self.all.append(Check("question", subject, text))

    def problem(self, subject: str, text: str) -> None:
        """Note something that keeps the robot from being enabled."""
        self.all.append(Check("problem", subject, text))

    @contextlib.contextmanager
    def collecting(self, subject: object) -> Iterator[None]:
        """Make a `RobotError` within a problem, and go on."""
        try:
            yield
        except RobotError as error:
            self.problem(str(subject), str(error).removeprefix(f"{subject}: "))

    def of(self, verdict: str) -> tuple[str, ...]:
        return tuple(f"{check.subject}: {check.text}" for check in self.all if check.verdict == verdict)

    @property
    def problems(self) -> tuple[str, ...]:
        return self.of("problem")

    def refuse(self, *, questions: bool = True) -> None:
        """Raise a `RobotError` with all problems, and questions on request, if there are some."""
        reasons = self.problems + (self.of("question") if questions else ())
        if reasons and self._robot:
            raise RobotError("\n  - ".join([f"{self._robot}: not enabled:", *reasons]))
        if reasons:
            raise RobotError("; ".join(reasons))
