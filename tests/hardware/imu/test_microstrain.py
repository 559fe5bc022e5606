"""The driver against an emulated device behind a pseudo terminal."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
from emulated_imu import EmulatedImu

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.imu.microstrain import MicrostrainImu
from humanoid_sim.messages import SafetyFlag, SafetyLevel


@pytest.fixture
def imu(device: EmulatedImu) -> Iterator[MicrostrainImu]:
    driver = MicrostrainImu(device.port, rate=200.0)
    yield driver
    driver.close()


def until(condition: object, seconds: float = 2.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < deadline
        time.sleep(0.002)


def test_a_device_is_configured_and_heard(device: EmulatedImu, imu: MicrostrainImu) -> None:
    device.send(b"\x75\x65\x80\x02garbage from before \x75")
    imu.open()
    assert device.commands == [(0x01, 0x02), (0x0C, 0x0E), (0x0C, 0x0F), (0x0C, 0x11), (0x01, 0x06)]
    assert (device.format, device.decimation) == ([0x0A, 0x05, 0x04], 5)  # 200 Hz of 1 kHz
    device.rate = (0.1, 0.2, 0.3)
    until(lambda: imu.read(time.monotonic()).angular_velocity[0] > 0.05)
    reading = imu.read(time.monotonic())
    assert reading.status.is_ok
    assert reading.angular_velocity == pytest.approx([0.1, -0.2, -0.3])
    assert reading.linear_acceleration == pytest.approx([0.0, 0.0, 9.80665])
    assert reading.quaternion == pytest.approx([1.0, 0.0, 0.0, 0.0])


def test_silence_is_a_fault_with_the_last_values(device: EmulatedImu, imu: MicrostrainImu) -> None:
    device.rate = (1.0, 0.0, 0.0)
    imu.open()
    device.mute = True
    time.sleep(0.15)
    reading = imu.read(time.monotonic())
    assert (reading.status.level, reading.status.flags) == (SafetyLevel.FAULT, SafetyFlag.RX_TIMEOUT)
    assert reading.status.source == "imu"
    assert "the IMU is silent for 0." in reading.status.message
    assert reading.angular_velocity[0] == pytest.approx(1.0)
    device.mute = False
    until(lambda: imu.read(time.monotonic()).status.is_ok)


def test_damage_on_the_line_is_counted_and_never_read(device: EmulatedImu, imu: MicrostrainImu) -> None:
    imu.open()
    draw = np.random.default_rng(3)

    def damage(data: bytes) -> bytes:
        changed = bytearray(data)
        if draw.random() < 0.5:
            changed[draw.integers(len(changed))] ^= 1 << int(draw.integers(8))
        return bytes(changed)

    device.damage = damage
    before = imu.samples
    until(lambda: imu.reader.damaged >= 5 and imu.samples > before + 5)
    for _ in range(100):
        reading = imu.read(time.monotonic())
        assert reading.linear_acceleration == pytest.approx([0.0, 0.0, 9.80665])
        assert reading.quaternion == pytest.approx([1.0, 0.0, 0.0, 0.0])
        time.sleep(0.001)


def test_a_packet_without_a_measurement_is_refused(device: EmulatedImu, imu: MicrostrainImu) -> None:
    imu.open()
    device.attitude = (0.0, 0.0, 0.0, 0.0)
    until(lambda: imu.refused > 3)
    time.sleep(0.12)
    assert imu.read(time.monotonic()).status.flags is SafetyFlag.RX_TIMEOUT


def test_a_device_that_is_pulled_out_is_a_fault_that_says_so(device: EmulatedImu, imu: MicrostrainImu) -> None:
    imu.open()
    device.unplug()
    until(lambda: not imu.read(time.monotonic()).status.is_ok)
    assert "the IMU cannot be read any more: " in imu.read(time.monotonic()).status.message


def test_it_can_be_opened_again(device: EmulatedImu, imu: MicrostrainImu) -> None:
    imu.open()
    imu.close()
    assert imu.read(time.monotonic() + 1.0).status.flags is SafetyFlag.RX_TIMEOUT
    imu.open()
    assert imu.read(time.monotonic()).status.is_ok


def test_before_anything_is_heard_it_is_upright_and_a_fault() -> None:
    reading = MicrostrainImu("/dev/null").read(0.0)
    assert reading.quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert reading.status.message == "/dev/null: nothing heard yet"
    assert not reading.status.is_ok


@pytest.mark.parametrize(
    ("errors", "message"),
    [
        ({(0x0C, 0x0F): 3}, "the IMU refuses Message Format: invalid parameter"),
        ({(0x0C, 0x0E): 1}, "the IMU refuses Get Data Base Rate: unknown command"),
    ],
)
def test_a_device_that_refuses_is_named(
    device: EmulatedImu, imu: MicrostrainImu, errors: dict[tuple[int, int], int], message: str
) -> None:
    device.errors = errors
    with pytest.raises(RobotError, match=f"{device.port}: {message}"):
        imu.open()


def test_nothing_on_the_line(device: EmulatedImu, imu: MicrostrainImu) -> None:
    device.mute = True
    with pytest.raises(RobotError, match="no MicroStrain IMU answers Set To Idle within 1 s"):
        imu.open()


def test_no_such_port() -> None:
    with pytest.raises(RobotError, match="/dev/nowhere: the IMU's port cannot be opened"):
        MicrostrainImu("/dev/nowhere").open()
