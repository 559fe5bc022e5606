"""The interface of every IMU, the simulated one, and the IMU that `--imu` names."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.messages import SafetyStatus
from humanoid_sim.mit import FloatArray, MITState

SOURCE = "imu"
OK = SafetyStatus(source=SOURCE)


class ImuReading(NamedTuple):
    """Latest reading of an IMU, in the frame that the robot's description calls its IMU's."""

    quaternion: FloatArray  # shape (4,), w x y z, IMU frame in a world frame whose z is up
    angular_velocity: FloatArray  # shape (3,), rad/s
    linear_acceleration: FloatArray  # shape (3,), m/s², gravity included: (0, 0, +9.81) at rest and upright
    status: SafetyStatus = OK  # FAULT after a silence: a policy that balances on the last values would fall


class Imu(Protocol):
    """An IMU. It may be opened again after `close`."""

    def open(self) -> None:
        """Configure the device and wait for a first sample. Raises `RobotError` if none comes."""

    def read(self, time: float) -> ImuReading:
        """Return the latest reading at `time`, s, robot's clock. Never waits and never raises."""

    def close(self) -> None:
        """Release the device. May be called twice."""


UPRIGHT_AT_REST = ImuReading(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.array([0.0, 0.0, 9.81]))
"""Stands for a reading that does not exist."""


class SimulatedImu(Imu):
    """An ideal IMU of a simulation that runs on another thread."""

    def __init__(self, truth: Callable[[], MITState]) -> None:
        self._truth = truth

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def read(self, time: float) -> ImuReading:
        truth = self._truth()
        return ImuReading(truth.imu_quaternion, truth.imu_angular_velocity, truth.imu_linear_acceleration)


def make_imu(text: str, mounting: Sequence[float]) -> Imu | None:
    """Return the IMU of `--imu`, not opened yet; None for `none`. `mounting`: w x y z, see `MicrostrainImu`."""
    if text == "none":
        return None
    kind, _, rest = text.partition(":")
    port, at, baud = rest.rpartition("@") if "@" in rest else (rest, "", "115200")
    if kind != "microstrain" or not port or (at and not baud.isdecimal()):
        raise InputError(f"--imu: is '{text}', expected none, microstrain:PORT or microstrain:PORT@BAUD")
    norm = math.hypot(*mounting)
    if not abs(norm - 1.0) < 1e-3:
        raise InputError(f"hardware.imu_mounting: is {list(mounting)}, expected a unit quaternion w, x, y, z")
    from humanoid_sim.hardware.microstrain import MicrostrainImu  # noqa: PLC0415 - pyserial only where it is used

    return MicrostrainImu(port, int(baud), [value / norm for value in mounting])
