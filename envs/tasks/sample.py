"""What a task sees of one policy step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.reference import Alignment, Frame
from humanoid_sim.controllers.rotation import gravity_direction, rotate, rotate_inverse
from humanoid_sim.mit import FloatArray, MITState

__all__ = ["BaseSample", "StepSample"]

Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class BaseSample:
    """Pose and motion of floating bases: the origin and the axes of the base's MJCF body."""

    position: FloatArray
    """Shape (..., 3), m, world frame."""
    quaternion: FloatArray
    """Shape (..., 4), w x y z, base frame in the world frame."""
    linear_velocity: FloatArray
    """Shape (..., 3), m/s, world frame."""
    angular_velocity: FloatArray
    """Shape (..., 3), rad/s, base frame."""

    @property
    def height(self) -> FloatArray:
        """Shape (...), m, above the world's origin."""
        return self.position[..., 2]

    @property
    def gravity(self) -> FloatArray:
        """Shape (..., 3), direction of gravity in the base frame; (0, 0, -1) upright."""
        return gravity_direction(self.quaternion)

    @property
    def body_velocity(self) -> FloatArray:
        """Shape (..., 3), m/s, base frame."""
        return rotate_inverse(self.quaternion, self.linear_velocity)

    @property
    def heading_velocity(self) -> FloatArray:
        """Shape (..., 2), m/s, forward and to the left, in the frame that is turned by the heading only."""
        w, x, y, z = (self.quaternion[..., i] for i in range(4))
        yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        cos, sin = np.cos(yaw), np.sin(yaw)
        vx, vy = self.linear_velocity[..., 0], self.linear_velocity[..., 1]
        return np.stack([cos * vx + sin * vy, cos * vy - sin * vx], axis=-1)

    @property
    def yaw_rate(self) -> FloatArray:
        """Shape (...), rad/s, about the vertical."""
        return rotate(self.quaternion, self.angular_velocity)[..., 2]

    @property
    def tilt(self) -> FloatArray:
        """Shape (...), rad, between the base's z axis and the vertical, 0 to π."""
        x, y = self.quaternion[..., 1], self.quaternion[..., 2]
        tilt: FloatArray = 2.0 * np.arcsin(np.minimum(np.sqrt(x * x + y * y), 1.0))
        return tilt


@dataclass(frozen=True, slots=True, eq=False)
class StepSample:
    """One policy step: an action, and where it has brought the robot one `policy_dt` later."""

    state: MITState
    """At the end of the step, as it is: whatever delays or noise the policy sees it through."""
    action: Float32Array
    """Shape (..., m), raw: the one that was in force during the step."""
    previous_action: Float32Array
    """Shape (..., m), raw: the one before; zeros in the first step."""
    torque: FloatArray
    """Shape (..., n), N·m, saturated, of the step's last physics step."""
    frame: Frame
    """Shape (...), the reference frame that belongs to `state`: the next one to be shown, frame 1 after the first step
    and the last one again from the end of the motion on."""
    step: int | npt.NDArray[np.integer]
    """Shape (...), policy steps since the start, this one included: at least 1."""
    body_position: FloatArray
    """Shape (..., b, 3), m, base frame, of the contract's `body_names` at `state`; b is 0 where it names none."""
    body_quaternion: FloatArray
    """Shape (..., b, 4), w x y z, body frame in the base frame; of either sign."""
    command: FloatArray
    """Shape (..., 3), vx and vy in m/s and yaw rate in rad/s, heading frame: what was asked for during the step."""
    base: BaseSample | None = None
    """Of robots with a floating base, at `state`; None for those with a fixed one."""
    alignment: Alignment | None = None
    """How the reference was laid onto the robot at the start."""
