"""Every motor model, in one table: its ratings, and the ranges that its MIT frames can encode. A new model is one row.

Sources: ratings from the data sheets; ranges from Actuator-Control, `src/protocol/robstride.rs` (T-K-233 and
Berkeley-Humanoids, commit d74dd3f), which sends K_p and K_d as `u16 = trunc(clamp(v, 0, limit) / limit · 65535)`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from humanoid_sim.errors import InputError, known_names

__all__ = ["MOTORS", "POSITION_RANGE", "MotorModel", "motor_model"]

_FULL_SCALE = 65535
POSITION_RANGE = 4.0 * math.pi
"""rad, full scale of a Robstride motor's positions: the manuals' tables and the reference. The manuals' sample code
writes 12.57, firmware before `humanoid_sim.hardware.robstride.firmware`'s table used 12.5."""


@dataclass(frozen=True, slots=True)
class MotorModel:
    """One model. The ranges are full scale of its frames' fields, symmetric for position, velocity and effort.

    What lies beyond a range is cut off by the frames' format.
    """

    name: str
    """As robot descriptions have it: `rs-02`."""
    stiffness: float
    """N·m/rad; from 0."""
    damping: float
    """N·m·s/rad; from 0."""
    velocity: float
    """rad/s. rs-03 and rs-04 can turn faster without load than this expresses."""
    effort: float
    """N·m"""
    rated_torque: float
    """N·m, continuous."""
    peak_torque: float
    """N·m"""
    peak_current: float
    """A, phase, peak."""
    no_load_velocity: float
    """rad/s"""
    fault_temperature: float
    """°C at which the motor reports over-temperature and stops; where the manuals' languages disagree, the lower."""
    warning_temperature: float
    """°C at which the motor warns, in a fault report only."""
    position: float = POSITION_RANGE
    """rad; old firmware has another one."""
    family: str = "robstride"
    """Whose protocol it speaks: a key of `humanoid_sim.hardware.families`."""

    @property
    def stiffness_step(self) -> float:
        """N·m/rad, the least difference between two K_p."""
        return self.stiffness / _FULL_SCALE

    @property
    def damping_step(self) -> float:
        """N·m·s/rad, the least difference between two K_d."""
        return self.damping / _FULL_SCALE


_ROWS = (
    # full scale of K_p, K_d, velocity, effort; rated and peak torque, peak current, no-load velocity; fault, warning °C
    MotorModel("rs-00", 500.0, 5.0, 33.0, 14.0, 5.0, 14.0, 15.5, 33.0, 145.0, 135.0),
    MotorModel("rs-01", 500.0, 5.0, 44.0, 17.0, 6.0, 17.0, 23.0, 33.0, 103.0, 93.0),
    MotorModel("rs-02", 500.0, 5.0, 44.0, 17.0, 6.0, 17.0, 23.0, 42.9, 135.0, 135.0),
    MotorModel("rs-03", 5000.0, 100.0, 20.0, 60.0, 20.0, 60.0, 43.0, 20.9, 145.0, 135.0),
    MotorModel("rs-04", 5000.0, 100.0, 15.0, 120.0, 40.0, 120.0, 90.0, 20.9, 145.0, 135.0),
    MotorModel("rs-05", 500.0, 5.0, 50.0, 5.5, 1.6, 5.5, 11.0, 50.3, 135.0, 135.0),
    MotorModel("rs-06", 5000.0, 100.0, 50.0, 36.0, 11.0, 36.0, 57.0, 50.3, 135.0, 135.0),
)
MOTORS: Mapping[str, MotorModel] = MappingProxyType({model.name: model for model in _ROWS})
"""By the model's name in robot descriptions."""


def motor_model(name: str) -> MotorModel:
    """The model of a name.

    Raises:
        InputError: there is none; the message lists those that exist.
    """
    try:
        return MOTORS[name]
    except KeyError:
        raise InputError(known_names("motor model", name, MOTORS)) from None
