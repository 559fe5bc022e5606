from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from humanoid_sim.controllers.rotation import gravity_direction, matrix
from humanoid_sim.hardware.imu.mip import Field, Packet
from humanoid_sim.hardware.imu.sensor_data import LABEL_UP, reading_of

UP = np.array(LABEL_UP)
HALF = math.sqrt(0.5)


def packet(attitude: object = (1, 0, 0, 0), rate: object = (0, 0, 0), force: object = (0, 0, -1)) -> Packet:
    values = {0x0A: attitude, 0x05: rate, 0x04: force}
    return Packet(
        0x80,
        tuple(Field(kind, struct.pack(f">{len(v)}f", *v)) for kind, v in values.items()),  # type: ignore[arg-type]
    )


def test_a_level_device_at_rest_is_upright_at_rest() -> None:
    reading = reading_of(packet(), UP)
    assert reading is not None
    assert reading.quaternion == pytest.approx([1.0, 0.0, 0.0, 0.0])
    assert reading.linear_acceleration == pytest.approx([0.0, 0.0, 9.80665])
    assert reading.status.is_ok


@pytest.mark.parametrize(
    ("attitude", "force", "gravity"),
    [
        ((HALF, HALF, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, -1.0, 0.0)),  # rolled right: its right points down
        ((HALF, 0.0, HALF, 0.0), (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)),  # pitched up: its nose points up
    ],
)
def test_gravity_is_where_the_force_at_rest_is_not(attitude: object, force: object, gravity: object) -> None:
    reading = reading_of(packet(attitude, force=force), UP)
    assert reading is not None
    assert gravity_direction(reading.quaternion) == pytest.approx(gravity, abs=1e-6)
    assert reading.linear_acceleration == pytest.approx(-9.80665 * np.array(gravity), abs=1e-5)


def test_a_turn_to_the_east_is_one_to_the_right() -> None:
    reading = reading_of(packet((HALF, 0.0, 0.0, HALF), rate=(0.1, 0.2, 0.3)), UP)
    assert reading is not None
    assert matrix(reading.quaternion)[:, 0] == pytest.approx([0.0, -1.0, 0.0], abs=1e-6)  # north, west, up
    assert reading.angular_velocity == pytest.approx([0.1, -0.2, -0.3])


def test_a_device_mounted_upside_down_feels_what_one_mounted_label_up_feels() -> None:
    """Its own z axis then points up: it reads +1 g, and half a turn about its x axis as its attitude."""
    reading = reading_of(packet((0.0, 1.0, 0.0, 0.0), (0.1, 0.2, 0.3), (0.0, 0.0, 1.0)), np.array([1.0, 0.0, 0.0, 0.0]))
    assert reading is not None
    assert np.abs(reading.quaternion) == pytest.approx([1.0, 0.0, 0.0, 0.0])
    assert reading.linear_acceleration == pytest.approx([0.0, 0.0, 9.80665])
    assert reading.angular_velocity == pytest.approx([0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    "bad",
    [
        packet(attitude=(0.0, 0.0, 0.0, 0.0)),
        packet(attitude=(1.1, 0.0, 0.0, 0.0)),
        packet(rate=(math.nan, 0.0, 0.0)),
        packet(force=(0.0, 0.0, math.inf)),
        packet(force=(0.0, 0.0)),
        Packet(0x80, packet().fields[:2]),
        Packet(0x80, ()),
    ],
)
def test_what_is_no_measurement_is_no_reading(bad: Packet) -> None:
    assert reading_of(bad, UP) is None
