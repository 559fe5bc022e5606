"""Which IMU an option means: `microstrain:/dev/ttyACM0`, or `microstrain:/dev/ttyS1@460800`."""

from __future__ import annotations

import math
from collections.abc import Callable

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.imu.interface import Imu
from humanoid_sim.hardware.imu.sensor_data import LABEL_UP

__all__ = ["DEFAULT_MOUNTING", "make_imu"]

DEFAULT_MOUNTING = ",".join(f"{value:g}" for value in LABEL_UP)


def make_imu(text: str, mounting: str, clock: Callable[[], float]) -> Imu | None:
    """The IMU that `--imu` and `--imu-mounting` describe; None for `none`. Opens nothing.

    Args:
        text: `none`, or `microstrain:PORT`, or `microstrain:PORT@BAUD`.
        mounting: `w,x,y,z`, the device's axes in the robot's IMU frame.
        clock: the robot's clock, s.

    Raises:
        InputError: naming the option.
    """
    if text == "none":
        return None
    kind, _, rest = text.partition(":")
    port, at, baud = rest.rpartition("@") if "@" in rest else (rest, "", "115200")
    if kind != "microstrain" or not port or (at and not baud.isdecimal()):
        raise InputError(f"--imu: is '{text}', expected none, microstrain:PORT or microstrain:PORT@BAUD")
    from humanoid_sim.hardware.imu.microstrain import MicrostrainImu  # noqa: PLC0415 - pyserial only where it is used

    return MicrostrainImu(port, baudrate=int(baud), mounting=_quaternion(mounting), clock=clock)


def _quaternion(text: str) -> tuple[float, ...]:
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    norm = math.sqrt(sum(value * value for value in values))
    if len(values) != 4 or not abs(norm - 1.0) < 1e-3:
        raise InputError(f"--imu-mounting: is '{text}', expected w,x,y,z: a unit quaternion of four numbers")
    return tuple(value / norm for value in values)
