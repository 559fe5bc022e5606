"""A Robstride motor in the emulator: `firmware`'s functions with one motor's identity."""

from __future__ import annotations

from dataclasses import replace

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.emulated_motor import Drive, Reaction, Sensed
from humanoid_sim.hardware.emulation import firmware
from humanoid_sim.hardware.emulation.motor_state import MotorIdentity, MotorState, Stored
from humanoid_sim.hardware.robstride.commands import encode_command
from humanoid_sim.hardware.robstride.fields import MotorMode, flag_names
from humanoid_sim.hardware.robstride.messages import DeviceId, OperationControl, ReadParameter
from humanoid_sim.hardware.robstride.parameters import PARAMETERS
from humanoid_sim.hardware.robstride.replies import encode_reply
from humanoid_sim.robots.motors import MotorModel

_FOREIGN_HOST = 0xAA
"""Id of the other computer that asks."""


class RobstrideFirmware:
    """See `Firmware`: for one motor."""

    def __init__(self, identity: MotorIdentity, can_id: int) -> None:
        """Make a motor with its id, everything else as it comes."""
        self.identity = identity
        self._stored = Stored(can_id)

    @property
    def model(self) -> MotorModel:
        """See `Firmware`."""
        return self.identity.model

    def power_on(self, before: MotorState | None, sensed: Sensed) -> MotorState:
        """See `Firmware`."""
        return firmware.power_on(self.identity, self._stored if before is None else before.stored, sensed)

    def reset(self, state: MotorState) -> MotorState:
        """See `Firmware`."""
        return replace(state, mode=MotorMode.RESET, command=None)

    def is_for(self, state: MotorState, frame: Frame) -> bool:
        """See `Firmware`: whether a frame's last byte is its id."""
        return frame.arbitration_id & 0xFF == state.can_id

    def receive(self, state: MotorState, frame: Frame, sensed: Sensed, time: float) -> Reaction[MotorState]:
        """See `Firmware`."""
        return firmware.receive(self.identity, state, frame, sensed, time)

    def advance(self, state: MotorState, sensed: Sensed, time: float) -> Reaction[MotorState]:
        """See `Firmware`."""
        return firmware.advance(self.identity, state, sensed, time)

    def next_time(self, state: MotorState) -> float:
        """See `Firmware`."""
        return firmware.next_time(state)

    def drive(self, state: MotorState) -> Drive:
        """See `Firmware`."""
        limit, command = firmware.torque_limit(self.identity, state), state.command
        if not state.is_running or command is None:
            return Drive(0.0, 0.0, 0.0, 0.0, 0.0, limit, state.origin)
        factor = self.identity.firmware.gain_factor
        stiffness, damping = factor * command.stiffness, factor * command.damping
        return Drive(command.position, command.velocity, command.effort, stiffness, damping, limit, state.origin)

    def changes(self, before: MotorState, state: MotorState) -> tuple[str, ...]:
        """See `Firmware`."""
        lines = []
        if state.mode is not before.mode:
            lines.append("enabled" if state.is_running else "stopped, in reset mode")
        if state.status_faults != before.status_faults or state.faults != before.faults:
            names = dict.fromkeys((*flag_names(state.status_faults), *flag_names(state.faults)))
            lines.append(", ".join(names) or "faults cleared")
        return tuple(lines)

    def announcement(self, state: MotorState) -> tuple[Frame, ...]:
        """See `Firmware`: a device id, as drivers report of real ones."""
        return () if state.is_deaf else (encode_reply(DeviceId(state.can_id, self.identity.uid), self.identity.model),)

    def zero_torque(self, state: MotorState) -> tuple[Frame, ...]:
        """See `Firmware`."""
        return (encode_command(OperationControl(state.can_id, 0.0, 0.0, 0.0, 0.0, 0.0), self.identity.model),)

    def question(self, state: MotorState) -> tuple[Frame, ...]:
        """See `Firmware`: for mechPos."""
        question = ReadParameter(state.can_id, PARAMETERS["mechPos"].index, host_id=_FOREIGN_HOST)
        return (encode_command(question, self.identity.model),)
