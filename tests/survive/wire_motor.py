"""The motors' end of the wire: a small Robstride motor of the tests' own, on python-can's `virtual` bus.

It speaks in raw identifiers and bytes, after the notes on the protocol, and imports nothing of the product. What it
received and what it sent stands in one log, in order.
"""

import math
import struct
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import can
from can.interfaces.virtual import VirtualBus

# Communication types, bits 28..24 of an identifier.
GET_ID, OPERATION, STATUS, ENABLE, STOP, SET_ZERO, READ, WRITE, FAULT, REPORT = 0, 1, 2, 3, 4, 6, 17, 18, 21, 24
# Parameters.
RUN_MODE, LIMIT_TORQUE, LIMIT_CURRENT, MECH_POS, SUPPLY, CAN_TIMEOUT = 0x7005, 0x700B, 0x7018, 0x7019, 0x701C, 0x7028
FAULT_WORD = 0x3022
# Modes of a status, bits 23..22.
RESET, RUN = 0, 2

HOST = 0xFD
POSITION_RANGE = 4.0 * math.pi
"""rad"""
RANGES = {
    "rs-00": (33.0, 14.0, 500.0, 5.0),
    "rs-01": (44.0, 17.0, 500.0, 5.0),
    "rs-02": (44.0, 17.0, 500.0, 5.0),
    "rs-03": (20.0, 60.0, 5000.0, 100.0),
    "rs-04": (15.0, 120.0, 5000.0, 100.0),
    "rs-05": (50.0, 5.5, 500.0, 5.0),
    "rs-06": (50.0, 36.0, 5000.0, 100.0),
}
"""By model: velocity rad/s, effort N·m, K_p N·m/rad, K_d N·m·s/rad."""

_REPORT_PERIOD = 0.003
"""s between two active reports; a motor's shortest is 10 ms."""
_REAL_SEND = VirtualBus.send
"""python-can's own, also while a test jams the product's end of the bus."""


class Operation(NamedTuple):
    """What an operation control frame asks for, motor frame."""

    position: float
    velocity: float
    effort: float
    kp: float
    kd: float

    @property
    def is_limp(self) -> bool:
        return (self.velocity, self.effort, self.kp, self.kd) == (0.0, 0.0, 0.0, 0.0)


class Frame(NamedTuple):
    """A line of the log."""

    motor: int
    kind: int
    area: int
    data: bytes
    operation: Operation | None = None
    is_reply: bool = False

    @property
    def index(self) -> int:
        """The parameter of a read or a write."""
        return int.from_bytes(self.data[:2], "little")

    @property
    def is_question(self) -> bool:
        """Reading changes nothing in a motor. The question for the version is a stop with C4 in its second byte."""
        return self.kind in (GET_ID, READ) or (self.kind == STOP and self.data[1:2] == b"\xc4")

    @property
    def is_stop(self) -> bool:
        return self.kind == STOP and not self.is_question and not self.is_reply


def identifier(kind: int, area: int, destination: int) -> int:
    return kind << 24 | area << 8 | destination


def unsigned(value: float, limit: float) -> int:
    return int(min(max(value, 0.0), limit) / limit * 65535)


def signed(value: float, limit: float) -> int:
    return int((min(max(value / limit, -1.0), 1.0) + 1.0) * 32767)


def operation(area: int, data: bytes, model: str) -> Operation:
    """Decode operation control; the effort stands in the identifier. Raw 32767 is zero."""
    velocity, effort, kp, kd = RANGES[model]
    raw = (*struct.unpack(">HH", data[:4]), area)
    values = [(r / 32767 - 1.0) * limit for r, limit in zip(raw, (POSITION_RANGE, velocity, effort), strict=True)]
    gains = [r / 65535 * limit for r, limit in zip(struct.unpack(">HH", data[4:]), (kp, kd), strict=True)]
    return Operation(*values, *gains)


def operation_frame(motor_id: int, model: str, values: Operation) -> tuple[int, bytes]:
    """Encode operation control, as another master sends it."""
    velocity, effort, kp, kd = RANGES[model]
    data = struct.pack(
        ">HHHH",
        signed(values.position, POSITION_RANGE),
        signed(values.velocity, velocity),
        unsigned(values.kp, kp),
        unsigned(values.kd, kd),
    )
    return identifier(OPERATION, signed(values.effort, effort), motor_id), data


def fault_frame(motor_id: int, faults: int, warnings: int = 0, host: int = HOST) -> tuple[int, bytes]:
    return identifier(FAULT, motor_id, host), struct.pack("<II", faults, warnings)


