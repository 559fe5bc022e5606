"""What happens when nobody drives, and how long it takes."""

from __future__ import annotations

from humanoid_sim.play.config import PlayConfig
from humanoid_sim.play.policies import PolicyChoice
from humanoid_sim.robots.description import RobotDescription

__all__ = ["automatic_script", "expected_duration"]

_OPEN_END = 10.0
"""s that a policy without a motion runs when nothing else ends the run."""


def automatic_script(config: PlayConfig, frames: int) -> str:
    """The script that plays when nobody drives: long enough in each mode to see it."""
    run = "motion; hold 0.5" if frames else f"hold {config.duration or _OPEN_END}"
    start = "start_remote" if config.remote != "none" else "start_locomotion"
    run = f"hold {config.duration or _OPEN_END}" if config.remote != "none" else run
    return f"hold 0.5; damp; hold 1; load_{config.pose}; wait; hold 0.2; {start}; {run}; damp; hold 1"


def expected_duration(config: PlayConfig, policy: PolicyChoice, description: RobotDescription) -> float | None:
    """About how long the run takes, s on the robot's clock; None if only its driver knows."""
    if config.duration is not None:
        return config.duration
    if config.manual or config.script is not None or config.hardware is not None:
        return None
    standby = description.standby_controller_a if config.pose == "a" else description.standby_controller_b
    motion = _OPEN_END if policy.motion is None or config.remote != "none" else policy.motion.duration
    return 0.5 + 1.0 + sum(standby.segment_durations) + 0.2 + motion + 0.5 + 1.0
