"""What the control loop hands out every tick, and who may take it.

A sink runs on the control thread only for as long as it takes to put a reference in a queue: ticks are immutable, so a
sink's own thread reads them whenever it likes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from humanoid_sim.messages import TickInput, TickOutput
from humanoid_sim.mit import FloatArray

__all__ = ["SessionHeader", "Sink", "TickRecord"]


@dataclass(frozen=True, slots=True)
class SessionHeader:
    """What a run is: everything that a reader needs to interpret, and to repeat, its ticks."""

    robot: str
    """The robot's name, e.g. `lite`."""
    joint_names: tuple[str, ...]
    control_period: float
    """s"""
    start_time_ns: int
    """Wall-clock nanoseconds (Unix epoch) of the robot clock's zero."""
    documents: Mapping[str, str] = field(default_factory=dict)
    """JSON texts by name: robot description, policy contract, settings, versions, hashes."""
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    """Files by name: the motion that was played."""
    observation_terms: tuple[tuple[str, int], ...] = ()
    """Name and width of each observation term, in order; empty without a policy."""


@dataclass(frozen=True, slots=True, eq=False)
class TickRecord:
    """One tick of the loop."""

    index: int
    """Counts from 0; a skipped deadline does not skip an index."""
    input: TickInput
    output: TickOutput
    duration: float
    """s of wall time from the start of `read` to the end of `write`, less the physics of a simulated robot."""
    overrun: bool
    """The tick missed its deadline."""
    qpos: FloatArray | None = None
    """Shape (nq,), MuJoCo's generalised position when the state was read, for viewers; None without a simulator."""


class Sink(Protocol):
    """Takes ticks and events; never makes the control thread wait."""

    def start(self, header: SessionHeader) -> None:
        """Called once, before the first tick. Raises `InputError` if it cannot do its job."""

    def tick(self, record: TickRecord) -> None:
        """Called on the control thread every tick."""

    def event(self, time: float, text: str) -> None:
        """Something that happened outside the ticks: `time` in s on the robot's clock, and one line."""

    @property
    def backlog(self) -> int:
        """Ticks taken but not yet dealt with. A simulated run that need not keep real time waits for a long one."""

    def close(self) -> None:
        """Called once, after the last tick: deal with what is left, release files and threads. Never raises."""
