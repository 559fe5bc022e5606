"""A mock Robstride motor.

The manuals leave open, and this decides: any frame for a motor feeds its CAN timeout; a motor with a latched fault
answers an enable and stays in reset mode; a fault report is sent when its words change. None of it was compared with a
motor. Of the run modes only operation (the MIT law) can be enabled.
"""

from __future__ import annotations

import math

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.mock.plant import LOWEST_VOLTAGE, Drive, Sensed
from humanoid_sim.hardware.robstride import parameters, protocol
from humanoid_sim.hardware.robstride.firmware import emulated_version
from humanoid_sim.hardware.robstride.protocol import FaultBit, FrameType, MotorMode, OperationControl, StatusFault
from humanoid_sim.robots.motors import MotorModel

_LIMP = OperationControl(0.0, 0.0, 0.0, 0.0, 0.0)


class RobstrideMotor:
    """A motor's firmware without a bus and without physics."""

    def __init__(self, model: MotorModel, can_id: int, uid: bytes) -> None:
        self.model, self.can_id, self.uid = model, can_id, uid
        self.version = emulated_version(model)  # of its firmware, which it reports
        self.sensed = Sensed()
        self.stored: dict[str, float] = {}  # parameters that were saved
        self.zero = 0.0  # rad, the shaft's angle, up to whole turns, that counts as 0
        self.power_on()

    def power_on(self) -> None:
        """Boot, disabled, at 0..2π, or ±π with `zero_sta` 1."""
        limits = {"limit_torque": self.model.peak_torque, "limit_cur": self.model.peak_current}
        defaults = {name: known.default or 0.0 for name, known in parameters.PARAMETERS.items() if known.is_writable}
        self.parameters = defaults | limits | self.stored
        lowest = -math.pi if self.parameters["zero_sta"] else 0.0
        self.origin = self.sensed.shaft - lowest - (self.sensed.shaft - self.zero - lowest) % (2.0 * math.pi)
        self.host_id = protocol.DEFAULT_HOST_ID
        self.received, self.next_report = -math.inf, math.inf
        self.status_faults, self.fault_bits = StatusFault(0), FaultBit(0)
        self._reset()

    def _reset(self) -> None:
        self.is_running = False
        self.command = _LIMP

    def is_for(self, frame: Frame) -> bool:
        return frame.arbitration_id & 0xFF == self.can_id

    def receive(self, frame: Frame, time: float) -> tuple[Frame, ...]:
        """Execute a frame that names it, at a time, s; returns its answers."""
        kind, high, host, _ = protocol.split_identifier(frame.arbitration_id)
        if not frame.is_extended or frame.is_error or frame.is_remote:
            return ()
        if kind == FrameType.OPERATION_CONTROL and len(frame.data) == 8:
            self.command = protocol.decode_operation(frame, self.model) if self.is_running else _LIMP
            self.received = time
            return (protocol.encode_reply(self._status(), self.model, self.host_id),)
        reply = self._execute(kind, high, frame.data.ljust(8, b"\0"), time)
        if reply is None:
            return ()
        self.received, self.host_id = time, host  # it answers the last host that sent anything but operation control
        return (protocol.encode_reply(reply, self.model, host),)

    def advance(self, time: float) -> tuple[Frame, ...]:
        """Check protections and timeouts at a time, s; returns the frames that it sends unasked."""
        replies: list[protocol.Reply] = []
        before = self.fault_bits
        self._protect()
        if self.fault_bits != before:
            replies.append(protocol.FaultReport(self.can_id, self.fault_bits, protocol.WarningBit(0)))
        ticks = int(self.parameters["canTimeout"])
        if self.is_running and 0.0 < parameters.CAN_TIMEOUT_TICK * ticks <= time - self.received:
            self._reset()  # the mode bits show it, no fault bit
        if time >= self.next_report:
            replies.append(self._status(is_report=True))
            self.next_report += self._report_interval()
        return tuple(protocol.encode_reply(reply, self.model, self.host_id) for reply in replies)

    def drive(self) -> Drive:
        limit = min(max(self.parameters["limit_torque"], 0.0), self.model.peak_torque)  # assumed to hold in operation
        return Drive(*self.command, limit, self.origin)

    def faults(self) -> str:
        """Return its latched faults in words; empty without any."""
        return ", ".join(protocol.flag_names(self.fault_bits)) if self.fault_bits else ""  # naming flags is slow

    def zero_torque(self) -> tuple[Frame, ...]:
        return (protocol.encode_operation(self.can_id, _LIMP, self.model),)

    def _status(self, *, is_report: bool = False) -> protocol.Status:
        sensed, limit = self.sensed, self.model.position
        position = (sensed.shaft - self.origin + limit) % (2.0 * limit) - limit  # it wraps, it does not saturate
        mode = MotorMode.RUN if self.is_running else MotorMode.RESET
        measured = position, sensed.velocity, sensed.torque, sensed.temperature
        return protocol.Status(self.can_id, *measured, mode, self.status_faults, is_report)

    def _report_interval(self) -> float:
        return parameters.report_interval(max(int(self.parameters["EPScan_time"]), 1))

    def _protect(self) -> None:
        """Latch the present faults; a motor with any fault stops."""
        sensed = self.sensed
        if sensed.temperature >= self.model.fault_temperature:
            self.status_faults |= StatusFault.MOTOR_OVERTEMPERATURE
            self.fault_bits |= FaultBit.MOTOR_OVERTEMPERATURE
        if sensed.voltage < LOWEST_VOLTAGE:
            self.status_faults |= StatusFault.UNDERVOLTAGE
            self.fault_bits |= FaultBit.UNDERVOLTAGE
        if sensed.overcurrent:
            self.status_faults |= StatusFault.PHASE_OVERCURRENT
            self.fault_bits |= FaultBit.PHASE_A_OVERCURRENT
        if self.is_running and self.fault_bits:
            self._reset()

    def _execute(self, kind: int, high: int, data: bytes, time: float) -> protocol.Reply | None:  # noqa: PLR0912
        """Obey a command; None for a frame that is none. Shorter forms that other hosts send are accepted as well."""
        index = int.from_bytes(data[:2], "little")
        match kind:
            case FrameType.GET_DEVICE_ID:
                return protocol.DeviceId(self.can_id, self.uid)
            case FrameType.STOP if data.startswith(protocol.READ_VERSION):
                return protocol.Version(self.can_id, self.version)
            case FrameType.READ_PARAMETER:
                return self._read(index)
            case FrameType.SET_DEVICE_ID:
                self.can_id = high if 1 <= high <= protocol.LARGEST_MOTOR_ID else self.can_id
                return protocol.DeviceId(self.can_id, self.uid)
            case FrameType.ENABLE:
                if not (self.is_running or self.fault_bits or self.parameters["run_mode"] != parameters.OPERATION_MODE):
                    self.is_running, self.command = True, _LIMP
            case FrameType.STOP:
                self._reset()
                if data.startswith(protocol.CLEAR_FAULTS):
                    self.status_faults, self.fault_bits = StatusFault(0), FaultBit(0)
                    self._protect()
            case FrameType.SET_ZERO if data.startswith(protocol.HERE):
                if self.parameters["run_mode"] != parameters.PROFILE_POSITION_MODE:
                    self.origin = self.sensed.shaft
            case FrameType.WRITE_PARAMETER:
                self._write(index, data[4:])
            case FrameType.SAVE_PARAMETERS:
                self.stored, self.zero = dict(self.parameters), self.origin
            case FrameType.ACTIVE_REPORT if data[6] <= 1:
                self.next_report = time + self._report_interval() if data[6] else math.inf
            case _:
                return None
        return self._status()

    def _read(self, index: int) -> protocol.ParameterReply:
        sensed, word = self.sensed, parameters.fault_word(self.model.name)
        measured = {
            "mechPos": sensed.shaft - self.origin,
            "mechVel": sensed.velocity,
            "iqf": sensed.torque * self.model.peak_current / self.model.peak_torque,
            "VBUS": sensed.voltage,
            word.name: int(self.fault_bits),
        }
        known = word if index == word.index else parameters.PARAMETERS_BY_INDEX.get(index)
        values = self.parameters | measured
        if known is None or known.name not in values:
            return protocol.ParameterReply(self.can_id, index, bytes(4), is_success=False)
        return protocol.ParameterReply(self.can_id, index, parameters.pack_value(known.type, values[known.name]))

    def _write(self, index: int, payload: bytes) -> None:
        """Set a parameter, whatever its range; a read-only or unknown one, or NaN, changes nothing."""
        known = parameters.PARAMETERS_BY_INDEX.get(index)
        if known is None or known.name not in self.parameters:
            return
        value = float(parameters.unpack_value(known.type, payload))
        if not math.isnan(value):
            self.parameters[known.name] = value
