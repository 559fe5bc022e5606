"""What a mock motor senses, and what its control loop does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

ROOM_TEMPERATURE = 25.0  # °C
SUPPLY_VOLTAGE = 48.0  # V


@dataclass(slots=True)
class Sensed:
    """Readings of a motor's own sensors, in rad, s, N·m, °C and V."""

    shaft: float = 0.0
    """Angle of the shaft with all its turns, motor frame."""
    velocity: float = 0.0
    torque: float = 0.0
    temperature: float = ROOM_TEMPERATURE
    voltage: float = SUPPLY_VOLTAGE
    overcurrent: bool = False


class Drive(NamedTuple):
    """The MIT command in force, motor frame, in rad, s and N·m; zero gains and effort without power."""

    position: float = 0.0
    velocity: float = 0.0
    effort: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    limit: float = 0.0
    """Bound of the torque."""
    origin: float = 0.0
    """The shaft's angle that counts as position 0."""
