"""A mock Robstride motor.

The manuals leave open, and this decides: any frame for a motor feeds its CAN timeout; a motor with a latched fault
answers an enable and stays in reset mode; a fault report is sent when its words change. None of it was compared with a
motor. Of the run modes only operation (the MIT law) can be enabled.
"""

from __future__ import annotations

import math

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.mock.motor import LOWEST_VOLTAGE, Drive, Sensed
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.codec import LARGEST_MOTOR_ID, decode_command, encode_command, encode_reply
from humanoid_sim.hardware.robstride.firmware import emulated_version
from humanoid_sim.hardware.robstride.messages import FaultBit, MotorMode, StatusFault, WarningBit, flag_names
from humanoid_sim.hardware.robstride.parameters import (
    PARAMETERS,
    PARAMETERS_BY_INDEX,
    CanTimeout,
    RunMode,
    fault_word,
    pack_value,
    report_interval,
    unpack_value,
)
from humanoid_sim.robots.motors import MotorModel


class RobstrideMotor:
    """A motor's firmware without a bus and without physics."""

    def __init__(self, model: MotorModel, can_id: int, uid: bytes) -> None:
        self.model, self.can_id, self.uid = model, can_id, uid
        self.sensed = Sensed()
        self.stored: dict[str, float] = {}  # parameters that were saved
        self.zero = 0.0  # rad, the shaft's angle, up to whole turns, that counts as 0
        self.power_on()

    def power_on(self) -> None:
        """Boot, disabled, at 0..2π, or ±π with `zero_sta` 1."""
        limits = {"limit_torque": self.model.peak_torque, "limit_cur": self.model.peak_current}
        defaults = {name: known.default or 0.0 for name, known in PARAMETERS.items() if known.is_writable}
        self.parameters = defaults | limits | self.stored
        lowest = -math.pi if self.parameters["zero_sta"] else 0.0
        self.origin = self.sensed.shaft - lowest - (self.sensed.shaft - self.zero - lowest) % (2.0 * math.pi)
        self.host_id = messages.DEFAULT_HOST_ID
        self.received = -math.inf
        self.status_faults, self.fault_bits = StatusFault(0), FaultBit(0)
        self.next_report = math.inf
        self._reset()

    def _reset(self) -> None:
        self.is_running = False
        self.command: messages.OperationControl | None = None

    def is_for(self, frame: Frame) -> bool:
        """Return whether a frame names this motor."""
        return frame.arbitration_id & 0xFF == self.can_id

    def receive(self, frame: Frame, time: float) -> tuple[Frame, ...]:
        """Execute a frame that names it, at a time, s; returns its answers."""
        command = decode_command(frame, self.can_id, self.model)
        if isinstance(command, messages.Ignored | messages.Malformed):
            return ()
        self.received = time
        if isinstance(command, messages.OperationControl):
            self.command = command if self.is_running else None
            return (encode_reply(self._status(), self.model),)
        self.host_id = command.host_id  # it answers the last host that sent anything but operation control
        reply = self._execute(command, time)
        return () if reply is None else (encode_reply(reply, self.model),)

    def advance(self, time: float) -> tuple[Frame, ...]:
        """Check protections and timeouts at a time, s; returns the frames that it sends unasked."""
        replies: list[messages.Reply] = []
        before = self.fault_bits
        self._protect()
        if self.fault_bits != before:
            replies.append(messages.FaultReport(self.can_id, self.host_id, self.fault_bits, WarningBit(0)))
        ticks = int(self.parameters["canTimeout"])
        if self.is_running and 0.0 < CanTimeout.to_seconds(ticks) <= time - self.received:
            self._reset()  # the mode bits show it, no fault bit
        if time >= self.next_report:
            replies.append(self._status(is_report=True))
            self.next_report += self._report_interval()
        return tuple(encode_reply(reply, self.model) for reply in replies)

    def drive(self) -> Drive:
        """Return the command of its control loop."""
        command = self.command
        limit = min(max(self.parameters["limit_torque"], 0.0), self.model.peak_torque)  # assumed to hold in operation
        if command is None:
            return Drive(limit=limit, origin=self.origin)
        target = command.position, command.velocity, command.effort
        return Drive(*target, command.stiffness, command.damping, limit, self.origin)

    def faults(self) -> str:
        """Return its latched faults in words; empty without any."""
        return ", ".join(flag_names(self.fault_bits)) if self.fault_bits else ""  # naming flags is slow

    def zero_torque(self) -> tuple[Frame, ...]:
        """Return the frames with which another computer commands no torque."""
        return (encode_command(messages.OperationControl(self.can_id, 0.0, 0.0, 0.0, 0.0, 0.0), self.model),)

    def _status(self, *, is_report: bool = False) -> messages.Status:
        sensed, limit = self.sensed, self.model.position
        position = (sensed.shaft - self.origin + limit) % (2.0 * limit) - limit  # it wraps, it does not saturate
        mode = MotorMode.RUN if self.is_running else MotorMode.RESET
        measured = position, sensed.velocity, sensed.torque, sensed.temperature
        return messages.Status(self.can_id, self.host_id, *measured, mode, self.status_faults, is_report)

    def _report_interval(self) -> float:
        return report_interval(max(int(self.parameters["EPScan_time"]), 1))

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

    def _execute(self, command: messages.Command, time: float) -> messages.Reply | None:  # noqa: PLR0912 - one for each
        match command:
            case messages.GetDeviceId():
                return messages.DeviceId(self.can_id, self.uid)
            case messages.ReadVersion():
                return messages.Version(self.can_id, self.host_id, emulated_version(self.model))
            case messages.ReadParameter(index=index):
                return self._read(index)
            case messages.SetDeviceId(new_id=new_id):
                self.can_id = new_id if 1 <= new_id <= LARGEST_MOTOR_ID else self.can_id
                return messages.DeviceId(self.can_id, self.uid)
            case messages.Enable():
                if not (self.is_running or self.fault_bits or self.parameters["run_mode"]):
                    self.is_running, self.command = True, None
            case messages.Stop(clear_fault=clear):
                self._reset()
                if clear:
                    self.status_faults, self.fault_bits = StatusFault(0), FaultBit(0)
                    self._protect()
            case messages.SetZero():
                if self.parameters["run_mode"] != RunMode.PROFILE_POSITION:
                    self.origin = self.sensed.shaft
            case messages.WriteParameter(index=index, payload=payload):
                self._write(index, payload)
            case messages.SaveParameters():
                self.stored, self.zero = dict(self.parameters), self.origin
            case messages.SetActiveReport(is_on=is_on):
                self.next_report = time + self._report_interval() if is_on else math.inf
            case _:
                return None
        return self._status()

    def _read(self, index: int) -> messages.ParameterReply:
        sensed, word = self.sensed, fault_word(self.model.name)
        measured = {
            "mechPos": sensed.shaft - self.origin,
            "mechVel": sensed.velocity,
            "iqf": sensed.torque * self.model.peak_current / self.model.peak_torque,
            "VBUS": sensed.voltage,
            word.name: int(self.fault_bits),
        }
        known = word if index == word.index else PARAMETERS_BY_INDEX.get(index)
        values = self.parameters | measured
        if known is None or known.name not in values:
            return messages.ParameterReply(self.can_id, self.host_id, index, bytes(4), is_success=False)
        return messages.ParameterReply(self.can_id, self.host_id, index, pack_value(known.type, values[known.name]))

    def _write(self, index: int, payload: bytes) -> None:
        """Set a parameter, whatever its range; a read-only or unknown one, or NaN, changes nothing."""
        known = PARAMETERS_BY_INDEX.get(index)
        if known is None or known.name not in self.parameters:
            return
        value = float(unpack_value(known.type, payload))
        if not math.isnan(value):
            self.parameters[known.name] = value
