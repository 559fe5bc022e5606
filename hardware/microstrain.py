"""Driver for MicroStrain IMUs on a serial port (3DM-CV7, -GV7, -GQ7 and others with their protocol).

The protocol is published whole with example packets, and one checksummed packet holds attitude, rate and acceleration
of one instant. Source: the data communications protocol in the 3DM-CV7 user manual (MicroStrain by HBK), and the
manufacturer's MIT-licensed mip_sdk for the quaternion's convention.

    packet: 0x75 0x65 | descriptor set u8 | payload length u8 | fields | checksum 2 bytes
    field:  length u8, these two bytes included | descriptor u8 | data, big-endian
"""

from __future__ import annotations

import math
import struct
import threading
from collections.abc import Callable, Mapping, Sequence
from time import monotonic
from typing import NamedTuple

import numpy as np
import serial

from humanoid_sim.controllers.rotation import conjugate, multiply, rotate
from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.imu import LABEL_UP, Imu, ImuReading, silent, upright_at_rest
from humanoid_sim.mit import FloatArray

_SYNC = b"\x75\x65"
SENSOR_DATA = 0x80  # descriptor set of a packet of measurements
ACCELERATION, ANGULAR_RATE, QUATERNION = 0x04, 0x05, 0x0A
"""Scaled accelerometer (3 floats, g), scaled gyroscope (3 floats, rad/s), filtered attitude (4 floats, w x y z)."""


class Packet(NamedTuple):
    """A packet whose checksum was right."""

    descriptor_set: int
    fields: Mapping[int, bytes]  # data by descriptor


def checksum(data: bytes) -> bytes:
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
    return packet + checksum(packet)


class PacketReader:
    """Finds packets in a stream that begins anywhere and loses bytes.

    After a wrong checksum it searches on right behind the sync bytes, so that a lost byte costs one packet.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that these bytes complete."""
        buffer = self._buffer
        packets: list[Packet] = []
        buffer += data
        while True:
            start = buffer.find(_SYNC)
            del buffer[: start if start >= 0 else len(buffer) - buffer.endswith(_SYNC[:1])]
            if start < 0 or len(buffer) < 4 or len(buffer) < 6 + buffer[3]:
                return packets
            whole = bytes(buffer[: 6 + buffer[3]])
            fields = _fields(whole[4:-2]) if checksum(whole[:-2]) == whole[-2:] else None
            del buffer[: 1 if fields is None else len(whole)]
            if fields is not None:
                packets.append(Packet(whole[2], fields))


def _fields(payload: bytes) -> dict[int, bytes] | None:
    """Return the fields of a payload; None if they do not fill it exactly."""
    found: dict[int, bytes] = {}
    while payload:
        length = payload[0]
        if not 2 <= length <= len(payload):
            return None
        found.setdefault(payload[1], payload[2:length])
        payload = payload[length:]
    return found


_RATE = 100.0  # Hz, of samples; 115200 bit/s carry 200 packets of 52 bytes a second
_POLL = 0.02  # s, longest read of the receiving thread
_TIMEOUT = 0.1  # s without a sample after which the status is FAULT
_FIRST_SAMPLE = 1.0  # s that `open` waits for a first sample


