"""A mock Robstride motor.

The manuals leave open, and this decides: any frame for a motor feeds its CAN timeout; a motor with a latched fault
answers an enable and stays in reset mode; a fault report is sent when its words change. None of it was compared with a
motor. Of the run modes only operation (the MIT law) can be enabled.
"""

from __future__ import annotations

import math
from dataclasses import replace

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.mock.motor import Drive, Sensed
from humanoid_sim.hardware.robstride import messages
from humanoid_sim.hardware.robstride.codec import LARGEST_MOTOR_ID, decode_command, encode_command, encode_reply
from humanoid_sim.hardware.robstride.firmware import FirmwareVersion, firmware_of
from humanoid_sim.hardware.robstride.messages import FaultBit, MotorMode, StatusFault, WarningBit, flag_names
from humanoid_sim.hardware.robstride.parameters import (
    PARAMETERS,
    PARAMETERS_BY_INDEX,
    CanTimeout,
    RunMode,
    default_value,
    fault_word,
    function_codes,
    pack_value,
    report_interval,
    unpack_value,
)
from humanoid_sim.robots.motors import MotorModel

STALL_TIME = 2.0
"""s at the torque limit without motion until the overload protection trips: the manuals do not state its rule."""
_STILL = 0.05  # rad/s, below which the shaft counts as still
_VOLTAGES = 12.0, 60.0  # V, the manuals' limits
_FIRST_NEWER = 0x702A  # parameters from here on exist in newer firmware only


