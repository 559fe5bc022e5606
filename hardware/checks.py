"""What was found before anything is enabled: the list that an operator reads, or the reason for a refusal."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum

from humanoid_sim.errors import RobotError


class Verdict(Enum):
    """Outcome of a check."""

    PASSED = "ok"
    WARNING = "warning"
    QUESTION = "question"
    """No document answers it, so that an operator has to: the robot is not enabled until then."""
    PROBLEM = "problem"
    """The robot is not enabled."""


@dataclass(frozen=True, slots=True)
class Check:
    """One line of the list."""

    verdict: Verdict
    subject: str
    """The joint or the channel."""
    text: str
    about: str = ""
    """Item that the answer to a question accepts, such as a firmware's version."""

    def __str__(self) -> str:
        mark = "" if self.verdict is Verdict.PASSED else f"{self.verdict.value}: "
        return f"{mark}{self.subject}: {self.text}"


class CheckList:
    """Checks in the order in which they were made."""

    def __init__(self, robot: str = "", accepted: Collection[str] = ()) -> None:
        """Begin an empty list.

        Args:
            robot: is named in a refusal.
            accepted: answers to questions that an operator has given already, such as a firmware's version.
        """
        self._robot = robot
        self._accepted = accepted
        self.all: list[Check] = []

    def passed(self, subject: str, text: str) -> None:
        """Note what was found to be right; one line collects all that is right with a subject."""
        for i, check in enumerate(self.all):
            if check.subject == subject and check.verdict is Verdict.PASSED:
                self.all[i] = Check(Verdict.PASSED, subject, f"{check.text}; {text}")
                return
        self.all.append(Check(Verdict.PASSED, subject, text))

    def warn(self, subject: str, text: str) -> None:
        """Note what an operator should know."""
        self.all.append(Check(Verdict.WARNING, subject, text))

    def question(self, subject: str, text: str, about: str) -> None:
        """Ask the operator to accept `about`; a warning where that was accepted already."""
        verdict = Verdict.WARNING if about in self._accepted else Verdict.QUESTION
        self.all.append(Check(verdict, subject, text, about))

    def problem(self, subject: str, text: str) -> None:
        """Note what keeps the robot from being enabled."""
        self.all.append(Check(Verdict.PROBLEM, subject, text))

    def of(self, verdict: Verdict) -> list[Check]:
        """Return the checks with this outcome."""
        return [check for check in self.all if check.verdict is verdict]

    @property
    def problems(self) -> tuple[str, ...]:
        """Return what keeps the robot from being enabled, one line each."""
        return tuple(f"{check.subject}: {check.text}" for check in self.of(Verdict.PROBLEM))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return what an operator should know, one line each."""
        return tuple(f"{check.subject}: {check.text}" for check in self.of(Verdict.WARNING))

    def refuse(self) -> None:
        """Raise a `RobotError` with all problems, if there are some."""
        if not self.problems:
            return
        if not self._robot:
            raise RobotError("; ".join(self.problems))
        count = f"{len(self.problems)} problem{'s' if len(self.problems) > 1 else ''}"
        lines = "".join(f"\n  - {problem}" for problem in self.problems)
        raise RobotError(f"{self._robot}: not enabled, {count}:{lines}")

    def refuse_questions(self) -> None:
        """Raise a `RobotError` with every question that an operator has not answered."""
        questions = self.of(Verdict.QUESTION)
        if questions:
            accept = " ".join(f"--accept-firmware {about}" for about in sorted({q.about for q in questions}))
            asked = "; ".join(f"{q.subject}: {q.text}" for q in questions)
            raise RobotError(f"{self._robot + ': ' if self._robot else ''}not enabled: {asked}. To accept it: {accept}")