class MicrostrainImu(Imu):
    """A MicroStrain IMU; a thread receives, `read` returns the latest reading."""

    def __init__(
        self,
        port: str,
        baudrate: int = 115200,  # bit/s; devices on USB ignore it
        *,
        mounting: Sequence[float] = LABEL_UP,  # w x y z, the device's axes in the robot's IMU frame
        clock: Callable[[], float] = monotonic,  # the robot's clock, s
    ) -> None:
        """Open nothing yet."""
        self._port, self._baudrate, self._clock = port, baudrate, clock
        self._mounting = np.array(mounting, dtype=np.float64)
        self._serial: serial.Serial | None = None
        self._thread: threading.Thread | None = None
        self._stop, self._received = threading.Event(), threading.Event()
        self._latest: tuple[float, ImuReading] | None = None
        self._problem = ""

    def open(self) -> None:
        """Configure the device and wait for a first sample."""
        self.close()
        self._stop.clear()
        self._received.clear()
        self._latest, self._problem = None, ""
        try:
            self._serial = serial.Serial(self._port, self._baudrate, timeout=_POLL, write_timeout=1.0, exclusive=True)
            _configure(self._serial)
            self._thread = threading.Thread(target=self._receive, args=(self._serial,), name="imu", daemon=True)
            self._thread.start()
            if not self._received.wait(_FIRST_SAMPLE):
                raise RobotError(self._problem or f"acknowledges but sends no sample within {_FIRST_SAMPLE:g} s")
        except (serial.SerialException, OSError, ValueError, RobotError) as error:
            self.close()
            raise RobotError(f"{self._port}: the IMU {error}") from None

    def read(self, time: float) -> ImuReading:
        """Return the latest reading; its status is FAULT once it is older than 0.1 s."""
        if self._latest is None:
            return upright_at_rest(silent(f"{self._port}: the IMU has sent nothing yet"))
        received, reading = self._latest
        if time - received <= _TIMEOUT:
            return reading
        problem = self._problem or f"is silent for more than {_TIMEOUT:g} s"
        return reading._replace(status=silent(f"{self._port}: the IMU {problem}"))

    def close(self) -> None:
        """Stop the thread and release the port."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        if self._serial is not None:
            self._serial.close()
        self._thread = self._serial = None

    def _receive(self, port: serial.Serial) -> None:
        reader = PacketReader()
        while not self._stop.is_set():
            try:
                data = port.read(max(port.in_waiting, 1))
            except (serial.SerialException, OSError) as error:  # unplugged
                self._problem = f"cannot be read any more: {error}"
                return
            for packet in reader.feed(data):
                reading = reading_of(packet, self._mounting)
                if reading is not None:
                    self._latest = self._clock(), reading
                    self._received.set()


_BASE, _3DM = 0x01, 0x0C  # descriptor sets of commands
_ACK = 0xF1
_WRITE = 0x01
_ANSWER_TIME = 1.0  # s; the manual knows no command that takes longer among these
_ERRORS = {1: "unknown command", 2: "wrong checksum", 3: "invalid parameter", 4: "could not be done", 5: "timed out"}


def _configure(line: serial.Serial) -> None:
    """Let the device stream quaternion, angular rate and acceleration in one packet."""
    reader = PacketReader()
    _command(line, reader, _BASE, 0x02, b"", "Set To Idle")
    reply = _command(line, reader, _3DM, 0x0E, bytes((SENSOR_DATA,)), "Get Data Base Rate").get(0x8E, b"")
    if len(reply) != 3:
        raise RobotError("answers Get Data Base Rate without a rate")
    decimation = max(round(int.from_bytes(reply[1:], "big") / _RATE), 1)
    entries = b"".join(struct.pack(">BH", kind, decimation) for kind in (QUATERNION, ANGULAR_RATE, ACCELERATION))
    _command(line, reader, _3DM, 0x0F, bytes((_WRITE, SENSOR_DATA, 3)) + entries, "Message Format")
    _command(line, reader, _3DM, 0x11, bytes((_WRITE, SENSOR_DATA, 1)), "Data Stream Control")
    _command(line, reader, _BASE, 0x06, b"", "Resume")


def _command(
    line: serial.Serial, reader: PacketReader, descriptor_set: int, descriptor: int, data: bytes, name: str
) -> Mapping[int, bytes]:
    """Send a command; return the fields of the packet that acknowledges it."""
    line.write(encode_packet(descriptor_set, {descriptor: data}))
    deadline = monotonic() + _ANSWER_TIME
    while monotonic() < deadline:
        for packet in reader.feed(line.read(256)):
            answer = packet.fields.get(_ACK, b"")
            if packet.descriptor_set == descriptor_set and len(answer) == 2 and answer[0] == descriptor:
                if answer[1]:
                    raise RobotError(f"refuses {name}: {_ERRORS.get(answer[1], f'error {answer[1]}')}")
                return packet.fields
    raise RobotError(f"does not answer {name} within {_ANSWER_TIME:g} s: check its power, the port and the baud rate")


_GRAVITY = 9.80665  # m/s² of one g, as the manual defines its unit
_UP_FROM_DOWN = np.array([0.0, 1.0, 0.0, 0.0])  # the device's world has its z axis down


def reading_of(packet: Packet, mounting: FloatArray) -> ImuReading | None:
    """Return the reading in a packet; None unless it holds all three measurements, finite. `mounting` as above."""
    if packet.descriptor_set != SENSOR_DATA:
        return None
    values = []
    for descriptor, count in ((QUATERNION, 4), (ANGULAR_RATE, 3), (ACCELERATION, 3)):
        data = packet.fields.get(descriptor, b"")
        if len(data) != 4 * count:
            return None
        values.append(np.array(struct.unpack(f">{count}f", data)))
    attitude, rate, force = values
    norm = math.sqrt(float((attitude * attitude).sum()))
    if not abs(norm - 1.0) <= 0.01 or not np.isfinite([*rate, *force]).all():  # NaN fails too
        return None
    return ImuReading(
        quaternion=multiply(multiply(_UP_FROM_DOWN, attitude / norm), conjugate(mounting)),
        angular_velocity=rotate(mounting, rate),
        linear_acceleration=rotate(mounting, _GRAVITY * force),
    )
