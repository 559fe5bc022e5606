"""The torque of all motors in every period of their control loop, and how warm it makes them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from humanoid_sim.hardware.emulation.firmware import torque_limit
from humanoid_sim.hardware.emulation.law import MitTargets, RunMode, Servo, servo_current
from humanoid_sim.hardware.emulation.memory import parameter
from humanoid_sim.hardware.emulation.motor_state import MotorIdentity, MotorState
from humanoid_sim.hardware.emulation.thermal import heat
from humanoid_sim.mit import FloatArray

__all__ = ["Drives"]


class Drives:
    """The motors' control loops side by side: arrays of shape (m,), motor frame. Follows what the firmwares decide."""

    def __init__(self, identities: Sequence[MotorIdentity]) -> None:
        """All motors without power, at the temperature of the room."""
        self._identities = tuple(identities)
        count = len(identities)
        self._targets = MitTargets(np.array([identity.model.peak_torque for identity in identities]))
        self._servos: dict[int, Servo] = {}
        self._origin = np.zeros(count)
        self._range = np.array([identity.model.position for identity in identities])
        self._rated = np.array([identity.model.rated_torque for identity in identities])
        self._position = np.empty(count)
        self.rise = np.zeros(count)
        """Shape (m,), K above the room."""

    def follow(self, motor: int, state: MotorState) -> None:
        """Do from the next period on what a motor's firmware says."""
        identity, targets = self._identities[motor], self._targets
        self._origin[motor] = state.origin
        targets.limit[motor] = torque_limit(identity, state)
        run_mode = RunMode(int(parameter(state, "run_mode")))
        servo = self._servos.pop(motor, None)
        targets.release(motor)
        if not state.is_running:
            return
        if run_mode is not RunMode.OPERATION:
            self._servos[motor] = _servo(identity, state, run_mode, servo)
        elif state.command is not None:
            command, factor = state.command, identity.firmware.gain_factor
            targets.position[motor] = command.position
            targets.velocity[motor] = command.velocity
            targets.effort[motor] = command.effort
            targets.stiffness[motor] = factor * command.stiffness
            targets.damping[motor] = factor * command.damping

    def torque(self, shaft: FloatArray, velocity: FloatArray, period: float) -> FloatArray:
        """The torque of one period of the control loop.

        Args:
            shaft: shape (m,), rad, what the encoders read.
            velocity: shape (m,), rad/s.
            period: s.

        Returns:
            Shape (m,), N·m; a buffer that is valid until the next call.
        """
        position = self._position
        np.subtract(shaft, self._origin, out=position)
        np.add(position, self._range, out=position)
        np.mod(position, 2.0 * self._range, out=position)
        np.subtract(position, self._range, out=position)
        torque = self._targets.torque(position, velocity)
        for motor, servo in self._servos.items():
            identity = self._identities[motor]
            turned = float(shaft[motor] - self._origin[motor])
            current = servo_current(servo, turned, float(velocity[motor]), period)
            limit = self._targets.limit[motor]
            torque[motor] = min(max(current * identity.torque_per_ampere, -limit), limit)
        return torque

    def warm(self, torque: FloatArray, duration: float) -> None:
        """Let the windings warm up, or cool down, for a time at a torque of shape (m,)."""
        self.rise = heat(self.rise, torque, self._rated, duration)


def _servo(identity: MotorIdentity, state: MotorState, mode: RunMode, before: Servo | None) -> Servo:
    """The loops of a motor with its present parameters; what they remember stays if they were running already."""
    is_profile = mode is RunMode.PROFILE_POSITION
    servo = Servo(
        mode,
        current_target=parameter(state, "iq_ref"),
        speed_target=parameter(state, "spd_ref"),
        position_target=parameter(state, "loc_ref"),
        position_gain=parameter(state, "loc_kp"),
        speed_gain=parameter(state, "spd_kp"),
        speed_integral_gain=parameter(state, "spd_ki"),
        speed_limit=abs(parameter(state, "vel_max" if is_profile else "limit_spd")),
        acceleration=abs(parameter(state, "acc_set" if is_profile else "acc_rad")),
        current_limit=min(abs(parameter(state, "limit_cur")), identity.model.peak_current),
    )
    if before is not None and before.mode is mode:
        servo.ramped_speed, servo.integral = before.ramped_speed, before.integral
    return servo
