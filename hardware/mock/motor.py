"""The interface of one mock motor of any family: sensors and frames in, frames and a drive out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.robots.motors import MotorModel

ROOM_TEMPERATURE = 25.0
"""°C"""
SUPPLY_VOLTAGE = 48.0
"""V"""


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


class MockMotor(ABC):
    """A motor's firmware without a bus and without physics. Times are s on the simulation's clock."""

    model: MotorModel
    can_id: int
    sensed: Sensed
    is_running = False
    """True while it is enabled."""

    @abstractmethod
    def power_on(self) -> tuple[Frame, ...]:
        """Boot: disabled, with its stored values and an angle within one turn; returns the frames that it sends."""

    @abstractmethod
    def reset(self) -> None:
        """Leave run mode, without a fault."""

    @abstractmethod
    def is_for(self, frame: Frame) -> bool:
        """Return whether a frame names this motor."""

    @abstractmethod
    def receive(self, frame: Frame, time: float) -> tuple[Frame, ...]:
        """Execute a frame that names it; returns its answers."""

    @abstractmethod
    def advance(self, time: float) -> tuple[Frame, ...]:
        """Check the protections and timeouts; returns the frames that it sends unasked."""

    @abstractmethod
    def next_time(self) -> float:
        """Return when `advance` has something to do, protections apart; infinity: never."""

    @abstractmethod
    def drive(self) -> Drive:
        """Return the command of its control loop."""

    @abstractmethod
    def faults(self) -> str:
        """Return its latched faults in words; empty without any."""

    @abstractmethod
    def zero_torque(self) -> tuple[Frame, ...]:
        """Return the frames with which another computer commands no torque."""
