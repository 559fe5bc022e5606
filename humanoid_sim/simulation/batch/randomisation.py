"""How the robots of a batch differ from one another and from their model, drawn from one seed per environment."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.batch.counter_random import Words, uniforms
from humanoid_sim.simulation.batch.physics import ModelPool

__all__ = ["LONGEST_DELAY", "Randomisation", "Range", "vary_models"]

Range = tuple[float, float]
"""Least and greatest of a uniform distribution."""

_SAME: Range = (1.0, 1.0)
LONGEST_DELAY = 1.0
"""s: all commands of that time are kept for every environment."""
_STREAMS = {"mass": 1, "friction": 2, "joint_friction": 3, "stiffness": 4, "damping": 5, "command_delay": 6}
"""Stream of random numbers that each quantity is drawn from: what one is set to does not move the others."""


@dataclass(frozen=True, slots=True)
class Randomisation:
    """What is drawn for each environment. As given here nothing differs: every robot is its model, in time and quiet.

    Factors, delays and friction are drawn when an environment is seeded and stay; jitter and noise are drawn in every
    step. All of it depends on the environment's seed and step alone, not on the batch.
    """

    mass: Range = _SAME
    """Factor on the mass and the inertia of every body, drawn body by body."""
    friction: Range = _SAME
    """Factor on the friction of all contacts, one for the environment."""
    joint_friction: Range = _SAME
    """Factor on the joints' friction loss, drawn joint by joint."""
    stiffness: Range = _SAME
    """Factor between the commanded K_p and the motor's, drawn motor by motor."""
    damping: Range = _SAME
    """Factor between the commanded K_d and the motor's, drawn motor by motor."""
    command_delay: Range = (0.0, 0.0)
    """s from a command to its effect, rounded to whole physics steps."""
    command_jitter: float = 0.0
    """s, greatest further delay, drawn command by command. A command that arrives after a later one is dropped."""
    joint_position_noise: float = 0.0
    """rad, standard deviation of what the policy sees; the motors' own loop is closed over the true angles."""
    joint_velocity_noise: float = 0.0
    """rad/s, standard deviation."""
    orientation_noise: float = 0.0
    """rad, standard deviation about each axis of the IMU."""
    angular_velocity_noise: float = 0.0
    """rad/s, standard deviation."""
    linear_acceleration_noise: float = 0.0
    """m/s², standard deviation."""

    def __post_init__(self) -> None:
        """Check every field.

        Raises:
            InputError: naming the field, its value and what is accepted.
        """
        for field in fields(self):
            value, is_range = getattr(self, field.name), isinstance(field.default, tuple)
            bounds = value if is_range and isinstance(value, Sequence) else (value,)
            are_numbers = all(isinstance(bound, int | float) and not isinstance(bound, bool) for bound in bounds)
            if (
                len(bounds) != (2 if is_range else 1)
                or not are_numbers
                or not 0.0 <= bounds[0] <= bounds[-1] < math.inf
            ):
                accepted = "two finite numbers >= 0, the least and the greatest" if is_range else "a finite number >= 0"
                raise InputError(f"randomisation: {field.name} is {value!r}, expected {accepted}")
            if is_range:
                object.__setattr__(self, field.name, (float(bounds[0]), float(bounds[1])))
        if self.command_delay[1] > LONGEST_DELAY:
            raise InputError(
                f"randomisation: command_delay is {self.command_delay}, expected at most {LONGEST_DELAY:g} s"
            )

    @classmethod
    def of(cls, values: Randomisation | Mapping[str, Any] | None) -> Randomisation:
        """The randomisation itself, one with these fields, or one without any differences for None.

        Raises:
            InputError: there is no such field, or it is not what it should be.
        """
        if isinstance(values, Randomisation):
            return values
        if values is not None and not isinstance(values, Mapping):
            raise InputError(f"randomisation: is {values!r}, expected its fields by name, or None")
        known = [field.name for field in fields(cls)]
        for name in values or {}:
            if name not in known:
                raise InputError(f"randomisation: {known_names('field', name, known)}")
        return cls(**(values or {}))

    @property
    def is_noisy(self) -> bool:
        """Whether what the policy sees differs from what is."""
        return any(
            (
                self.joint_position_noise,
                self.joint_velocity_noise,
                self.orientation_noise,
                self.angular_velocity_noise,
                self.linear_acceleration_noise,
            )
        )

    def draw(self, name: str, keys: Words, width: int) -> FloatArray:
        """Values of one of the ranges, shape (N, width), for environments with these keys."""
        low, high = getattr(self, name)
        if low == high:
            return np.full((keys.shape[1], width), low)
        counter = np.zeros(keys.shape[1], dtype=np.int64)
        drawn: FloatArray = low + (high - low) * uniforms(keys, _STREAMS[name], counter, width)
        return drawn


def vary_models(
    pool: ModelPool,
    indices: npt.NDArray[np.intp],
    randomisation: Randomisation,
    keys: Words,
    dof: npt.NDArray[np.intp],
) -> None:
    """Give models the masses and frictions of their environments, in place, if any differ; nothing is compiled anew.

    Args:
        pool: of all environments.
        indices: shape (k,), the environments, whose models may have been varied before.
        randomisation: the ranges.
        keys: shape (2, k), the environments'.
        dof: shape (n,), the joints' indices into `qvel`.
    """
    if all(getattr(randomisation, name) == _SAME for name in ("mass", "friction", "joint_friction")):
        return
    pool.separate()
    models, nominal = pool.select(indices), pool.nominal
    masses = randomisation.draw("mass", keys, nominal.nbody)
    frictions = randomisation.draw("friction", keys, 1)[:, 0]
    losses = randomisation.draw("joint_friction", keys, len(dof))
    data = mujoco.MjData(nominal)  # room to work in
    for model, mass, friction, loss in zip(models, masses, frictions, losses, strict=True):
        model.body_mass[:] = nominal.body_mass * mass
        model.body_inertia[:] = nominal.body_inertia * mass[:, None]
        model.geom_friction[:] = nominal.geom_friction * friction
        model.pair_friction[:] = nominal.pair_friction * friction
        model.dof_frictionloss[:] = nominal.dof_frictionloss
        model.dof_frictionloss[dof] *= loss
        mujoco.mj_setConst(model, data)  # what the solver derives from masses at the zero pose
