"""How warm the windings get: one heat capacity, heated by the current squared, cooled towards the room.

No source states a motor's thermal data. Assumed: 60 K above the room in the long run at rated torque, with a time
constant of four minutes; copper losses grow with the square of the current, and the current is proportional to the
torque.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray

__all__ = ["RATED_RISE", "TIME_CONSTANT", "heat"]

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
