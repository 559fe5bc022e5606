"""Driver for MicroStrain IMUs on a serial port (3DM-CV7, -GV7, -GQ7 and others with their protocol).

Source: the data communications protocol in the 3DM-CV7 user manual (MicroStrain by HBK), and the manufacturer's
MIT-licensed mip_sdk for the quaternion's convention.

    packet: 0x75 0x65 | descriptor set u8 | payload length u8 | fields | checksum 2 bytes
    field:  length u8, these two bytes included | descriptor u8 | data, big-endian
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from time import monotonic
from typing import TypeAlias

import numpy as np
import serial

from humanoid_sim.controllers.rotation import conjugate, multiply, rotate
from humanoid_sim.errors import RobotError, reason_of
from humanoid_sim.hardware.can_bus import DEVICE_REMEDIES, error_number
from humanoid_sim.hardware.imu import SOURCE, UPRIGHT_AT_REST, Imu, ImuReading
from humanoid_sim.messages import SafetyFlag, SafetyLevel, SafetyStatus
from humanoid_sim.mit import FloatArray

Packet: TypeAlias = tuple[int, Mapping[int, bytes]]
"""A packet's descriptor set, and its fields' data by descriptor."""
_SYNC = b"\x75\x65"
_BASE, _3DM = 0x01, 0x0C  # descriptor sets of commands
SENSOR_DATA = 0x80  # descriptor set of a packet of measurements
ACCELERATION, ANGULAR_RATE, QUATERNION = 0x04, 0x05, 0x0A
"""Scaled accelerometer (3 floats, g), scaled gyroscope (3 floats, rad/s), filtered attitude (4 floats, w x y z)."""
_ACK = 0xF1
_WRITE = 0x01
_RATE = 100.0  # Hz, of samples; 115200 bit/s carry 200 packets of 52 bytes a second
_POLL = 0.02  # s, longest wait for a byte while it is opened
_TIMEOUT = 0.1  # s without a sample after which the status is FAULT
_ANSWER_TIME = 1.0  # s for a command's answer, and for a first sample
_GRAVITY = 9.80665  # m/s² of one g, as the manual defines its unit
_UP_FROM_DOWN = np.array([0.0, 1.0, 0.0, 0.0])  # the device's world has its z axis down


def _checksum(data: bytes) -> bytes:
    """Return Fletcher's checksum, both sums modulo 256, of everything from the sync bytes on."""
    first = second = 0
    for byte in data:
        first = (first + byte) & 0xFF
        second = (second + first) & 0xFF
    return bytes((first, second))


def encode_packet(descriptor_set: int, fields: Mapping[int, bytes]) -> bytes:
    """Return the bytes of a packet."""
    payload = b"".join(bytes((len(data) + 2, descriptor)) + data for descriptor, data in fields.items())
    packet = _SYNC + bytes((descriptor_set, len(payload))) + payload
    return packet + _checksum(packet)


def take_packets(buffer: bytearray) -> list[Packet]:
    """Take the whole packets out of a stream that begins anywhere and loses bytes.

    After a wrong checksum it searches on right behind the sync bytes, so that a lost byte costs one packet.
    """
    packets: list[Packet] = []
    while True:
        start = buffer.find(_SYNC)
        del buffer[: start if start >= 0 else len(buffer) - buffer.endswith(_SYNC[:1])]
        if start < 0 or len(buffer) < 4 or len(buffer) < 6 + buffer[3]:
            return packets
        whole = bytes(buffer[: 6 + buffer[3]])
        is_sound = _checksum(whole[:-2]) == whole[-2:]
        del buffer[: len(whole) if is_sound else 1]
        if is_sound:
            packets.append((whole[2], _fields(whole[4:-2])))


def _fields(payload: bytes) -> dict[int, bytes]:
    found: dict[int, bytes] = {}
    while len(payload) >= 2:
        length = max(payload[0], 2)
        found[payload[1]] = payload[2:length]
        payload = payload[length:]
    return found


