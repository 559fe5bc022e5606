"""Pushes of a simulated robot as they come, and the wrench that any push is."""

from __future__ import annotations

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


def push_wrench(velocity: FloatArray, mass: float) -> FloatArray:
    """Return what acts on the base meanwhile, shape (..., 6), N and N·m, at its centre of mass, world frame.

    `velocity`, shape (..., 2), m/s, world frame, is by how much the push speeds the whole robot, of `mass` kg, up.
    """
    wrench = np.zeros((*velocity.shape[:-1], 6))
    wrench[..., :2] = mass * velocity / PUSH_DURATION
    return wrench


class Pushes:
    """Applies pushes to a robot, one at a time, control period by control period."""

    def __init__(self, model: mujoco.MjModel, description: RobotDescription) -> None:
        """Find the bodies."""
        bodies = [int(model.joint(name).bodyid[0]) for name in description.joint_names]
        if description.is_floating:
            bodies.insert(0, model.body(description.base.body).id)
        self._bodies = {model.body(body).name: body for body in bodies if model.body(body).name}
        self._base = description.base.body
        self._mass = model.body_subtreemass.copy()
        self._push: Push | None = None

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies that can be pushed: a floating base, and the body that each joint moves."""
        return tuple(self._bodies)

    def add(self, push: Push) -> None:
        """Push. Raises `InputError` if there is no such body, it is too fast, or the push before has not ended."""
        if not (abs(push.vx) <= _FASTEST and abs(push.vy) <= _FASTEST):
            raise InputError(f"is {push.vx:g},{push.vy:g} m/s, expected VX,VY within ±{_FASTEST:g} in the world frame")
        require_known("body", [push.body or self._base], self.bodies)
        if self._push is not None and push.time < self._push.time + PUSH_DURATION:
            raise InputError(f"the push before has not ended; each takes {PUSH_DURATION:g} s")
        self._push = push

    def forget(self) -> None:
        """Forget the push."""
        self._push = None

    def apply(self, data: mujoco.MjData, time: float) -> None:
        """Put the force of the control period that begins at `time`, s, in force."""
        if self._push is None:
            return
        body = self._bodies[self._push.body or self._base]
        if self._push.acts(time):
            velocity = np.array([self._push.vx, self._push.vy])
            data.xfrc_applied[body] = push_wrench(velocity, float(self._mass[body]))
        elif time > self._push.time:
            data.xfrc_applied[body] = 0.0
            self._push = None
