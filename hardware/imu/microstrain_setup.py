"""What a MicroStrain IMU is told before it is listened to: which quantities, how often, and to go on sending them.

Source: "Commands" in the 3DM-CV7 user manual: Set To Idle (0x01,0x02), Resume (0x01,0x06), Get Data Base Rate
(0x0C,0x0E), Message Format (0x0C,0x0F), Data Stream Control (0x0C,0x11); every command is answered by an ACK/NACK field
0xF1 with the command's descriptor and an error code, 0 for done. Nothing is saved: a power cycle brings the device's
own settings back.
"""

from __future__ import annotations

import struct
import time
from typing import Protocol

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.imu.mip import Field, Packet, PacketReader, encode_packet
from humanoid_sim.hardware.imu.sensor_data import ACCELERATION, ANGULAR_RATE, QUATERNION, SENSOR_DATA

__all__ = ["Link", "configure"]

_BASE, _3DM = 0x01, 0x0C
_ACK = 0xF1
_WRITE = 0x01
_ANSWER_TIME = 1.0
"""s for an answer; the manual knows no command that takes longer among these."""
_ERRORS = {1: "unknown command", 2: "wrong checksum", 3: "invalid parameter", 4: "could not be done", 5: "timed out"}


class Link(Protocol):
    """What of a serial port is needed here."""

    def write(self, data: bytes, /) -> int | None:
        """Send."""

    def read(self, size: int = 1, /) -> bytes:
        """At most `size` bytes; fewer, or none, after the port's timeout."""


def configure(link: Link, name: str, rate: float) -> float:
    """Have the device stream quaternion, angular rate and acceleration in one packet.

    Args:
        link: an open port with a short timeout.
        name: of the port, for messages.
        rate: Hz; the nearest that divides the device's own rate is taken.

    Returns:
        The rate that was set, Hz.

    Raises:
        RobotError: if the device does not answer, or refuses.
    """
    talk = _Talk(link, name)
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
    return base / decimation


class _Talk:
    """Commands and their answers, among whatever else the device sends."""

    def __init__(self, link: Link, name: str) -> None:
        self._link = link
        self._name = name
        self._reader = PacketReader()

    def ask(self, descriptor_set: int, command: Field, what: str) -> Packet:
        """Send a command; the packet that acknowledges it."""
        self._link.write(encode_packet(descriptor_set, (command,)))
        deadline = time.monotonic() + _ANSWER_TIME
        while time.monotonic() < deadline:
            for packet in self._reader.feed(self._link.read(256)):
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
