"""Pushes of a simulated robot: `--push 0.5,0@5`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, require_known
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription

PUSH_DURATION = 0.1  # s
_FASTEST = 10.0  # m/s


@dataclass(frozen=True, slots=True)
class Push:
    """A force that lasts `PUSH_DURATION`, as large as it takes to speed up all that its body carries by this."""

    vx: float
    """m/s, world frame."""
    vy: float
    time: float
    """s, robot's clock, at which it begins."""
    body: str = ""
    """Name; empty for a floating base, which carries the whole robot."""

    def acts(self, time: float) -> bool:
        """Return whether it is in force in the control period that begins at `time`, s."""
        return -1e-9 <= time - self.time < PUSH_DURATION - 1e-9


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


def push_wrench(velocity: FloatArray, mass: float) -> FloatArray:
    """Return what acts on the base meanwhile, shape (..., 6), N and N·m, at its centre of mass, world frame.

    `velocity`, shape (..., 2), m/s, world frame, is by how much the push speeds the whole robot, of `mass` kg, up.
    """
    wrench = np.zeros((*velocity.shape[:-1], 6))
    wrench[..., :2] = mass * velocity / PUSH_DURATION
    return wrench


class Pushes:
    """Applies pushes to a robot, control period by control period: planned ones to its base, others as they come."""

    def __init__(self, pushes: Sequence[Push], model: mujoco.MjModel, description: RobotDescription) -> None:
        """Find the bodies. Raises `InputError` if there are pushes and the base is fixed."""
        if pushes and not description.is_floating:
            raise InputError(f"push: '{description.name}' has a fixed base, which no push moves")
        self._planned, self._given = tuple(pushes), list[Push]()
        bodies = [int(model.joint(name).bodyid[0]) for name in description.joint_names]
        if description.is_floating:
            bodies.insert(0, model.body(description.base.body).id)
        self._bodies = {model.body(body).name: body for body in bodies if model.body(body).name}
        self._base = description.base.body
        self._mass = model.body_subtreemass.copy()

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that can be pushed: a floating base, and the body that each joint moves."""
        return tuple(self._bodies)

    def add(self, push: Push) -> None:
        """Push. Raises `InputError` if there is no such body, it is too fast, or the push before has not ended."""
        if not (abs(push.vx) <= _FASTEST and abs(push.vy) <= _FASTEST):
            raise InputError(f"is {push.vx:g},{push.vy:g} m/s, expected VX,VY within ±{_FASTEST:g} in the world frame")
        require_known("body", [push.body or self._base], self.bodies)
        if any(given.acts(push.time) for given in self._given):
            raise InputError(f"the push before has not ended; each takes {PUSH_DURATION:g} s")
        self._given = [*self._given[-1:], push]  # the one before may still have to be taken out of force

    def forget(self) -> None:
        """Forget the pushes that were added."""
        self._given.clear()

    def apply(self, data: mujoco.MjData, time: float) -> None:
        """Put the forces of the control period that begins at `time`, s, in force."""
        velocities: dict[int, FloatArray] = {}
        for push in (*self._planned, *self._given):
            velocity = velocities.setdefault(self._bodies[push.body or self._base], np.zeros(2))
            if push.acts(time):
                velocity += push.vx, push.vy
        for body, velocity in velocities.items():
            data.xfrc_applied[body] = push_wrench(velocity, float(self._mass[body]))
