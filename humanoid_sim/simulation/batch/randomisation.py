"""Differences of a batch's robots from one another and from their model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from humanoid_sim.errors import InputError, require_known
from humanoid_sim.simulation.push import PUSH_DURATION

Range = tuple[float, float]
"""Least and greatest of a uniform distribution."""

_SAME: Range = (1.0, 1.0)
_NONE: Range = (0.0, 0.0)
LONGEST_DELAY = 1.0
"""s: all commands, and all states, of that time are kept for every environment."""
_STEEPEST = 0.5
"""rad, of `gravity_tilt`: beyond it nothing stands."""
_DELAYS = "command_delay", "state_delay"


@dataclass(frozen=True, slots=True)
class Randomisation:
    """Ranges for each environment's draws. By default nothing differs: each robot is its model, without delay or noise.

    All is drawn anew for every episode, but noise, jitter and pushes, which are drawn as the episode goes on. It
    depends on the environment's seed, the number of its episode since it was seeded, and the step: not on the batch.
    """

    mass: Range = _SAME
    """Factor on the mass and the inertia of every body, drawn body by body."""
    centre_of_mass: float = 0.0
    """m, greatest shift of the centre of mass of every body that the robot moves, along each axis of its frame."""
    payload: Range = _NONE
    """kg that the base carries at its centre of mass; of a robot with a fixed base each hand, drawn hand by hand."""
    friction: Range = _SAME
    """Factor on the friction of all contacts, one for the environment."""
    joint_friction: Range = _SAME
    """Factor on the joints' friction loss, drawn joint by joint."""
    armature: Range = _SAME
    """Factor on the joints' armature, the inertia of motor and gear, drawn joint by joint."""
    gravity_tilt: float = 0.0
    """rad, greatest angle between gravity and the world's vertical, in any direction: a floor that is not level, or a
    stand that is not upright. The IMU feels it."""
    stiffness: Range = _SAME
    """Factor between the commanded K_p and the motor's, drawn motor by motor."""
    damping: Range = _SAME
    """Factor between the commanded K_d and the motor's, drawn motor by motor."""
    motor_strength: Range = _SAME
    """Factor between the torque that a motor means to apply, its limit included, and the one that it does, drawn motor
    by motor."""
    effort_limit: Range = _SAME
    """Factor on the motors' effort limit, drawn motor by motor."""
    command_delay: Range = _NONE
    """s from a command to its effect, rounded to whole physics steps."""
    command_jitter: float = 0.0
    """s, greatest further delay, drawn command by command. A command that arrives after a later one is dropped."""
    state_delay: Range = _NONE
    """s from a state to its being reported, of joints, IMU and live inputs alike, rounded to whole physics steps."""
    joint_position_bias: float = 0.0
    """rad, greatest error of each encoder's zero. What is reported is off by it, and the motor's own loop is, too."""
    orientation_bias: float = 0.0
    """rad, greatest error about each axis of the IMU, as of one that is not mounted straight."""
    angular_velocity_bias: float = 0.0
    """rad/s, greatest error of each axis of the IMU."""
    linear_acceleration_bias: float = 0.0
    """m/s², greatest error of each axis of the IMU."""
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
    push: Range = _NONE
    """m/s by which a push would speed the whole robot up: a force of 0.1 s on a floating base, in any horizontal
    direction, as `play --push` applies it. legged_gym and Isaac Lab change the velocity of the whole robot instead,
    which is easier to withstand."""
    push_interval: float = 5.0
    """s: there is one push in each such stretch of time, at a moment that is drawn."""

    def __post_init__(self) -> None:
        """Check every field. Raises `InputError` naming the field, its value and what is accepted."""
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
        for name in _DELAYS:
            delay = getattr(self, name)
            if delay[1] > LONGEST_DELAY:
                raise InputError(f"randomisation: {name} is {delay}, expected at most {LONGEST_DELAY:g} s")
        if self.gravity_tilt > _STEEPEST:
            raise InputError(f"randomisation: gravity_tilt is {self.gravity_tilt}, expected at most {_STEEPEST:g} rad")
        if self.push_interval < 2.0 * PUSH_DURATION:
            raise InputError(
                f"randomisation: push_interval is {self.push_interval:g}, expected at least {2.0 * PUSH_DURATION:g} s, "
                f"as a push takes {PUSH_DURATION:g} s"
            )

    @classmethod
    def of(cls, values: Randomisation | Mapping[str, Any] | None) -> Randomisation:
        """Return the randomisation itself, one with these fields, or one without any differences for None.

        Raises `InputError` where there is no such field, or it is not what it should be.
        """
        if isinstance(values, Randomisation):
            return values
        if values is not None and not isinstance(values, Mapping):
            raise InputError(f"randomisation: is {values!r}, expected its fields by name, or None")
        known = [field.name for field in fields(cls)]
        require_known("field", values or (), known, "randomisation: ")
        return cls(**(values or {}))

    def has(self, *names: str) -> bool:
        """Return whether any of these fields says that something differs."""
        return any(getattr(self, name) != NEUTRAL[name] for name in names)

    @property
    def is_noisy(self) -> bool:
        """Return whether what the policy sees differs from what is, from report to report."""
        return self.has(*(name for name in NEUTRAL if name.endswith("_noise")))

    @property
    def is_biased(self) -> bool:
        """Return whether what the policy sees is off by something that stays for the episode."""
        return self.has(*(name for name in NEUTRAL if name.endswith("_bias")))


NEUTRAL: Mapping[str, Any] = {
    field.name: field.default for field in fields(Randomisation) if field.name != "push_interval"
}
"""By field, where nothing differs."""
