"""The torque of all motors in every period of their control loop, and how warm it makes them.

No source states a motor's thermal data. Assumed is one heat capacity, heated by the current squared, cooled towards the
room: 60 K above it in the long run at rated torque, with a time constant of four minutes; copper losses grow with the
square of the current, and the current is proportional to the torque. A motor without a rated torque stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from humanoid_sim.hardware.emulation.firmware import wrapped
from humanoid_sim.hardware.emulation.interface import Drive
from humanoid_sim.mit import FloatArray, mit_torque
from humanoid_sim.robots.motors import MotorModel


class Drives:
    """The motors' control loops side by side: arrays of shape (m,), motor frame. Follows what the firmwares decide.

    The MIT law's error is taken from the position as the motor reports it, that is wrapped: a motor that crosses the
    end of the range sees its error jump by the whole range, which the manuals neither state nor exclude.
    """

    def __init__(self, models: Sequence[MotorModel]) -> None:
        """All motors without power, at the temperature of the room."""
        count = len(models)
        self.position, self.velocity, self.effort, self.stiffness, self.damping = np.zeros((5, count))
        """The command in force, as of an `MITCommand`; a motor that does not run has gains and effort of zero."""
        self._limit = np.array([model.peak_torque for model in models])
        self._origin = np.zeros(count)
        self._range = np.array([model.position for model in models])
        self._rated = np.array([model.rated_torque for model in models])
        self._torque, self._scratch = np.empty((2, count))
        self.rise = np.zeros(count)
        """Shape (m,), K above the room."""

    def follow(self, motor: int, drive: Drive) -> None:
        """Do from the next period on what a motor's firmware says."""
        self.position[motor], self.velocity[motor], self.effort[motor] = drive.position, drive.velocity, drive.effort
        self.stiffness[motor], self.damping[motor] = drive.stiffness, drive.damping
        self._limit[motor], self._origin[motor] = drive.limit, drive.origin

    def torque(self, shaft: FloatArray, velocity: FloatArray) -> FloatArray:
        """The torque of one period of the control loop.

        Args:
            shaft: shape (m,), rad, what the encoders read.
            velocity: shape (m,), rad/s.

        Returns:
            Shape (m,), N·m; a buffer that is valid until the next call.
        """
        position = wrapped(shaft - self._origin, self._range)
        return mit_torque(self, position, velocity, self._limit, out=self._torque, scratch=self._scratch)

    def warm(self, torque: FloatArray, duration: float) -> None:
        """Let the windings warm up, or cool down, for a time at a torque of shape (m,)."""
        self.rise = heat(self.rise, torque, self._rated, duration)


RATED_RISE = 60.0
"""K above the room at rated torque, in the long run."""
TIME_CONSTANT = 240.0
"""s"""


def heat(rise: FloatArray, torque: FloatArray, rated_torque: npt.ArrayLike, duration: float) -> FloatArray:
    """The temperature rise after some time at a torque: exact for a constant one.

    Args:
        rise: shape (..., m), K above the room, at the beginning.
        torque: shape (..., m), N·m.
        rated_torque: shape (m,), N·m, of continuous duty.
        duration: s.

    Returns:
        Shape (..., m), K; a new array.
    """
    final = RATED_RISE * np.square(torque / np.asarray(rated_torque))
    warmed: FloatArray = final + (rise - final) * np.exp(-duration / TIME_CONSTANT)
    return warmed
