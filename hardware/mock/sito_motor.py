"""A mock Sito motor.

There is no public manual. Assumptions, none verified on a motor: a disabled motor accepts gains and commands; both
survive a reset but not a power cycle; its two feedback frames leave together while it is enabled; its encoder is
absolute within one turn; a motor that protects itself goes limp and silent; nothing stops a motor whose host has fallen
silent.
"""

from __future__ import annotations

import math

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.mock.plant import LOWEST_VOLTAGE, Drive, Sensed
from humanoid_sim.hardware.sito import protocol
from humanoid_sim.robots.motors import MotorModel

_HOTTEST = 120.0  # °C, assumed


class SitoMotor:
    """A motor's firmware without a bus and without physics; see `RobstrideMotor` for its interface."""

    def __init__(self, model: MotorModel, can_id: int) -> None:
        self.model, self.can_id = model, can_id
        self.sensed = Sensed()
        self.power_on()

    def power_on(self) -> None:
        """Boot, disabled: the first position is in ±π."""
        self.origin = self.sensed.shaft - math.remainder(self.sensed.shaft, 2.0 * math.pi)
        self.gains = protocol.Gains(self.can_id, 0.0, 0.0)
        self.command = protocol.Command(self.can_id, 0.0, 0.0, 0.0)
        self.interval = 0.0  # s between two frames of one kind of feedback; 0: none
        self._reset()

    def _reset(self) -> None:
        self.is_running = False
        self.next_feedback = math.inf

    def is_for(self, frame: Frame) -> bool:
        parts = protocol.split_identifier(frame)
        return parts is not None and parts[0] == self.can_id

    def receive(self, frame: Frame, time: float) -> tuple[Frame, ...]:
        """Execute a frame that names it, at a time, s; nothing is answered."""
        match protocol.decode(frame, self.model):
            case protocol.Enable(interval=interval) if not self.faults():
                self.is_running, self.interval = True, interval / 1000.0
                self.next_feedback = time + self.interval if interval else math.inf
            case protocol.Reset():
                self._reset()
            case protocol.Gains() as gains:
                self.gains = gains
            case protocol.Command() as command:
                self.command = command
        return ()

    def advance(self, time: float) -> tuple[Frame, ...]:
        """Check protections at a time, s; returns the feedback that is due."""
        if self.is_running and self.faults():
            self._reset()
        if time < self.next_feedback:
            return ()
        periods = math.ceil((time - self.next_feedback) / self.interval + 1e-9)
        self.next_feedback += self.interval * periods
        sensed, model = self.sensed, self.model
        velocity = min(max(sensed.velocity, -model.velocity), model.velocity)
        torque = min(max(sensed.torque, -model.effort), model.effort)
        feedback = protocol.Feedback(self.can_id, velocity, torque)
        position = protocol.PositionFeedback(self.can_id, sensed.shaft - self.origin)
        return protocol.encode(feedback, model), protocol.encode(position, model)

    def drive(self) -> Drive:
        """Gains without a command hold position 0."""
        limit = self.model.peak_torque
        if not self.is_running:
            return Drive(limit=limit, origin=self.origin)
        goal = self.command.position, self.command.velocity, self.command.effort
        return Drive(*goal, self.gains.stiffness, self.gains.damping, limit, self.origin)

    def faults(self) -> str:
        sensed = self.sensed
        is_sound = sensed.voltage >= LOWEST_VOLTAGE and sensed.temperature < _HOTTEST and not sensed.overcurrent
        return "" if is_sound else "protects itself"

    def zero_torque(self) -> tuple[Frame, ...]:
        messages = protocol.Gains(self.can_id, 0.0, 0.0), protocol.Command(self.can_id, 0.0, 0.0, 0.0)
        return tuple(protocol.encode(message, self.model) for message in messages)
