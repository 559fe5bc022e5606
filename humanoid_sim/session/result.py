"""What a session tells about itself when it has ended."""

from __future__ import annotations

from dataclasses import dataclass

from humanoid_sim.session.histogram import DurationHistogram

__all__ = ["SessionResult"]


@dataclass(frozen=True, slots=True)
class SessionResult:
    """How a run ended."""

    ticks: int
    reason: str
    duration: float
    """s on the robot's clock."""
    wall_time: float
    """s"""
    overruns: int
    skipped: int
    """Deadlines that passed while a tick was still running."""
    jitter: DurationHistogram
    """How long after its due time each tick began; empty without real time."""
    measures: tuple[str, ...] = ()
    """What was done for punctuality, a line each."""
    failures: tuple[str, ...] = ()
    """A robot that is not confirmed to be without torque; sinks that raised on the control thread, and were left out
    from then on, each with its exception."""
