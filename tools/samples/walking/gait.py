"""The start of the walking policy's training: a gait on the contract's clock, and left-right symmetry.

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
    "ANSWERS",
    "ANSWER_SCALES",
    "BIGGEST",
    "COMMAND",
    "INPUTS",
    "LEAN",
    "MOST",
    "OBSERVATIONS",
    "OBSERVATION_MIRROR",
    "PHASE",
    "RATE_SCALE",
    "SENSING",
    "SIDESTEP",
    "STANDS",
    "STIRRED",
    "STRIDE",
    "SWAP",
    "SWING",
    "TURN",
    "VELOCITY_SCALE",
    "awake",
    "from_canonical",
    "gait",
    "network_input",
    "to_canonical",
]

Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]

_LEG = np.array([1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Signs of the mirror image: hip pitch, roll, yaw, knee, ankle yaw, pitch, roll."""
ACTIONS = 14
_SWAP = np.concatenate([np.arange(7, 14), np.arange(7)])

ACTION_MIRROR = (_SWAP, np.concatenate([_LEG, _LEG]).astype(np.float32))
"""Source of each of the 14 values of the mirror image, and its sign."""

PHASE = 51
"""Index of the sine of the phase in the observation; its cosine follows."""
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

RATE_SCALE = 0.25
"""Scale of the observed angular velocity, the contract's."""
COMMAND = 6
"""Index of the velocity command in the observation: forward, left, m/s, and yaw rate, rad/s."""
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

ANSWERS = ACTIONS + 4
"""Values of the network: what is added to the actions, then to the gait's size, forward, sideways and turning step."""
ANSWER_SCALES = np.array([2.0, 1.0, 1.0, 1.0], dtype=np.float32)
"""Scales of those four: 1, m/s, m/s, rad/s."""
BIGGEST = 1.5
"""Largest value of the gait's size, which is 1 while the robot walks undisturbed."""

INPUTS = OBSERVATIONS + 2
"""Values that the network sees: the observation, and the velocity that `sensed` finds in it."""
VELOCITY_SCALE = 2.0
"""Gain of that velocity, 1/(m/s)."""
_THIGH, _SHANK, _LEG_LENGTH = 0.33, 0.34, 0.7
"""m, from hip to knee, from knee to ankle, and from hip to ankle roll of a leg that is a little bent."""
_JOINT_RATE_SCALE = 0.05
"""Scale of the observed joint velocities, the contract's."""
RATES = 23
"""Index of the first of them in the observation."""
SWAP = 0.4
"""Value of 1 - cos(phase) up to which the foot that is about to swing still bears some of the weight."""


def _sensing() -> Float32Array:
    """From what is observed to the velocity of the base over each of the feet, shape (53, 2, 2)."""
    matrix = np.zeros((OBSERVATIONS, 2, ACTIONS // 7), dtype=np.float32)
    for foot in range(2):
        hip, roll, knee = (RATES + 7 * foot + i for i in (0, 1, 3))
        matrix[1, 0, foot] = (_THIGH + _SHANK) / RATE_SCALE
        matrix[hip, 0, foot] = (_THIGH + _SHANK) / _JOINT_RATE_SCALE
        matrix[knee, 0, foot] = _SHANK / _JOINT_RATE_SCALE
        matrix[0, 1, foot] = -_LEG_LENGTH / RATE_SCALE
        matrix[roll, 1, foot] = -_LEG_LENGTH / _JOINT_RATE_SCALE
    return matrix * np.float32(VELOCITY_SCALE)


SENSING = _sensing()


STANDS = 0.05
"""m/s and rad/s: magnitude of a command below which it is to stand."""
STIRRED = 0.12, 0.22
"""m/s: speed over its feet from which on a robot that is to stand begins to step, and from which on it steps fully."""


def awake(observation: Float32Array) -> Float32Array:
    """Return what is observed, shape (..., 53), with a gait clock that a robot at rest does not see.

    The clock runs all the time. A robot that is to stand and does is shown sine and cosine 0: neither the gait nor the
    network moves a foot. The faster its base moves over its feet, because something pushed it, the more it sees of
    the clock, and steps until it is at rest.
    """
    command = observation[..., COMMAND : COMMAND + 3]
    over_left, over_right = (observation @ SENSING[:, :, foot] for foot in range(2))
    velocity = 0.5 / VELOCITY_SCALE * (over_left + over_right)
    speed = np.sqrt((velocity * velocity).sum(axis=-1, keepdims=True))
    low, high = STIRRED
    stirred = np.clip((speed - low) / (high - low), 0.0, 1.0)
    stands = (command * command).sum(axis=-1, keepdims=True) < STANDS * STANDS
    share = np.where(stands, stirred, 1.0)
    return np.concatenate([observation[..., :PHASE], observation[..., PHASE:] * share], axis=-1, dtype=np.float32)


def network_input(observation: Float32Array) -> Float32Array:
    """Return what the network sees, shape (..., 55): the observation, and the base's velocity over the standing foot.

    The policy does not observe its velocity. A leg whose foot stands measures it.

    Args:
        observation: shape (..., 53), as `to_canonical` gives it.
    """
    stands = np.clip((1.0 - observation[..., PHASE + 1, None]) / SWAP, 0.0, 1.0)
    over_left, over_right = (observation @ SENSING[:, :, foot] for foot in range(2))
    velocity = over_left + stands * (over_right - over_left)
    return np.concatenate([observation, velocity], axis=-1, dtype=np.float32)


def gait(observation: Float32Array, answer: Float32Array) -> Float32Array:
    """Return the action of gait and network together, shape (..., 14), raw, while the left leg swings.

    Args:
        observation: shape (..., 53), as `to_canonical` gives it. Where no clock is seen, the gait is the default pose.
        answer: shape (..., 18), of the network, within ±`MOST`.
    """
    sine, cosine = observation[..., PHASE, None], observation[..., PHASE + 1, None]
    asked = answer[..., ACTIONS:] * ANSWER_SCALES
    size = np.clip(1.0 + asked[..., :1], 0.0, BIGGEST)
    forward, left, turn = (observation[..., COMMAND + i, None] + asked[..., 1 + i, None] for i in range(3))
    step = forward * STRIDE + left * SIDESTEP + turn * TURN
    ahead = np.maximum(observation[..., COMMAND, None], 0.0) * AHEAD
    made = size * (sine * (LEAN + SWING) + cosine * step) + ahead
    return np.asarray(made + answer[..., :ACTIONS], dtype=np.float32)


def to_canonical(observation: Float32Array) -> tuple[Float32Array, BoolArray]:
    """Say what `awake` gives, shape (..., 53), mirrored where the right leg swings; and where that is, shape (...)."""
    mirrored = observation[..., PHASE] < 0.0
    source, sign = OBSERVATION_MIRROR
    return np.where(mirrored[..., None], observation[..., source] * sign, observation), mirrored


def from_canonical(action: Float32Array, mirrored: BoolArray) -> Float32Array:
    """Return the action, shape (..., 14), mirrored back where the observation was."""
    source, sign = ACTION_MIRROR
    return np.where(mirrored[..., None], action[..., source] * sign, action)
