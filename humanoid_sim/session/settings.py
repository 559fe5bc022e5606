"""How a control loop keeps time, and how it ends."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["LoopSettings"]


@dataclass(frozen=True, slots=True)
class LoopSettings:
    """How the loop keeps time, and how it ends."""

    control_period: float
    """s"""
    realtime: bool = True
    """Keep real time. A simulated robot may run as fast as it can instead."""
    simulated: bool = False
    """Writing to the robot also advances its physics, which then does not count as a tick's own time."""
    duration: float | None = None
    """s on the robot's clock after which the run ends; None: when a source says so, or QUIT."""
    punctual: bool = False
    """Take the measures of `humanoid_sim.session.realtime` while the robot is active."""
    damping_time: float = 3.0
    """s at most that the end of a run stays in DAMPING for the joints to come to rest."""
