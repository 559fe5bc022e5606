"""Pushes of a simulated robot: `--push 0.5,0@5`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription

PUSH_DURATION = 0.1
"""s"""
_FASTEST = 10.0
"""m/s"""


@dataclass(frozen=True, slots=True)
class Push:
    """A force on the base that lasts `PUSH_DURATION`, as large as it takes to speed the whole robot up by this."""

    vx: float
    """m/s, world frame."""
    vy: float
    time: float
    """s, robot's clock, at which it begins."""


def parse_pushes(texts: Sequence[str]) -> tuple[Push, ...]:
    """Parse `VX,VY@SECONDS` items. Raises `InputError` naming the item and what is accepted."""
    pushes = []
    for text in texts:
        velocity, _, seconds = text.partition("@")
        try:
            vx, vy = (float(part) for part in velocity.split(","))
            time = float(seconds)
        except ValueError:
            vx = vy = time = math.nan
        if not (abs(vx) <= _FASTEST and abs(vy) <= _FASTEST and 0.0 <= time < math.inf):
            raise InputError(
                f"--push: is '{text}', expected VX,VY@SECONDS, m/s within ±{_FASTEST:g} in the world frame"
            )
        pushes.append(Push(vx, vy, time))
    return tuple(pushes)


def push_wrench(velocity: npt.ArrayLike, mass: float) -> FloatArray:
    """Return what acts on the base meanwhile, shape (..., 6), N and N·m, at its centre of mass, world frame.

    `velocity`, shape (..., 2), m/s, world frame, is by how much the push speeds the whole robot, of `mass` kg, up.
    """
    sped = np.asarray(velocity, dtype=np.float64)
    wrench = np.zeros((*sped.shape[:-1], 6))
    wrench[..., :2] = mass * sped / PUSH_DURATION
    return wrench


class Pushes:
    """Applies pushes to the floating base of a robot, control period by control period."""

    def __init__(self, pushes: Sequence[Push], model: mujoco.MjModel, description: RobotDescription) -> None:
        """Find the base. Raises `InputError` if there are pushes and the base is fixed."""
        if pushes and not description.is_floating:
            raise InputError(f"push: '{description.name}' has a fixed base, which no push moves")
        self._pushes = tuple(pushes)
        self._body = model.body(description.base.body).id if pushes else 0
        self._mass = float(model.body_subtreemass[self._body])

    def apply(self, data: mujoco.MjData, time: float) -> None:
        """Put the forces of the control period that begins at `time`, s, in force."""
        if not self._pushes:
            return
        velocity = np.zeros(2)
        for push in self._pushes:
            if -1e-9 <= time - push.time < PUSH_DURATION - 1e-9:
                velocity += push.vx, push.vy
        data.xfrc_applied[self._body] = push_wrench(velocity, self._mass)