class MicrostrainImu(Imu):
    """A MicroStrain IMU; `read` takes what has come since the last."""

    def __init__(
        self,
        port: str,
        baudrate: int,  # bit/s; devices on USB ignore it
        mounting: Sequence[float],  # w x y z, the device's axes in the robot's IMU frame; 0 1 0 0: label up, x forward
    ) -> None:
        """Open nothing yet."""
        self._port, self._baudrate = port, baudrate
        self._mounting = np.array(mounting, dtype=np.float64)
        self._serial: serial.Serial | None = None
        self._buffer = bytearray()
        self._received, self._latest = -math.inf, UPRIGHT_AT_REST

    def open(self) -> None:
        self.close()
        self._received = -math.inf
        try:
            self._serial = serial.Serial(self._port, self._baudrate, timeout=_POLL, write_timeout=1.0, exclusive=True)
            _configure(self._serial, self._buffer)
            deadline = monotonic() + _ANSWER_TIME
            while not self._receive(self._serial, 0.0):
                if monotonic() > deadline:
                    raise RobotError(f"sends no sample within {_ANSWER_TIME:g} s")
        except (OSError, ValueError, RobotError) as error:
            self.close()
            reason = str(error)
            if not isinstance(error, RobotError):
                reason = f"cannot be opened: {DEVICE_REMEDIES.get(error_number(error)) or reason_of(error)}"
            raise RobotError(f"{self._port}: the IMU {reason}") from None

    def read(self, time: float) -> ImuReading:
        """Return the latest reading; its status is FAULT once none has come for 0.1 s."""
        problem = f"is silent for more than {_TIMEOUT:g} s"
        try:
            if self._serial is not None and self._serial.in_waiting:
                self._receive(self._serial, time)
        except OSError as error:  # unplugged
            problem = f"cannot be read any more: {error}"
        if time - self._received <= _TIMEOUT:
            return self._latest
        message = f"{self._port}: the IMU {problem}"
        status = SafetyStatus(SafetyLevel.FAULT, SafetyFlag.RX_TIMEOUT, SOURCE, message)
        return self._latest._replace(status=status)

    def _receive(self, port: serial.Serial, time: float) -> bool:
        """Take what has come, or wait a little for it; True if there was a sample."""
        self._buffer += port.read(port.in_waiting or 1)
        readings = [reading_of(packet, self._mounting) for packet in take_packets(self._buffer)]
        found = [reading for reading in readings if reading is not None]
        if found:
            self._received, self._latest = time, found[-1]
        return bool(found)

    def close(self) -> None:
        if self._serial is not None:
            self._serial.close()
            self._serial = None


def _configure(line: serial.Serial, buffer: bytearray) -> None:
    """Let the device stream quaternion, angular rate and acceleration in one packet."""
    _command(line, buffer, _BASE, 0x02, b"", "Set To Idle")
    rate = _command(line, buffer, _3DM, 0x0E, bytes((SENSOR_DATA,)), "Get Data Base Rate").get(0x8E, b"")
    decimation = max(round(int.from_bytes(rate[1:], "big") / _RATE), 1)
    entries = b"".join(struct.pack(">BH", kind, decimation) for kind in (QUATERNION, ANGULAR_RATE, ACCELERATION))
    _command(line, buffer, _3DM, 0x0F, bytes((_WRITE, SENSOR_DATA, 3)) + entries, "Message Format")
    _command(line, buffer, _3DM, 0x11, bytes((_WRITE, SENSOR_DATA, 1)), "Data Stream Control")
    _command(line, buffer, _BASE, 0x06, b"", "Resume")


def _command(
    line: serial.Serial, buffer: bytearray, descriptor_set: int, descriptor: int, data: bytes, name: str
) -> Mapping[int, bytes]:
    """Send a command; return the fields of the packet that acknowledges it."""
    line.write(encode_packet(descriptor_set, {descriptor: data}))
    deadline = monotonic() + _ANSWER_TIME
    while monotonic() < deadline:
        buffer += line.read(256)
        for answered, fields in take_packets(buffer):
            answer = fields.get(_ACK, b"")
            if answered == descriptor_set and answer[:1] == bytes((descriptor,)):
                if answer[1:] != b"\0":
                    raise RobotError(f"refuses {name}: error {answer[1:].hex()}")
                return fields
    raise RobotError(f"does not answer {name} within {_ANSWER_TIME:g} s: check its power, the port and the baud rate")


def reading_of(packet: Packet, mounting: FloatArray) -> ImuReading | None:
    """Return the reading in a packet; None unless it holds all three measurements, finite. `mounting` as above."""
    descriptor_set, fields = packet
    data = b"".join(fields.get(kind, b"") for kind in (QUATERNION, ANGULAR_RATE, ACCELERATION))
    if descriptor_set != SENSOR_DATA or len(data) != 40:
        return None
    values = np.array(struct.unpack(">10f", data))
    attitude, rate, force = values[:4], values[4:7], values[7:]
    norm = math.sqrt(float((attitude * attitude).sum()))
    if not np.isfinite(values).all() or abs(norm - 1.0) > 0.01:
        return None
    return ImuReading(
        quaternion=multiply(multiply(_UP_FROM_DOWN, attitude / norm), conjugate(mounting)),
        angular_velocity=rotate(mounting, rate),
        linear_acceleration=rotate(mounting, _GRAVITY * force),
    )
