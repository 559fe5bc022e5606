"""Driver for MicroStrain IMUs on a serial port (3DM-CV7, -GV7, -GQ7 and what else speaks their protocol).

Chosen because its protocol is published whole, without a registration, and with example packets to test against;
because one checksummed packet holds attitude, rate and acceleration of one instant; and because legged robots carry it.

Source: the data communications protocol in the 3DM-CV7 user manual (MicroStrain by HBK, files.microstrain.com, "Data
Overview" and "Commands"), and the manufacturer's MIT-licensed mip_sdk for the quaternion's convention. MicroStrain
Inertial Packets (MIP) are

    packet: 0x75 0x65 | descriptor set u8 | payload length u8 | fields | checksum 2 bytes
    field:  length u8, these two bytes included | descriptor u8 | data, big-endian

The checksum is Fletcher's over everything before it, both sums modulo 256, the running sum first.
"""

from __future__ import annotations

import math
import struct
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from time import monotonic

import numpy as np
import serial

from humanoid_sim.controllers.rotation import conjugate, multiply, rotate
from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.imu.interface import LABEL_UP, OK, ImuReading, silent, upright_at_rest
from humanoid_sim.mit import FloatArray

_SYNC = b"\x75\x65"
_HEADER = 4
"""Bytes before the payload."""
_CHECKSUM = 2


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a packet."""

    descriptor: int
    data: bytes

    def floats(self, count: int) -> tuple[float, ...] | None:
        """Return the data as `count` 32-bit floats; None if it has another length."""
        return struct.unpack(f">{count}f", self.data) if len(self.data) == 4 * count else None


@dataclass(frozen=True, slots=True)
class Packet:
    """One packet whose checksum was right."""

    descriptor_set: int
    fields: tuple[Field, ...]

    def field(self, descriptor: int) -> Field | None:
        """Return the first field of that descriptor."""
        return next((field for field in self.fields if field.descriptor == descriptor), None)


def checksum(data: bytes) -> bytes:
    """Fletcher's checksum of everything from the sync bytes to the end of the payload."""
    first = second = 0
    for byte in data:
        first = (first + byte) & 0xFF
        second = (second + first) & 0xFF
    return bytes((first, second))


def encode_packet(descriptor_set: int, fields: Iterable[Field]) -> bytes:
    """Return the bytes of a packet; a `ValueError` if its length bytes cannot say how long a part is."""
    payload = b"".join(bytes((len(field.data) + 2, field.descriptor)) + field.data for field in fields)
    packet = _SYNC + bytes((descriptor_set, len(payload))) + payload
    return packet + checksum(packet)


class PacketReader:
    """Finds packets in a stream that may begin anywhere, lose bytes and hold others.

    After a wrong checksum it looks for the next sync bytes right behind those that misled it, not behind the length
    that the damaged packet claimed: a lost byte costs one packet and not two.
    """

    def __init__(self) -> None:
        """Start with nothing received."""
        self._buffer = bytearray()
        self.damaged = 0
        """Packets whose checksum was wrong or whose fields did not fill them."""
        self.skipped = 0
        """Bytes that belonged to no packet."""

    def feed(self, data: bytes) -> Iterator[Packet]:
        """Take bytes and give the packets that they complete. To be iterated to its end."""
        self._buffer += data
        while self._seek_sync():
            size = _HEADER + self._buffer[3] + _CHECKSUM if len(self._buffer) >= _HEADER else len(self._buffer) + 1
            if len(self._buffer) < size:
                return
            whole = bytes(self._buffer[:size])
            fields = _fields(whole[_HEADER:-_CHECKSUM]) if checksum(whole[:-_CHECKSUM]) == whole[-_CHECKSUM:] else None
            if fields is None:
                self.damaged += 1
                self._skip(1)
            else:
                del self._buffer[:size]
                yield Packet(whole[2], fields)

    def _seek_sync(self) -> bool:
        """Drop what cannot begin a packet; whether the buffer begins with sync bytes now."""
        start = self._buffer.find(_SYNC)
        if start < 0:
            keep = self._buffer.endswith(_SYNC[:1])
            self._skip(len(self._buffer) - keep)
            return False
        self._skip(start)
        return True

    def _skip(self, count: int) -> None:
        self.skipped += count
        del self._buffer[:count]


