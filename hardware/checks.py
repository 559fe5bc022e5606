"""Findings before anything is enabled: the list that an operator reads, or the reason for a refusal."""

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
    """Question that no document answers, so that an operator has to: the robot is not enabled until then."""
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

    def __init__(self, robot: str = "", answered: Collection[str] = ()) -> None:
        """Begin.

        Args:
            robot: is named in a refusal, which without one is the problems alone.
            answered: what an operator has been asked about and accepted, such as a firmware's version.
        """
        self._robot = robot
        self._answered = answered
        self._checks: list[Check] = []

    def add(self, verdict: Verdict, subject: str, text: str, about: str = "") -> None:
        """Note a finding; one line collects all that is right with a subject."""
        if verdict is Verdict.PASSED:
            for i, check in enumerate(self._checks):
                if check.subject == subject and check.verdict is verdict:
                    self._checks[i] = Check(verdict, subject, f"{check.text}; {text}")
                    return
        self._checks.append(Check(verdict, subject, text, about))

    def passed(self, subject: str, text: str) -> None:
        """Note what was found to be right."""
        self.add(Verdict.PASSED, subject, text)

    def warn(self, subject: str, text: str) -> None:
        """Note what an operator should know."""
        self.add(Verdict.WARNING, subject, text)

    def question(self, subject: str, text: str, about: str) -> None:
        """Ask the operator to accept what nobody knows; a warning where he has accepted the same, `about`, already."""
        is_answered = about in self._answered
        self.add(Verdict.WARNING if is_answered else Verdict.QUESTION, subject, text, about)

    def problem(self, subject: str, text: str) -> None:
        """Note what keeps the robot from being enabled."""
        self.add(Verdict.PROBLEM, subject, text)

    @property
    def all(self) -> tuple[Check, ...]:
        """Every check."""
        return tuple(self._checks)

    @property
    def problems(self) -> tuple[str, ...]:
        """Return what keeps the robot from being enabled, one line each."""
        return self._lines(Verdict.PROBLEM)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return what an operator should know, one line each."""
        return self._lines(Verdict.WARNING)

    def _lines(self, verdict: Verdict) -> tuple[str, ...]:
        return tuple(f"{check.subject}: {check.text}" for check in self._checks if check.verdict is verdict)

    @property
    def questions(self) -> tuple[Check, ...]:
        """Return what nobody has accepted yet."""
        return tuple(check for check in self._checks if check.verdict is Verdict.QUESTION)

    def refusal(self) -> str:
        """All problems as the message of one error."""
        problems = self.problems
        if not self._robot:
            return "; ".join(problems)
        count = f"{len(problems)} problem{'s' if len(problems) > 1 else ''}"
        return f"{self._robot}: not enabled, {count}:" + "".join(f"\n  - {problem}" for problem in problems)

    def refuse_questions(self) -> None:
        """Raise a `RobotError` with every question that an operator has not answered."""
        if not self.questions:
            return
        accepted = " ".join(f"--accept-firmware {about}" for about in sorted({q.about for q in self.questions}))
        asked = "; ".join(self._lines(Verdict.QUESTION))
        head = f"{self._robot}: not enabled: " if self._robot else ""
        raise RobotError(f"{head}{asked}. If you know it better, add {accepted}")

    def refuse(self) -> None:
        """Raise a `RobotError` with everything that is wrong, if something is."""
        if self.problems:
            raise RobotError(self.refusal())
