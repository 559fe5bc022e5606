"""Differences between simulated robots: their ranges, a draw from them, and what it changes in a model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import msgspec
import mujoco
import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray, IndexArray, IntArray
from humanoid_sim.robots.schema import NotNegative
from humanoid_sim.strict_yaml import converted

PUSH_DURATION = 0.1  # s
Range = tuple[NotNegative, NotNegative]  # least and greatest of a uniform distribution
_Delay = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]  # s


class Randomisation(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Ranges from which each episode's robot is drawn. By default it is the one that the description has."""

    mass: Range = (1.0, 1.0)  # factor on mass and inertia, body by body
    centre_of_mass: NotNegative = 0.0
    """m, greatest shift along each axis of the body's frame, of every body that the robot moves."""
    friction: Range = (1.0, 1.0)  # factor on the friction of all contacts
    gains: Range = (1.0, 1.0)  # factor between the commanded K_p and the motor's, and between the K_d, motor by motor
    effort: Range = (1.0, 1.0)  # factor on the effort limit, motor by motor
    armature: Range = (1.0, 1.0)  # factor on the inertia of motor and gear, joint by joint
    delay: tuple[_Delay, _Delay] = (0.0, 0.0)  # s from a command to its effect, rounded to whole physics steps
    push: Range = (0.0, 0.0)
    """m/s by which a push would speed up the whole robot: a force of 0.1 s on a floating base, in any horizontal
    direction."""
    push_interval: Annotated[float, msgspec.Meta(ge=2.0 * PUSH_DURATION)] = 5.0
    """s: there is one push in each such stretch of time, at a random moment."""
    encoder_offset: NotNegative = 0.0
    """rad, greatest error of each encoder's zero: what it reports is off by it, and the motor's own loop is, too."""

    @classmethod
    def of(cls, values: Randomisation | Mapping[str, Any] | None) -> Randomisation:
        """Return the randomisation itself, or one with these fields. Raises `InputError` for what is no range."""
        fields = msgspec.structs.asdict(values) if isinstance(values, Randomisation) else values or {}
        checked = converted(fields, cls, "randomisation")
        for name, value in msgspec.structs.asdict(checked).items():
            if isinstance(value, tuple) and not value[0] <= value[1] < math.inf:
                raise InputError(f"randomisation: {name} is {value}, expected the least and the greatest, finite")
        return checked

    @property
    def differs(self) -> bool:
        return self != Randomisation(push_interval=self.push_interval)

    def draw(self, generator: np.random.Generator, model: mujoco.MjModel, joints: int) -> Variation:
        """Return one robot of n `joints`. Takes as many numbers whatever the ranges are."""

        def between(bounds: tuple[float, float], *shape: int) -> FloatArray:
            return bounds[0] + (bounds[1] - bounds[0]) * generator.random(shape)

        def within(most: float, *shape: int) -> FloatArray:
            return most * (2.0 * generator.random(shape) - 1.0)

        return Variation(
            mass=between(self.mass, model.nbody),
            centre_of_mass=within(self.centre_of_mass, model.nbody, 3),
            friction=float(between(self.friction)),
            stiffness=between(self.gains, joints),
            damping=between(self.gains, joints),
            effort=between(self.effort, joints),
            armature=between(self.armature, joints),
            delay=float(between(self.delay)),
            encoder_offset=within(self.encoder_offset, joints),
            push_seed=int(generator.integers(2**32)),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Variation:
    """One robot drawn from a randomisation, for one episode; fields and units as there."""

    mass: FloatArray  # shape (nbody,)
    centre_of_mass: FloatArray  # shape (nbody, 3)
    friction: float
    stiffness: FloatArray  # shape (n,), factor on K_p
    damping: FloatArray  # shape (n,), factor on K_d
    effort: FloatArray  # shape (n,)
    armature: FloatArray  # shape (n,)
    delay: float
    encoder_offset: FloatArray  # shape (n,)
    push_seed: int  # of all its pushes

    def model_fields(self, nominal: mujoco.MjModel, dof: IndexArray) -> dict[str, FloatArray]:
        """Return the fields of its model, by name, of a robot as it is described; `mj_setConst` is to follow.

        `dof`, shape (n,), has the joints' indices into `qvel`; actuators, if there are any, are in their order.
        """
        armature = nominal.dof_armature.copy()
        armature[dof] *= self.armature
        # Loose bodies keep their centre of mass: MuJoCo's compiler laid the mass matrix out for it.
        is_robot = nominal.body_rootid == nominal.body_rootid[nominal.dof_bodyid[dof[0]]]
        movable = is_robot & (nominal.body_weldid != 0) & (nominal.body_simple == 0) & (nominal.body_mass > 0.0)
        movable &= self.centre_of_mass.any(axis=1)
        changed = {
            "body_mass": nominal.body_mass * self.mass,
            "body_inertia": nominal.body_inertia * self.mass[:, None],
            "body_ipos": nominal.body_ipos + np.where(movable[:, None], self.centre_of_mass, 0.0),
            "body_sameframe": np.where(movable, int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE), nominal.body_sameframe),
            "geom_friction": nominal.geom_friction * self.friction,
            "pair_friction": nominal.pair_friction * self.friction,
            "dof_armature": armature,
        }
        if nominal.nu:
            changed["actuator_forcerange"] = nominal.actuator_forcerange * self.effort[:, None]
        return {name: values for name, values in changed.items() if values.size}


def push_wrench(velocity: FloatArray, mass: float) -> FloatArray:
    """Return the force and torque, shape (..., 6), N and N·m, world frame, of a push on a body at its centre of mass.

    `velocity`, shape (..., 2), m/s, world frame, is by how much it speeds up the `mass`, kg, in `PUSH_DURATION`.
    """
    wrench = np.zeros((*velocity.shape[:-1], 6))
    wrench[..., :2] = mass * velocity / PUSH_DURATION
    return wrench


class RandomPushes:
    """The pushes of N robots of `mass`, kg: one in each interval, which is cut into control periods."""

    def __init__(self, ranges: Randomisation, count: int, mass: float, control_period: float) -> None:
        self._mass, self._speeds = mass, ranges.push
        self._interval = max(round(ranges.push_interval / control_period), 1)
        self._duration = min(max(round(PUSH_DURATION / control_period), 1), self._interval)
        self._strength = PUSH_DURATION / (self._duration * control_period)
        self._begin = np.zeros(count, dtype=np.int64)
        self._velocity = np.zeros((count, 2))

    def wrench(self, step: IntArray, seeds: Sequence[int]) -> FloatArray:
        """Return force and torque in the control periods that begin now, shape (N, 6), N and N·m, world frame.

        `step`, shape (N,), has the control periods since each robot's start, `seeds` the `push_seed` of each.
        """
        interval, since = np.divmod(step, self._interval)
        for i in np.flatnonzero(since == 0).tolist():
            moment, direction, strength = np.random.default_rng([seeds[i], int(interval[i])]).random(3)
            speed = self._speeds[0] + (self._speeds[1] - self._speeds[0]) * strength
            angle = 2.0 * np.pi * direction
            self._velocity[i] = speed * np.array([np.cos(angle), np.sin(angle)])
            self._begin[i] = math.floor(moment * (self._interval - self._duration + 1))
        acts = (self._begin <= since) & (since < self._begin + self._duration)
        return push_wrench(np.where(acts[:, None], self._strength * self._velocity, 0.0), self._mass)
