"""The MicroStrain driver: the manuals' packets, and a mock device behind a pseudo terminal."""

import itertools
import math
import struct
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mock_imu import MockImu
from waiting import until

from humanoid_sim.controllers.rotation import gravity_direction
from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.imu import make_imu
from humanoid_sim.hardware.microstrain import encode_packet, reading_of, take_packets
from humanoid_sim.messages import SafetyFlag, SafetyLevel

UP = np.array([0.0, 1.0, 0.0, 0.0])
"""Mounted with the label up."""
PRINTED = {
    # As printed in the manufacturer's manuals of the 3DM-CV7 (the first) and the 3DM-GX5.
    "75 65 80 0E 0E 04 3E 7A 63 A0 BB 8E 3B 29 7F E5 BF 7F 84 EE": (0x80, 0x04, "3E7A63A0BB8E3B297FE5BF7F"),
    "75 65 01 02 02 06 E5 CB": (0x01, 0x06, ""),
    "75 65 0C 05 05 11 01 01 01 04 1A": (0x0C, 0x11, "010101"),
    "75 65 01 04 04 F1 06 00 DA 74": (0x01, 0xF1, "0600"),
}


@pytest.fixture
def device():
    device = MockImu()
    yield device
    device.close()


@pytest.fixture
def imu(device):
    driver = make_imu(f"microstrain:{device.port}@460800", tuple(UP))
    yield driver
    driver.close()


@pytest.mark.parametrize(("text", "packet"), PRINTED.items())
def test_the_manuals_examples(text, packet):
    descriptor_set, descriptor, payload = packet
    fields = {descriptor: bytes.fromhex(payload)}
    assert encode_packet(descriptor_set, fields) == bytes.fromhex(text)
    assert take_packets(bytearray.fromhex(text)) == [(descriptor_set, fields)]


packets = st.tuples(st.integers(0, 255), st.dictionaries(st.integers(0, 255), st.binary(max_size=20), max_size=8))


@given(st.lists(packets, max_size=5), st.lists(st.integers(1, 30), min_size=1))
def test_packets_survive_any_cut_of_the_stream(sent, cuts):
    stream = b"".join(encode_packet(*packet) for packet in sent)
    buffer, found = bytearray(), []
    for size in itertools.cycle(cuts):
        buffer += stream[:size]
        stream = stream[size:]
        found += take_packets(buffer)
        if not stream:
            break
    assert found == sent


def test_a_damaged_packet_costs_no_other():
    good = encode_packet(0x80, {0x04: bytes(12)})
    lost_a_byte = good[:10] + good[11:]  # its length now reaches into the next packet
    assert len(take_packets(bytearray(good + lost_a_byte + good))) == 2


def test_a_device_is_configured_and_read(device, imu):
    device.send(b"\x75\x65\x80\x02garbage from before \x75")
    imu.open()
    assert device.commands == [(0x01, 0x02), (0x0C, 0x0E), (0x0C, 0x0F), (0x0C, 0x11), (0x01, 0x06)]
    assert (device.format, device.decimation) == ([0x0A, 0x05, 0x04], 10)  # 100 Hz of 1 kHz
    device.rate = (0.1, 0.2, 0.3)
    until(lambda: imu.read(time.monotonic()).angular_velocity[0] > 0.05)
    reading = imu.read(time.monotonic())
    assert reading.status.is_ok
    assert reading.angular_velocity == pytest.approx([0.1, -0.2, -0.3])
    assert reading.linear_acceleration == pytest.approx([0.0, 0.0, 9.80665])
    assert reading.quaternion == pytest.approx([1.0, 0.0, 0.0, 0.0])


def test_silence_is_a_fault_with_the_last_values(device, imu):
    device.rate = (1.0, 0.0, 0.0)
    imu.open()
    until(lambda: imu.read(0.0).angular_velocity[0] > 0.5)
    device.mute = True
    until(lambda: not imu.read(time.monotonic()).status.is_ok)
    reading = imu.read(time.monotonic())
    assert (reading.status.level, reading.status.flags) == (SafetyLevel.FAULT, SafetyFlag.RX_TIMEOUT)
    assert reading.status.source == "imu"
    assert reading.angular_velocity[0] == pytest.approx(1.0)
    device.mute = False
    until(lambda: imu.read(time.monotonic()).status.is_ok)


def test_a_device_that_is_pulled_out_is_a_fault_that_says_so(device, imu):
    imu.open()
    device.unplug()
    until(lambda: not imu.read(time.monotonic()).status.is_ok)
    assert "cannot be read any more" in imu.read(time.monotonic()).status.message


@pytest.mark.parametrize(
    ("port", "reason"),
    [("/dev/nowhere", "there is no such device"), ("/dev/null", "cannot be opened: Could not configure port")],
)
def test_a_port_that_cannot_be_opened_is_one_line_that_says_why(port, reason):
    with pytest.raises(RobotError, match=f"^{port}: the IMU .*{reason}"):
        make_imu(f"microstrain:{port}", tuple(UP)).open()


def test_a_refused_command_is_named(device, imu):
    device.errors = {(0x0C, 0x0F): 3}
    with pytest.raises(RobotError, match=rf"{device.port}.*refuses Message Format.*error 03"):
        imu.open()


HALF = math.sqrt(0.5)


def packet(attitude=(1, 0, 0, 0), rate=(0, 0, 0), force=(0, 0, -1)):
    values = {0x0A: attitude, 0x05: rate, 0x04: force}
    return (0x80, {kind: struct.pack(f">{len(v)}f", *v) for kind, v in values.items()})


@pytest.mark.parametrize(
    ("attitude", "force", "mounting", "gravity"),
    [
        ((HALF, HALF, 0.0, 0.0), (0.0, -1.0, 0.0), UP, (0.0, -1.0, 0.0)),  # rolled right: its right points down
        ((HALF, 0.0, HALF, 0.0), (1.0, 0.0, 0.0), UP, (-1.0, 0.0, 0.0)),  # pitched up: its nose points up
        ((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0), np.array([1.0, 0.0, 0.0, 0.0]), (0.0, 0.0, -1.0)),  # label down
    ],
)
def test_gravity_is_opposite_to_the_force_at_rest(attitude, force, mounting, gravity):
    reading = reading_of(packet(attitude, force=force), mounting)
    assert gravity_direction(reading.quaternion) == pytest.approx(gravity, abs=1e-6)
    assert reading.linear_acceleration == pytest.approx(-9.80665 * np.array(gravity), abs=1e-5)


@pytest.mark.parametrize(
    "damaged",
    [{"attitude": (2, 0, 0, 0)}, {"attitude": (math.nan, 0, 0, 0)}, {"rate": (math.inf, 0, 0)}, {"force": (0, 0)}],
)
def test_no_measurement_is_none(damaged):
    assert reading_of(packet(**damaged), UP) is None
