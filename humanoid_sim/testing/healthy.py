"""Ticks of a robot on which nothing is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from humanoid_sim.messages import Intent, RemoteCommand, SafetyStatus, TickInput
from humanoid_sim.mit import ANCHOR_POSE, Extern, FloatArray, MITCommand, MITState

_UPRIGHT_AT_ORIGIN = (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0)
"""Position in m and quaternion w x y z."""

_NONE: Mapping[str, int] = {}


def healthy_externs(widths: Mapping[str, int], time: float) -> dict[str, Extern]:
    """Live inputs that arrived just now: nothing commanded, nothing pressed, at rest and upright at the origin.

    Args:
        widths: name to width, as `RLPolicyController.extern` has them.
        time: s, robot's clock.
    """
    values = {name: np.zeros(width) for name, width in widths.items()}
    if widths.get(ANCHOR_POSE) == len(_UPRIGHT_AT_ORIGIN):
        values[ANCHOR_POSE] = np.array(_UPRIGHT_AT_ORIGIN)
    return {name: Extern(value, time) for name, value in values.items()}


def healthy_state(
    position: Sequence[float] | FloatArray, time: float = 0.0, externs: Mapping[str, int] = _NONE
) -> MITState:
    """Return a robot at rest and upright at `time` s.

    Args:
        position: rad, joint frame, one per joint.
        time: s, robot's clock.
        externs: name and width of live inputs.
    """
    n = len(position)
    return MITState(
        time=time,
        joint_position=np.array(position, dtype=np.float64),
        joint_velocity=np.zeros(n),
        joint_effort=np.zeros(n),
        joint_age=np.zeros(n),
        imu_quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
        imu_angular_velocity=np.zeros(3),
        imu_linear_acceleration=np.array([0.0, 0.0, 9.81]),
        extern=healthy_externs(externs, time),
    )


def healthy_tick(
    position: Sequence[float] | FloatArray,
    time: float,
    *intents: Intent,
    safety: tuple[SafetyStatus, ...] = (),
    remote: RemoteCommand | None = None,
    externs: Mapping[str, int] = _NONE,
) -> TickInput:
    """One tick of such a robot, with what an operator and a sender of remote commands ask of it."""
    return TickInput(healthy_state(position, time, externs), safety, intents, remote)


@dataclass
class ObedientJoints:
    """Joints that are where they were told to be, a tick later, as far as their limits let them."""

    position: FloatArray
    """Shape (n,), rad."""
    lower: FloatArray | float = -np.inf
    """Shape (n,), rad."""
    upper: FloatArray | float = np.inf
    """Shape (n,), rad."""

    def obey(self, command: MITCommand) -> None:
        """Take a command, shape (n,): a joint without stiffness stays where it is."""
        led = np.clip(command.position, self.lower, self.upper)
        self.position = np.where(command.stiffness > 0.0, led, self.position)
