"""The motors' ratings and the ranges that scale their frames."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.robots.motors import MOTORS

__all__ = ["MODELS", "POSITION_RANGE", "MotorModel", "motor_model"]

POSITION_RANGE = 4.0 * math.pi
"""rad, full scale of positions: the manuals' tables and the reference. The manuals' sample code writes 12.57, firmware
before `humanoid_sim.hardware.robstride.firmware`'s table used 12.5."""


@dataclass(frozen=True, slots=True)
class MotorModel:
    """One model. The ranges are full scale of the frames' fields, symmetric for position, velocity and effort."""

    name: str
    """As robot descriptions have it: `rs-02`."""
    velocity: float
    """rad/s. rs-03 and rs-04 can turn faster without load than this expresses."""
    effort: float
    """N·m"""
    stiffness: float
    """N·m/rad; from 0."""
    damping: float
    """N·m·s/rad; from 0."""
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


def _model(name: str, ratings: tuple[float, float, float, float], temperatures: tuple[float, float]) -> MotorModel:
    limits = MOTORS[name]
    return MotorModel(
        name,
        limits.velocity,
        limits.torque,
        limits.stiffness,
        limits.damping,
        *ratings,
        *temperatures,
    )


MODELS: Mapping[str, MotorModel] = MappingProxyType(
    {
        name: _model(name, ratings, temperatures)
        for name, ratings, temperatures in (
            # rated and peak torque, peak phase current, no-load velocity; fault and warning temperature
            ("rs-00", (5.0, 14.0, 15.5, 33.0), (145.0, 135.0)),
            ("rs-01", (6.0, 17.0, 23.0, 33.0), (103.0, 93.0)),
            ("rs-02", (6.0, 17.0, 23.0, 42.9), (135.0, 135.0)),
            ("rs-03", (20.0, 60.0, 43.0, 20.9), (145.0, 135.0)),
            ("rs-04", (40.0, 120.0, 90.0, 20.9), (145.0, 135.0)),
            ("rs-05", (1.6, 5.5, 11.0, 50.3), (135.0, 135.0)),
            ("rs-06", (11.0, 36.0, 57.0, 50.3), (135.0, 135.0)),
        )
    }
)
"""By name. Ratings from the data sheets; ranges from `humanoid_sim.robots.motors`."""


def motor_model(name: str) -> MotorModel:
    """The model of a name.

    Raises:
        InputError: there is none; the message lists those that exist.
    """
    try:
        return MODELS[name]
    except KeyError:
        raise InputError(known_names("motor model", name, MODELS)) from None
