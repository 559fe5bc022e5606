"""What a mock motor measures, and the command that its control loop executes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

ROOM_TEMPERATURE = 25.0  # °C
SUPPLY_VOLTAGE = 48.0  # V
LOWEST_VOLTAGE = 12.0  # V, below which a motor stops: the Robstride manuals' limit, assumed for Sito motors


@dataclass(slots=True)
class Sensed:
    """Measurements of a motor, in rad, s, N·m, °C and V, motor frame."""

    shaft: float = 0.0  # with all its turns
    velocity: float = 0.0
    torque: float = 0.0
    temperature: float = ROOM_TEMPERATURE
    voltage: float = SUPPLY_VOLTAGE
    overcurrent: bool = False


class Drive(NamedTuple):
    """The MIT command in force, in rad, s and N·m, motor frame; all zero but the last two without power."""

    position: float = 0.0
    velocity: float = 0.0
    effort: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    limit: float = 0.0  # bound of the torque
    origin: float = 0.0  # the shaft's angle that counts as position 0
