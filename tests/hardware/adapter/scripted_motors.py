"""Motors that answer every command as a test tells them, without physics: the other end of python-can's virtual bus."""

import struct
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Self

import can

from humanoid_sim.hardware.bus.address import BusAddress
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.codec import decode_command, encode_reply
from humanoid_sim.hardware.robstride.messages import FaultBit, MotorMode, StatusFault, WarningBit
from humanoid_sim.hardware.robstride.parameters import PARAMETERS, default_value, fault_word, pack_value
from humanoid_sim.robots.motors import MOTORS

HOST = 0xFD
NO_FAULT = StatusFault(0)
NO_WARNING = WarningBit(0)


@dataclass(eq=False)
class ScriptedMotor:
    motor_id: int
    model: str = "rs-02"
    uid: bytes = b"\1\2\3\4\5\6\7\x08"
    version: tuple[int, int, int, int] = (0, 2, 3, 9)
    position: float = 0.0
    velocity: float = 0.0
    counted: float | None = None
    temperature: float = 25.0
    mode: MotorMode = MotorMode.RESET
    faults: StatusFault = NO_FAULT
    clears_faults: bool = True
    is_silent: bool = False
    """It neither hears nor answers."""
    answers: bool = True
    """It obeys, but nobody hears it."""
    enables: bool = True
    stops: bool = True
    has_version: bool = True
    unreadable: set[str] = field(default_factory=set)
    unwritable: set[str] = field(default_factory=set)
    limits: dict[str, float] = field(default_factory=dict)
    answers_host: int | None = None
    stored_host: int | None = None
    """To whom operation control is answered; none: to whoever asks."""
    answers_stopped: bool = True
    """Whether it answers operation control while it is stopped."""
    hears: Callable[[messages.Command], bool] = lambda _: True
    heard: list[messages.Command] = field(default_factory=list)
    reports: bool = False
    parameters: dict[int, bytes] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for parameter in [*PARAMETERS.values(), fault_word(self.model)]:
            value = default_value(parameter, self.model)
            self.parameters[parameter.index] = pack_value(
                parameter.type, 48.0 if parameter.name == "VBUS" else value or 0
            )

    def status(self, host: int = HOST, *, is_report: bool = False) -> messages.Status:
        host = host if self.answers_host is None else self.answers_host
        values = (self.position, self.velocity, 0.0, self.temperature)
        return messages.Status(self.motor_id, host, *values, self.mode, self.faults, is_report)

    def answer(self, command: messages.Command) -> messages.Reply | None:
        if self.is_silent or not self.hears(command):
            return None
        self.heard.append(command)
        if isinstance(command, messages.OperationControl) and self.mode is MotorMode.RESET and not self.answers_stopped:
            return None
        host = getattr(command, "host_id", HOST)
        match command:
            case messages.GetDeviceId():
                return messages.DeviceId(self.motor_id, self.uid)
            case messages.ReadVersion():
                return messages.Version(self.motor_id, host, self.version) if self.has_version else None
            case messages.Enable() if self.enables:
                self.mode = MotorMode.RUN
            case messages.Stop(clear_fault=clear):
                self.mode = MotorMode.RESET if self.stops else self.mode
                if clear and self.clears_faults:
                    self.faults = NO_FAULT
                    self.parameters[fault_word(self.model).index] = bytes(4)
            case messages.WriteParameter(index=index, payload=payload):
                self._write(index, payload)
            case messages.ReadParameter(index=index):
                return self._read(index, host)
            case messages.SetActiveReport(is_on=is_on):
                self.reports = is_on
            case messages.OperationControl():
                host = host if self.stored_host is None else self.stored_host
        return self.status(host)

    def _write(self, index: int, payload: bytes) -> None:
        name = next((p.name for p in PARAMETERS.values() if p.index == index), "")
        if name in self.limits:
            payload = struct.pack("<f", min(struct.unpack("<f", payload)[0], self.limits[name]))
        if name not in self.unwritable:
            self.parameters[index] = payload

    def _read(self, index: int, host: int) -> messages.ParameterReply:
        name = next((p.name for p in PARAMETERS.values() if p.index == index), "fault_word")
        if name == "mechPos":
            own = self.position if self.counted is None else self.counted
            return messages.ParameterReply(self.motor_id, host, index, struct.pack("<f", own))
        return messages.ParameterReply(self.motor_id, host, index, self.parameters[index], name not in self.unreadable)

    @property
    def commands(self) -> list[messages.OperationControl]:
        return [command for command in self.heard if isinstance(command, messages.OperationControl)]


class ScriptedMotors:
    """Threads that let motors answer, one per channel, until `close`."""

    def __init__(self, channels: Sequence[tuple[BusAddress, Sequence[ScriptedMotor]]]) -> None:
        self.buses = [can.Bus(interface=a.interface, channel=a.channel) for a, _ in channels]
        self._closing = threading.Event()
        self._threads = [
            threading.Thread(target=self._run, args=(bus, motors), name=f"motors {address}")
            for bus, (address, motors) in zip(self.buses, channels, strict=True)
        ]
        for thread in self._threads:
            thread.start()

    def _run(self, bus: can.BusABC, motors: Sequence[ScriptedMotor]) -> None:
        reported = time.monotonic()
        while not self._closing.is_set():
            message = bus.recv(0.002)
            if time.monotonic() - reported >= 0.003:
                reported = time.monotonic()
                for motor in motors:
                    if motor.reports and motor.answers and not motor.is_silent:
                        self.send(bus, motor.status(is_report=True), motor.model)
            if message is None:
                continue
            frame = Frame(message.arbitration_id, bytes(message.data), message.is_extended_id, message.is_remote_frame)
            for motor in motors:
                command = decode_command(frame, motor.motor_id, MOTORS[motor.model])
                if hasattr(command, "motor_id") and type(command).__name__ not in {"Ignored", "Malformed"}:
                    reply = motor.answer(command)  # type: ignore[arg-type]
                    if reply is not None and motor.answers:
                        self.send(bus, reply, motor.model)

    @staticmethod
    def send(bus: can.BusABC, reply: messages.Reply, model: str = "rs-02") -> None:
        ScriptedMotors.send_frame(bus, encode_reply(reply, MOTORS[model]))

    @staticmethod
    def send_frame(bus: can.BusABC, frame: Frame) -> None:
        bus.send(
            can.Message(
                arbitration_id=frame.arbitration_id,
                data=frame.data,
                is_extended_id=frame.is_extended,
                is_error_frame=frame.is_error,
            )
        )

    def close(self) -> None:
        self._closing.set()
        for thread in self._threads:
            thread.join()
        for bus in self.buses:
            bus.shutdown()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def fault_report(motor_id: int, faults: FaultBit, warnings: WarningBit = NO_WARNING) -> messages.FaultReport:
    return messages.FaultReport(motor_id, HOST, faults, warnings)
