"""Ready frames for Sito motors: what a session sends every tick, and what makes a motor limp, damped or disabled.

Gains have a frame of their own, which nothing acknowledges, and hold until others come. So what a command means depends
on the gains that the motor has, and the order of the two frames matters: softer gains go before the command, stiffer
ones after it, so that no target is ever held with gains that were not meant for it. The protocol wants gains only when
they change; here they go three times then, to one motor after the other in every tick besides, and in every tick to a
motor that is to have no stiffness, because a lost frame would leave a motor stiff forever.
"""

from __future__ import annotations

import numpy as np

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.motors import EncodedFrames, MotorGroup, Rescue
from humanoid_sim.hardware.sito.codec import Command, Gains, Reset, encode
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.motors import MotorModel

_REPEATS = 2
"""Ticks after a change of gains in which they are sent again."""
_COMMAND, _GAINS = 0, 1


class SitoEncoder:
    """Commands to frames for motors in a fixed order. It knows what was sent before: one for each activation."""

    def __init__(self, motors: MotorGroup) -> None:
        """Begin with motors that have zero gains, as after enabling."""
        self._motors = motors
        fields = ("position", "velocity", "effort", "stiffness", "damping")
        self._upper = np.array([[getattr(model, name) for model in motors.model] for name in fields])
        self._lower = -self._upper
        self._lower[3:] = 0.0
        self._sent = np.zeros((2, motors.count))
        self._repeats = np.full(motors.count, _REPEATS)
        self._turn = 0

    def encode(self, values: FloatArray) -> EncodedFrames:
        """See `FrameEncoder`."""
        clipped = np.clip(values, self._lower, self._upper)
        self._turn = (self._turn + 1) % self._motors.count
        frames: list[tuple[int, int, Frame]] = []
        for i, (position, velocity, effort, stiffness, damping) in enumerate(clipped.T.tolist()):
            device_id, model = self._motors.motor_id[i], self._motors.model[i]
            command = i, _COMMAND, encode(Command(device_id, position, velocity, effort), model)
            before, has_changed = self._sent[0, i], (self._sent[:, i] != clipped[3:, i]).any()
            self._repeats[i] = _REPEATS if has_changed else self._repeats[i] - 1
            if stiffness > 0.0 and not has_changed and self._repeats[i] < 0 and i != self._turn:
                frames.append(command)
                continue
            self._sent[:, i] = clipped[3:, i]
            gains = i, _GAINS, encode(Gains(device_id, stiffness, damping), model)
            frames += [command, gains] if stiffness > before else [gains, command]
        return EncodedFrames(tuple(frames), clipped != values)


def limp_frames(device_id: int, model: MotorModel, position: float = 0.0) -> tuple[Frame, ...]:
    """Zero gains and zero current, in this order. The position, rad, says nothing while the gains are zero."""
    return damping_frames(device_id, model, 0.0, position)


def damping_frames(device_id: int, model: MotorModel, damping: float, position: float = 0.0) -> tuple[Frame, ...]:
    """Return what only brakes a motor, N·m·s/rad: gains twice, for no frame is acknowledged, then the command."""
    gains = encode(Gains(device_id, 0.0, min(max(damping, 0.0), model.damping)), model)
    return gains, gains, encode(Command(device_id, position, 0.0, 0.0), model)


def reset_frames(device_id: int, model: MotorModel) -> tuple[Frame, ...]:
    """Return what disables a motor: limp first, in case it does not obey the reset."""
    return *limp_frames(device_id, model), encode(Reset(device_id), model)


def rescue_frames(motors: MotorGroup, damping: FloatArray) -> tuple[Rescue, ...]:
    """Return what a guardian sends to each motor: damping, shape (motors,), N·m·s/rad, and then the reset."""
    pairs = zip(motors.motor_id, motors.model, strict=True)
    return tuple(
        (damping_frames(device_id, model, value), reset_frames(device_id, model))
        for (device_id, model), value in zip(pairs, damping.tolist(), strict=True)
    )
