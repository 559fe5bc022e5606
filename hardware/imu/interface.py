"""The one interface of every IMU, simulated or real."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.mit import FloatArray, frozen_array

__all__ = ["SOURCE", "Imu", "ImuReading", "silent", "upright_at_rest"]

SOURCE = "imu"
"""The source of an IMU's safety status."""


@dataclass(frozen=True, slots=True, eq=False)
class ImuReading:
    """What an IMU last felt, in the frame that the robot's description calls its IMU's."""

    quaternion: FloatArray
    """Shape (4,), w x y z, IMU frame in a world frame whose z is up."""
    angular_velocity: FloatArray
    """Shape (3,), rad/s, IMU frame."""
    linear_acceleration: FloatArray
    """Shape (3,), m/s², IMU frame, gravity included: (0, 0, +9.81) at rest and upright."""
    status: SafetyStatus
    """FAULT with RX_TIMEOUT once nothing has been heard for too long: the values are the last ones then."""

    def __post_init__(self) -> None:
        for name in ("quaternion", "angular_velocity", "linear_acceleration"):
            object.__setattr__(self, name, frozen_array("ImuReading", name, getattr(self, name)))


class Imu(Protocol):
    """An IMU. Opened once, read every tick, closed once; may be opened again after that."""

    def open(self) -> None:
        """Begin, and wait for a first sample. Raises `RobotError` if none comes, saying why."""

    def read(self, time: float) -> ImuReading:
        """The latest reading; never waits and never raises.

        Args:
            time: s, the robot's clock, now.
        """

    def close(self) -> None:
        """Release the device and its thread. May be called twice."""


def upright_at_rest(status: SafetyStatus) -> ImuReading:
    """What stands in for a reading that does not exist."""
    return ImuReading(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.array([0.0, 0.0, 9.81]), status)


def silent(message: str) -> SafetyStatus:
    """The status of an IMU that has gone silent: a policy that balances on its last values would fall."""
    return SafetyStatus(SafetyLevel.FAULT, SafetyFlag.RX_TIMEOUT, SOURCE, message)
