"""From MIP sensor packets to the robot's frames.

The device's attitude is that of its own axes (x forward, y right, z down, as drawn on its case) in a north, east, down
frame: `v_ned = q v_sensor q⁻¹` (mip_sdk, `data_sensor`, "Comp Quaternion"). Acceleration is the specific force in units
of standard gravity, so that a level device at rest reads (0, 0, -1).

The world of this package is north, west, up: the device's turned by half a turn about north.
"""

from __future__ import annotations

import math

import numpy as np

from humanoid_sim.controllers.rotation import conjugate, multiply, rotate
from humanoid_sim.hardware.imu.interface import SOURCE, ImuReading
from humanoid_sim.hardware.imu.mip import Packet
from humanoid_sim.messages import SafetyStatus
from humanoid_sim.mit import FloatArray

__all__ = ["ACCELERATION", "ANGULAR_RATE", "LABEL_UP", "QUATERNION", "SENSOR_DATA", "reading_of"]

SENSOR_DATA = 0x80
"""Descriptor set of a packet of measurements."""
ACCELERATION, ANGULAR_RATE, QUATERNION = 0x04, 0x05, 0x0A
"""Scaled accelerometer (3 floats, g), scaled gyroscope (3 floats, rad/s), complementary filter's quaternion (4 floats,
w x y z)."""

LABEL_UP = (0.0, 1.0, 0.0, 0.0)
"""The mounting, w x y z, of a device that lies with its label up and its x axis forward."""

_GRAVITY = 9.80665
"""m/s² of one g, as the manual defines its unit."""
_NORM_TOLERANCE = 0.01
_UP_FROM_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
_OK = SafetyStatus(source=SOURCE)


def reading_of(packet: Packet, mounting: FloatArray) -> ImuReading | None:
    """The reading in a packet of measurements; None if it lacks one, or one is no measurement.

    Args:
        packet: of the descriptor set `SENSOR_DATA`.
        mounting: shape (4,), w x y z, the device's axes in the robot's IMU frame.
    """
    values = []
    for descriptor, count in ((QUATERNION, 4), (ANGULAR_RATE, 3), (ACCELERATION, 3)):
        field = packet.field(descriptor)
        numbers = None if field is None else field.floats(count)
        if numbers is None or not all(map(math.isfinite, numbers)):
            return None
        values.append(np.array(numbers))
    attitude, rate, force = values
    norm = math.sqrt(float((attitude * attitude).sum()))
    if abs(norm - 1.0) > _NORM_TOLERANCE:
        return None
    return ImuReading(
        quaternion=multiply(multiply(_UP_FROM_DOWN, attitude / norm), conjugate(mounting)),
        angular_velocity=rotate(mounting, rate),
        linear_acceleration=rotate(mounting, _GRAVITY * force),
        status=_OK,
    )
