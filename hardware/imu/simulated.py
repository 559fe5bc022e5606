"""The IMU of emulated motors: what their plant feels, through the interface of the real one."""

from __future__ import annotations

from collections.abc import Callable

from humanoid_sim.hardware.imu.interface import SOURCE, ImuReading
from humanoid_sim.messages import SafetyStatus
from humanoid_sim.simulation.imu import ImuSample

__all__ = ["SimulatedImu"]

_OK = SafetyStatus(source=SOURCE)


class SimulatedImu:
    """Reads a simulation that runs by itself. Ideal: no noise, and no age."""

    def __init__(self, sample: Callable[[], ImuSample]) -> None:
        """Prepare; `sample` gives the plant's present reading, and may be called from the control thread."""
        self._sample = sample

    def open(self) -> None:
        """Nothing to do: a simulation answers at once."""

    def read(self, time: float) -> ImuReading:
        """The plant's present reading."""
        sample = self._sample()
        return ImuReading(sample.quaternion, sample.angular_velocity, sample.linear_acceleration, _OK)

    def close(self) -> None:
        """Nothing to release."""