def _fields(payload: bytes) -> tuple[Field, ...] | None:
    """Return the fields of a payload; None if they do not fill it exactly."""
    found = []
    while payload:
        length = payload[0]
        if not 2 <= length <= len(payload):
            return None
        found.append(Field(payload[1], payload[2:length]))
        payload = payload[length:]
    return tuple(found)


_POLL = 0.02
"""s that the listening thread waits for bytes before it looks whether to stop."""
_TIMEOUT = 0.1
"""s without a sample after which the status is FAULT."""
_FIRST_SAMPLE = 1.0
"""s that `open` waits for a first sample."""


class MicrostrainImu:
    """An `Imu`. A thread of its own listens; `read` only looks at what it heard last."""

    def __init__(
        self,
        port: str,
        *,
        baudrate: int = 115200,
        rate: float = 100.0,
        mounting: Sequence[float] = LABEL_UP,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        """Prepare.

        Args:
            baudrate: bit/s; devices on USB ignore it. One packet is 52 bytes: 115200 carries 200 of them a second.
            rate: Hz, of samples.
            mounting: w x y z, the device's axes in the robot's IMU frame.
            clock: the robot's clock, s.
        """
        self._port = port
        self._baudrate = baudrate
        self._rate = rate
        self._mounting = np.array(mounting, dtype=np.float64)
        self._clock = clock
        self._serial: serial.Serial | None = None
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._heard = threading.Event()
        self._latest: tuple[float, ImuReading] | None = None
        self._problem = ""
        self.reader = PacketReader()
        """Counts what was damaged on the way."""
        self.samples = 0
        self.refused = 0
        """Packets of measurements that lacked one, or held one that is none."""

    def open(self) -> None:
        """Configure the device, listen, and wait for a first sample; a `RobotError` without a port, or an IMU there."""
        self.close()
        try:
            self._serial = serial.Serial(self._port, self._baudrate, timeout=_POLL, write_timeout=1.0, exclusive=True)
        except (serial.SerialException, OSError, ValueError) as error:
            raise RobotError(f"{self._port}: the IMU's port cannot be opened: {error}") from None
        try:
            _configure(self._serial, self._port, self._rate)
        except (serial.SerialException, OSError) as error:
            self.close()
            raise RobotError(f"{self._port}: the IMU cannot be configured: {error}") from None
        except RobotError:
            self.close()
            raise
        self._stop.clear()
        self._heard.clear()
        self._latest, self._problem = None, ""
        self.reader, self.samples, self.refused = PacketReader(), 0, 0
        self._thread = threading.Thread(target=self._listen, args=(self._serial,), name="imu", daemon=True)
        self._thread.start()
        if not self._heard.wait(_FIRST_SAMPLE):
            problem = self._problem or f"acknowledges but sends no sample within {_FIRST_SAMPLE:g} s"
            self.close()
            raise RobotError(f"{self._port}: the IMU {problem}")

    def read(self, time: float) -> ImuReading:
        """Return the latest reading; FAULT once it is older than the timeout."""
        latest = self._latest
        if latest is None:
            return upright_at_rest(silent(f"{self._port}: nothing heard yet"))
        heard, reading = latest
        if time - heard <= _TIMEOUT:
            return reading
        problem = f"the IMU {self._problem}" if self._problem else f"the IMU is silent for {time - heard:.2f} s"
        return ImuReading(
            reading.quaternion,
            reading.angular_velocity,
            reading.linear_acceleration,
            silent(f"{self._port}: {problem}"),
        )

    def close(self) -> None:
        """Stop listening and release the port. May be called twice."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._serial is not None:
            self._serial.close()
            self._serial = None

    def _listen(self, port: serial.Serial) -> None:
        while not self._stop.is_set():
            try:
                data = port.read(max(port.in_waiting, 1))
            except (serial.SerialException, OSError) as error:  # unplugged
                self._problem = f"cannot be read any more: {error}"
                return
            for packet in self.reader.feed(data):
                if packet.descriptor_set != SENSOR_DATA:
                    continue
                reading = reading_of(packet, self._mounting)
                if reading is None:
                    self.refused += 1
                else:
                    self._latest = self._clock(), reading
                    self.samples += 1
                    self._heard.set()


_BASE, _3DM = 0x01, 0x0C
_ACK = 0xF1
_WRITE = 0x01
_ANSWER_TIME = 1.0
"""s for an answer; the manual knows no command that takes longer among these."""
_ERRORS = {1: "unknown command", 2: "wrong checksum", 3: "invalid parameter", 4: "could not be done", 5: "timed out"}


def _configure(line: serial.Serial, name: str, rate: float) -> None:
    """Have the device stream quaternion, angular rate and acceleration in one packet, at about `rate`, Hz, or raise."""
    talk = _Talk(line, name)
    talk.ask(_BASE, Field(0x02, b""), "Set To Idle")
    reply = talk.ask(_3DM, Field(0x0E, bytes((SENSOR_DATA,))), "Get Data Base Rate").field(0x8E)
    if reply is None or len(reply.data) != 3:
        raise RobotError(f"{name}: the IMU's answer to Get Data Base Rate holds no rate")
    base = int.from_bytes(reply.data[1:], "big")
    decimation = max(round(base / rate), 1)
    entries = b"".join(struct.pack(">BH", kind, decimation) for kind in (QUATERNION, ANGULAR_RATE, ACCELERATION))
    talk.ask(_3DM, Field(0x0F, bytes((_WRITE, SENSOR_DATA, 3)) + entries), "Message Format")
    talk.ask(_3DM, Field(0x11, bytes((_WRITE, SENSOR_DATA, 1))), "Data Stream Control")
    talk.ask(_BASE, Field(0x06, b""), "Resume")


class _Talk:
    """Commands and their answers, among whatever else the device sends."""

    def __init__(self, line: serial.Serial, name: str) -> None:
        self._line = line
        self._name = name
        self._reader = PacketReader()

    def ask(self, descriptor_set: int, command: Field, what: str) -> Packet:
        """Send a command; the packet that acknowledges it."""
        self._line.write(encode_packet(descriptor_set, (command,)))
        deadline = time.monotonic() + _ANSWER_TIME
        while time.monotonic() < deadline:
            for packet in self._reader.feed(self._line.read(256)):
                answer = packet.field(_ACK) if packet.descriptor_set == descriptor_set else None
                if answer is None or len(answer.data) != 2 or answer.data[0] != command.descriptor:
                    continue
                error = answer.data[1]
                if error:
                    raise RobotError(f"{self._name}: the IMU refuses {what}: {_ERRORS.get(error, f'error {error}')}")
                return packet
        raise RobotError(
            f"{self._name}: no MicroStrain IMU answers {what} within {_ANSWER_TIME:g} s; "
            "is it powered, and are port and baud rate right?"
        )


SENSOR_DATA = 0x80
"""Descriptor set of a packet of measurements."""
ACCELERATION, ANGULAR_RATE, QUATERNION = 0x04, 0x05, 0x0A
"""Scaled accelerometer (3 floats, g), scaled gyroscope (3 floats, rad/s), complementary filter's quaternion (4 floats,
w x y z)."""

_GRAVITY = 9.80665
"""m/s² of one g, as the manual defines its unit."""
_NORM_TOLERANCE = 0.01
_UP_FROM_DOWN = np.array([0.0, 1.0, 0.0, 0.0])


def reading_of(packet: Packet, mounting: FloatArray) -> ImuReading | None:
    """Return the reading in a packet of measurements; None if it lacks one, or one is not a measurement.

    Args:
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
        status=OK,
    )
