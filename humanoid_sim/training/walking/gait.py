"""What training gives the walking policy to begin with: a gait on the contract's clock, and left-right symmetry.

The network answers what is added to the gait. It only ever sees a left leg that swings: while the right one does, what
is observed is mirrored, and the answer mirrored back. So the policy is exactly symmetric, and learns from each step
for both legs.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = [
    "ACTIONS",
    "ACTION_MIRROR",
    "AHEAD",
    "COMMAND",
    "LEAN",
    "MOST",
    "OBSERVATIONS",
    "OBSERVATION_MIRROR",
    "PHASE",
    "SIDESTEP",
    "STRIDE",
    "SWING",
    "TURN",
    "from_canonical",
    "gait",
    "to_canonical",
]

Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]

_LEG = np.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Signs of the mirror image: hip pitch, roll, yaw, knee, ankle yaw, pitch, roll."""
ACTIONS = 14
_SWAP = np.concatenate([np.arange(7, 14), np.arange(7)])

ACTION_MIRROR = (_SWAP, np.concatenate([_LEG, _LEG]).astype(np.float32))
"""Where each of the 14 values of the mirror image comes from, and its sign."""

PHASE = 51
"""Where in the observation the sine of the phase is; its cosine follows."""
OBSERVATIONS = 53


def _observation_mirror() -> tuple[npt.NDArray[np.intp], Float32Array]:
    source = np.arange(OBSERVATIONS)
    sign = np.ones(OBSERVATIONS, dtype=np.float32)
    sign[0:3] = -1.0, 1.0, -1.0  # angular velocity
    sign[3:6] = 1.0, -1.0, 1.0  # direction of gravity
    sign[6:9] = 1.0, -1.0, -1.0  # command
    for first in (9, 23, 37):  # joint positions and velocities, last action
        source[first : first + ACTIONS] = first + ACTION_MIRROR[0]
        sign[first : first + ACTIONS] = ACTION_MIRROR[1]
    sign[PHASE:] = -1.0  # half a cycle on
    return source, sign


OBSERVATION_MIRROR = _observation_mirror()
"""Likewise of the 53 values of the observation."""

COMMAND = 6
"""Where in the observation the velocity command begins: forward, left, m/s, and yaw rate, rad/s."""
MOST = 5.0
"""Magnitude of an action that the network adds to the gait."""
_SCALE = 0.25
"""rad per unit of action, of the contract."""


def _actions(left: tuple[float, ...], right: tuple[float, ...]) -> Float32Array:
    return (np.array([*left, *right]) / _SCALE).astype(np.float32)


SWING = _actions((-0.25, 0.0, 0.0, 0.5, 0.0, -0.25, 0.0), (0.0,) * 7)
"""Times the sine of the phase: the bent leg that lifts the foot and keeps it level."""
LEAN = _actions((0.0, 0.03, 0.0, 0.0, 0.0, 0.0, -0.03), (0.0, 0.03, 0.0, 0.0, 0.0, 0.0, -0.03))
"""Likewise: the base over the foot that stands."""
STRIDE = _actions((0.43, 0.0, 0.0, 0.0, 0.0, -0.43, 0.0), (-0.43, 0.0, 0.0, 0.0, 0.0, 0.43, 0.0))
"""Times the forward command and the cosine of the phase: from behind to in front, and back."""
SIDESTEP = _actions((0.0, -0.24, 0.14, 0.0, 0.0, 0.0, 0.24), (0.0, 0.24, -0.14, 0.0, 0.0, 0.0, -0.24))
"""Likewise the command to the left. The axis of the hips' roll leans: their yaw takes back what it turns."""
TURN = _actions((0.0, 0.0, -0.16, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.16, 0.0, 0.0, 0.0, 0.0))
"""Likewise the yaw rate."""

AHEAD = _actions((-0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (-0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
"""Times a forward command: both hips bend, and the body leans ahead."""


def gait(observation: Float32Array) -> Float32Array:
    """The action of the gait, shape (..., 14), raw, while the left leg swings.

    Args:
        observation: shape (..., 53), as `to_canonical` gives it. While the clock stands, the gait is the default pose.
    """
    sine, cosine = observation[..., PHASE, None], observation[..., PHASE + 1, None]
    forward, left, turn = (observation[..., i, None] for i in range(COMMAND, COMMAND + 3))
    step = forward * STRIDE + left * SIDESTEP + turn * TURN
    ahead = np.maximum(forward, 0.0) * AHEAD
    return np.asarray(sine * (LEAN + SWING) + cosine * step + ahead, dtype=np.float32)


def to_canonical(observation: Float32Array) -> tuple[Float32Array, BoolArray]:
    """What is observed, shape (..., 53), mirrored where the right leg swings; and where that is, shape (...)."""
    mirrored = observation[..., PHASE] < 0.0
    source, sign = OBSERVATION_MIRROR
    return np.where(mirrored[..., None], observation[..., source] * sign, observation), mirrored


def from_canonical(action: Float32Array, mirrored: BoolArray) -> Float32Array:
    """The action, shape (..., 14), mirrored back where the observation was."""
    source, sign = ACTION_MIRROR
    return np.where(mirrored[..., None], action[..., source] * sign, action)
