"""What a run needs of the robot that it plays on, simulated or real."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import mujoco

from humanoid_sim.messages import Mode
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.interface import Robot

__all__ = ["PlayedRobot", "RobotParts"]


class PlayedRobot(Robot, Protocol):
    """A robot of which its program can tell whether there is still anything to protect."""

    @property
    def is_closed(self) -> bool:
        """Whether `close` was called."""


@dataclass(frozen=True, slots=True)
class RobotParts:
    """A robot, and how a run shows and drives it."""

    robot: PlayedRobot
    live: Mapping[str, int]
    """Names and widths of the live inputs that its state carries."""
    qpos: Callable[[], FloatArray]
    """Shape (nq,), MuJoCo's generalised position of `model`, as the robot now is, for viewers and pictures."""
    model: Callable[[], mujoco.MjModel]
    """A model to draw the robot with. Each viewer draws with its own, so that none can touch the robot's."""
    simulated: bool
    """Writing to the robot also advances its physics."""
    check_gains: Callable[[FloatArray, FloatArray], str]
    """Whether the robot can be driven with a policy's K_p, shape (n,), N·m/rad, and K_d, shape (n,), N·m·s/rad: what an
    operator should know about them, or ''. Raises `InputError` if it cannot."""
    mode_listener: Callable[[Mode], str] | None = None
    """Told of each new mode; see `Session`."""
    notices: tuple[str, ...] = ()
    """What an operator should know about it, one line each."""