class RobstrideMotor:
    """A motor's firmware without a bus and without physics."""

    def __init__(self, model: MotorModel, can_id: int, version: FirmwareVersion, uid: bytes) -> None:
        self.firmware = firmware_of(model, version)
        self.model = self.firmware.applied_to(model)
        self.can_id, self.version, self.uid = can_id, version, uid
        self.sensed = Sensed()
        self.stored: dict[int, float] = {}  # parameters that were saved, by index
        self.zero = 0.0  # rad, the shaft's angle, up to whole turns, that counts as 0
        self.power_on()

    def power_on(self) -> tuple[Frame, ...]:
        """Boot, disabled, at 0..2π, or ±π with `zero_sta` 1; returns the frames that it sends."""
        self.parameters: dict[int, float] = {}
        for index, known in PARAMETERS_BY_INDEX.items():
            if known.is_writable and (index < _FIRST_NEWER or self.firmware.has_active_reports):
                self.parameters[index] = default_value(known, self.model.name) or 0.0
        self.parameters |= self.stored
        lowest = -math.pi if self.value("zero_sta") else 0.0
        self.origin = self.sensed.shaft - lowest - (self.sensed.shaft - self.zero - lowest) % (2.0 * math.pi)
        self.host_id = messages.DEFAULT_HOST_ID
        self.received = -math.inf
        self.status_faults, self.fault_bits, self.warnings = StatusFault(0), FaultBit(0), WarningBit(0)
        self.next_report = self.stalled_since = math.inf
        self.reset()
        return (self._frame(messages.DeviceId(self.can_id, self.uid)),)

    def reset(self) -> None:
        """Leave run mode, without a fault."""
        self.is_running = False
        self.command: messages.OperationControl | None = None
        self.stalled_since = math.inf

    def value(self, name: str) -> float:
        """Return the present value of a writable parameter."""
        return self.parameters[PARAMETERS[name].index]

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
            return (self._frame(self._status()),)
        self.host_id = command.host_id  # it answers the last host that sent anything but operation control
        reply = self._execute(command, time)
        return () if reply is None else (self._frame(reply),)

    def advance(self, time: float) -> tuple[Frame, ...]:
        """Check protections and timeouts at a time, s; returns the frames that it sends unasked."""
        frames = []
        before = self.fault_bits, self.warnings
        self._protect(time)
        if (self.fault_bits, self.warnings) != before:
            report = messages.FaultReport(self.can_id, self.host_id, self.fault_bits, self.warnings)
            frames.append(self._frame(report))
        if self.is_running and time >= self._timeout_at():
            self.reset()  # the mode bits show it, no fault bit
        if time >= self.next_report:
            frames.append(self._frame(self._status(is_report=not self.firmware.reports_as_status)))
            interval = self._report_interval()
            self.next_report = max(self.next_report + interval, time + 0.5 * interval)
        return tuple(frames)

    def next_time(self) -> float:
        """Return when `advance` has something to do, protections apart; infinity: never."""
        return min(self.next_report, self._timeout_at() if self.is_running else math.inf)

    def drive(self) -> Drive:
        """Return the command of its control loop."""
        command = self.command
        if command is None:
            return Drive(limit=self._torque_limit(), origin=self.origin)
        factor = self.firmware.gain_factor
        gains = factor * command.stiffness, factor * command.damping
        return Drive(command.position, command.velocity, command.effort, *gains, self._torque_limit(), self.origin)

    def faults(self) -> str:
        """Return its latched faults in words; empty without any."""
        if not self.fault_bits:  # naming flags is slow, and every status fault has a bit here too
            return ""
        return ", ".join(dict.fromkeys((*flag_names(self.status_faults), *flag_names(self.fault_bits))))

    def zero_torque(self) -> tuple[Frame, ...]:
        """Return the frames with which another computer commands no torque."""
        return (encode_command(messages.OperationControl(self.can_id, 0.0, 0.0, 0.0, 0.0, 0.0), self.model),)

    def _frame(self, reply: messages.Reply) -> Frame:
        return encode_reply(reply, self.model)

    def _status(self, *, is_report: bool = False) -> messages.Status:
        limit = self.model.position
        return messages.Status(
            self.can_id,
            self.host_id,
            (self.sensed.shaft - self.origin + limit) % (2.0 * limit) - limit,  # it wraps, it does not saturate
            self.sensed.velocity,
            self.sensed.torque,
            self.sensed.temperature,
            MotorMode.RUN if self.is_running else MotorMode.RESET,
            self.status_faults,
            is_report,
        )

    def _timeout_at(self) -> float:
        ticks = self.value("canTimeout")
        return self.received + CanTimeout.to_seconds(int(ticks)) if ticks > 0 else math.inf

    def _report_interval(self) -> float:
        return report_interval(max(int(self.value("EPScan_time")), 1))

    def _torque_limit(self) -> float:
        """Return the limit in operation mode, N·m: no manual states that `limit_torque` holds there."""
        return min(max(self.value("limit_torque"), 0.0), self.model.peak_torque)

    def _protect(self, time: float) -> None:
        """Latch the present faults; a motor with any fault stops."""
        sensed, limit = self.sensed, self._torque_limit()
        stalls = self.is_running and abs(sensed.velocity) < _STILL and abs(sensed.torque) >= 0.99 * limit > 0.0
        self.stalled_since = min(self.stalled_since, time) if stalls else math.inf
        faults = (
            (sensed.temperature >= self.model.fault_temperature, "MOTOR_OVERTEMPERATURE", "MOTOR_OVERTEMPERATURE"),
            (sensed.voltage < _VOLTAGES[0], "UNDERVOLTAGE", "UNDERVOLTAGE"),
            (sensed.voltage > _VOLTAGES[1], "", "OVERVOLTAGE"),
            (sensed.overcurrent, "PHASE_OVERCURRENT", "PHASE_A_OVERCURRENT"),
            (time - self.stalled_since >= STALL_TIME, "STALL_OVERLOAD", "STALL_OVERLOAD"),
        )
        for is_present, in_status, in_report in faults:
            if is_present:
                self.status_faults |= StatusFault[in_status] if in_status else StatusFault(0)
                self.fault_bits |= FaultBit[in_report]
        is_warm = sensed.temperature >= self.model.warning_temperature
        self.warnings = WarningBit.MOTOR_OVERTEMPERATURE_WARNING if is_warm else WarningBit(0)
        if self.is_running and self.fault_bits:
            self.reset()

    def _execute(  # noqa: PLR0911, PLR0912 - one case for each command
        self, command: messages.Command, time: float
    ) -> messages.Reply | None:
        match command:
            case messages.GetDeviceId():
                return messages.DeviceId(self.can_id, self.uid)
            case messages.ReadVersion():
                return messages.Version(self.can_id, self.host_id, self.version)
            case messages.Enable():
                if not (self.is_running or self.fault_bits or self.value("run_mode")):
                    self.is_running, self.command = True, None
            case messages.Stop(clear_fault=clear):
                self.reset()
                if clear:
                    self.status_faults, self.fault_bits = StatusFault(0), FaultBit(0)
                    self._protect(time)
            case messages.SetZero():
                if self.value("run_mode") != RunMode.PROFILE_POSITION:
                    self.origin = self.sensed.shaft
                    self.command = None if self.command is None else replace(self.command, position=0.0)
            case messages.SetDeviceId(new_id=new_id):
                if not 1 <= new_id <= LARGEST_MOTOR_ID:
                    return None
                self.can_id = new_id
                return messages.DeviceId(new_id, self.uid)
            case messages.ReadParameter(index=index):
                payload = self._read(index)
                return messages.ParameterReply(
                    self.can_id, self.host_id, index, payload or bytes(4), payload is not None
                )
            case messages.WriteParameter(index=index, payload=payload):
                self._write(index, payload)
            case messages.SaveParameters():
                self.stored, self.zero = dict(self.parameters), self.origin
            case messages.SetActiveReport(is_on=is_on):
                if not self.firmware.has_active_reports:
                    return None
                self.next_report = time + self._report_interval() if is_on else math.inf
            case _:
                return None
        return self._status()

    def _read(self, index: int) -> bytes | None:
        """Return a parameter's 4 bytes; None if there is no such parameter."""
        sensed, word = self.sensed, fault_word(self.model.name)
        live = {
            "mechPos": sensed.shaft - self.origin,
            "mechVel": sensed.velocity,
            "iqf": sensed.torque * self.model.peak_current / self.model.peak_torque,
            "VBUS": sensed.voltage,
            "torque_fdb": sensed.torque,
        }
        known = PARAMETERS_BY_INDEX.get(index) or function_codes(self.model.name).get(index)
        if index == word.index:
            return pack_value(word.type, int(self.fault_bits))
        if known is not None and (known.name in live or index in self.parameters):
            return pack_value(known.type, live[known.name] if known.name in live else self.parameters[index])
        return None

    def _write(self, index: int, payload: bytes) -> None:
        """Set a parameter, whatever its range; a read-only or unknown one, or NaN, changes nothing."""
        if index not in self.parameters:
            return
        parameter = PARAMETERS_BY_INDEX[index]
        value = float(unpack_value(parameter.type, payload))
        is_mode = parameter.name == "run_mode"
        if not math.isnan(value) and not (is_mode and (self.is_running or value not in tuple(RunMode))):
            self.parameters[index] = value
