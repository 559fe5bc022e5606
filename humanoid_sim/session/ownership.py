"""Who may command: REMOTE and each live input have one producer at a time, and so has the velocity."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Producer:
    """A program that sends data."""

    name: str
    process: int

    def __str__(self) -> str:
        return f"{self.name} ({self.process})"


class Turn:
    """Belongs to the first producer that is accepted, until it is stale; others are refused meanwhile."""

    def __init__(self, timeout: float) -> None:
        """Start without an owner; `timeout` s after its last sample an owner has none of it any more."""
        self.timeout = timeout
        self.owner: Producer | None = None
        self._heard = -math.inf

    def expire(self, time: float) -> None:
        """Take the turn from an owner that is stale; `time` in s, robot's clock."""
        if self.owner is not None and not time - self._heard <= self.timeout:
            self.owner = None

    def clear(self) -> None:
        """Take the turn from whoever has it."""
        self.owner = None

    def admit(self, producer: Producer, arrival_time: float) -> bool:
        """Whether a sample of that producer counts; if nobody has the turn, it is the producer's from here on."""
        if self.owner is not None and self.owner != producer:
            return False
        self._heard = arrival_time if self.owner is None else max(arrival_time, self._heard)
        self.owner = producer
        return True