@dataclass(eq=False)
class WireMotor:
    """A motor without physics; what it does wrong is switched on by its fields."""

    motor_id: int
    model: str = "rs-02"
    uid: bytes = b"motor 11"
    version: bytes = bytes((0, 2, 3, 9))
    position: float = 0.0
    """rad, motor frame"""
    velocity: float = 0.0
    effort: float = 0.0
    temperature: float = 25.0
    mode: int = RESET
    faults: int = 0
    """Six bits, as in a status."""
    counted: float | None = None
    """rad, what it counts over more turns than a status can say; None: the same."""
    is_silent: bool = False
    """Receives nothing and sends nothing."""
    ignores: set[int] = field(default_factory=set)
    """Types that it neither obeys nor answers."""
    refuses: set[int] = field(default_factory=set)
    """Types that it answers and does not obey."""
    keeps: set[int] = field(default_factory=set)
    """Parameters that stay as they are when written."""
    unreadable: set[int] = field(default_factory=set)
    follows: bool = False
    """Is at once where a command with K_p wants it."""
    on_frame: Callable[[Frame], None] = lambda _: None
    """Called with each frame before it is obeyed."""
    reports: bool = False
    parameters: dict[int, bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        peak = RANGES[self.model][1]
        values = {LIMIT_TORQUE: peak, LIMIT_CURRENT: 16.0, SUPPLY: 48.0}
        self.parameters = {index: struct.pack("<f", value) for index, value in values.items()} | self.parameters

    def obey(self) -> None:
        """Be a sound motor again, for whoever has to stop it."""
        self.is_silent, self.on_frame = False, lambda _: None
        for misdeeds in (self.ignores, self.refuses, self.keeps, self.unreadable):
            misdeeds.clear()

    def status(self, host: int = HOST, kind: int = STATUS) -> tuple[int, bytes]:
        velocity, effort, _, _ = RANGES[self.model]
        data = struct.pack(
            ">HHHH",
            signed(math.remainder(self.position, 2.0 * POSITION_RANGE), POSITION_RANGE),
            signed(self.velocity, velocity),
            signed(self.effort, effort),
            round(10.0 * self.temperature),
        )
        return identifier(kind, (self.mode << 6 | self.faults) << 8 | self.motor_id, host), data

    def parameter(self, index: int) -> bytes:
        if index == MECH_POS:
            return struct.pack("<f", self.position if self.counted is None else self.counted)
        return self.parameters.get(index, bytes(4))

    def answer(self, frame: Frame) -> tuple[int, bytes] | None:
        self.on_frame(frame)
        if self.is_silent or frame.kind in self.ignores:
            return None
        host = HOST if frame.kind == OPERATION else frame.area & 0xFF
        if frame.kind == GET_ID:
            return identifier(GET_ID, self.motor_id, 0xFE), self.uid
        if frame.kind == READ:
            failed = frame.index in self.unreadable
            data = frame.data[:4] + self.parameter(frame.index)
            return identifier(READ, failed << 8 | self.motor_id, host), data
        if frame.kind == STOP and frame.is_question:
            return self.status(host)[0], b"\0\xc4\x56" + self.version + b"\0"
        if frame.kind not in self.refuses:
            self._obey(frame)
        return self.status(host)

    def _obey(self, frame: Frame) -> None:
        if frame.kind == ENABLE:
            self.mode = RUN
        elif frame.kind == STOP:
            self.mode = RESET
            self.faults = 0 if frame.data[:1] == b"\1" else self.faults
        elif frame.kind == WRITE and frame.index not in self.keeps:
            self.parameters[frame.index] = frame.data[4:]
        elif frame.kind == REPORT:
            self.reports = bool(frame.data[6])
        elif frame.operation is not None and self.follows and self.mode == RUN and frame.operation.kp > 0.0:
            self.position = frame.operation.position


class WireBus:
    """A channel with its motors, and a thread that lets them answer until `close`."""

    def __init__(self, channel: str, motors: Sequence[WireMotor], log: list[Frame]) -> None:
        self.motors = list(motors)
        self.log = log
        self.chatter: tuple[int, bytes] | None = None
        """A frame that somebody else sends again and again."""
        self._bus = can.Bus(interface="virtual", channel=channel)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"wire {channel}")
        self._thread.start()

    def send(self, identifier: int, data: bytes, *, is_error: bool = False) -> None:
        message = can.Message(
            arbitration_id=identifier, data=data, is_extended_id=not is_error, is_error_frame=is_error
        )
        _REAL_SEND(self._bus, message)

    def _run(self) -> None:
        spoken = 0.0
        while not self._closing.is_set():
            message = self._bus.recv(0.5 * _REPORT_PERIOD)
            if message is not None and message.is_extended_id:
                self._receive(message.arbitration_id, bytes(message.data))
            if time.monotonic() - spoken >= _REPORT_PERIOD:
                spoken = time.monotonic()
                if self.chatter is not None:
                    self.send(*self.chatter)
                for motor in self.motors:
                    if motor.reports and not motor.is_silent:
                        self.send(*motor.status(kind=REPORT))

    def _receive(self, number: int, data: bytes) -> None:
        kind, area, destination = number >> 24, number >> 8 & 0xFFFF, number & 0xFF
        for motor in self.motors:
            if motor.motor_id == destination:
                found = operation(area, data, motor.model) if kind == OPERATION else None
                frame = Frame(destination, kind, area, data, found)
                self.log.append(frame)
                reply = motor.answer(frame)
                if reply is not None:
                    self.log.append(Frame(destination, reply[0] >> 24, reply[0] >> 8 & 0xFFFF, reply[1], None, True))
                    self.send(*reply)

    def close(self) -> None:
        self._closing.set()
        self._thread.join()
        self._bus.shutdown()
