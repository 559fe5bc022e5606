"""Findings before anything is enabled: the list that an operator reads, or the reason for a refusal."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from enum import Enum

from humanoid_sim.errors import RobotError


class Verdict(Enum):
    """Outcome of a check."""

    PASSED = "ok"
    WARNING = "warning"
    QUESTION = "question"  # no document answers it, so an operator has to; until then the robot is not enabled
    PROBLEM = "problem"  # the robot is not enabled


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the list."""

    verdict: Verdict
    subject: str  # the joint or the channel
    text: str
    about: str = ""  # item that the answer to a question accepts, such as a firmware's version

    def __str__(self) -> str:
        mark = "" if self.verdict is Verdict.PASSED else f"{self.verdict.value}: "
        return f"{mark}{self.subject}: {self.text}"


class CheckList:
    """Checks in the order in which they were made."""

    def __init__(self, robot: str = "", accepted: Collection[str] = ()) -> None:
        """Begin an empty list. `accepted`: answers to questions that an operator has given already."""
        self._robot, self._accepted = robot, accepted
        self.all: list[Check] = []

    def __iter__(self) -> Iterator[Check]:
        return iter(self.all)

    def passed(self, subject: str, text: str) -> None:
        """Note that something is right; one line collects all that is right with a subject."""
        for i, check in enumerate(self.all):
            if check.subject == subject and check.verdict is Verdict.PASSED:
                self.all[i] = Check(Verdict.PASSED, subject, f"{check.text}; {text}")
                return
        self.all.append(Check(Verdict.PASSED, subject, text))

    def warn(self, subject: str, text: str) -> None:
        """Note something that an operator should know."""
        self.all.append(Check(Verdict.WARNING, subject, text))

    def question(self, subject: str, text: str, about: str) -> None:
        """Ask the operator to accept `about`; a warning where that was accepted already."""
        verdict = Verdict.WARNING if about in self._accepted else Verdict.QUESTION
        self.all.append(Check(verdict, subject, text, about))

    def problem(self, subject: str, text: str) -> None:
        """Note something that keeps the robot from being enabled."""
        self.all.append(Check(Verdict.PROBLEM, subject, text))

    @contextlib.contextmanager
    def collecting(self, subject: object) -> Iterator[None]:
        """Make a `RobotError` within a problem, and go on."""
        try:
            yield
        except RobotError as error:
            self.problem(str(subject), str(error).removeprefix(f"{subject}: "))

    def of(self, verdict: Verdict) -> tuple[str, ...]:
        """Return the checks with this outcome, one line each."""
        return tuple(f"{check.subject}: {check.text}" for check in self.all if check.verdict is verdict)

    @property
    def problems(self) -> tuple[str, ...]:
        """Return what keeps the robot from being enabled, one line each."""
        return self.of(Verdict.PROBLEM)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return what an operator should know, one line each."""
        return self.of(Verdict.WARNING)

    def refuse(self) -> None:
        """Raise a `RobotError` with all problems, if there are some."""
        if self.problems and not self._robot:
            raise RobotError("; ".join(self.problems))
        if self.problems:
            raise RobotError("\n  - ".join([f"{self._robot}: not enabled:", *self.problems]))

    def refuse_questions(self) -> None:
        """Raise a `RobotError` with every question that an operator has not answered."""
        questions = self.of(Verdict.QUESTION)
        if questions:
            about = sorted({check.about for check in self.all if check.verdict is Verdict.QUESTION})
            accept = " ".join(f"--accept-firmware {item}" for item in about)
            robot = f"{self._robot}: " if self._robot else ""
            raise RobotError(f"{robot}not enabled: {'; '.join(questions)}. To accept it: {accept}")
