"""Fit of a motion to a robot: how far its bodies, its base and its joints are from what the robot has."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.rotation import matrix, rotation_angle
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.prepare.source_motion import SourceMotion, other_quaternion_order, swap_quaternion_order
from humanoid_sim.robots.description import RobotDescription

_LEAST_SPEED = 0.02
"""rad/s, root mean square: below it velocities say nothing."""
_RATIO, _CORRELATION = 1.25, 0.8
"""Factor between velocities and derivatives that a filter or another way of taking differences explains, and the least
correlation: rates of 25, 30, 50 and 60 frames per second are farther apart."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Largest errors that bodies may have."""

    position: float
    """m"""
    angle: float
    """rad"""


@dataclass(frozen=True, slots=True)
class BodyCheck:
    """Distance of a body of the motion from where the robot's forward kinematics puts it."""

    name: str
    position_rms: float
    """m, over frames."""
    position_max: float
    """m"""
    angle_rms: float
    """rad"""
    angle_max: float
    """rad"""
    worst_frame: int
    """Frame of the largest position error; of the largest angle where the position is within the tolerance."""

    def excess(self, tolerance: Tolerance) -> float:
        """Return the larger error in tolerances: more than 1 is a mismatch."""
        return max(self.position_max / tolerance.position, self.angle_max / tolerance.angle)


@dataclass(frozen=True, slots=True)
class LimitExcess:
    """A joint of the motion that is beyond its limits."""

    joint: str
    frame: int
    position: float
    """rad"""
    lower: float
    """rad"""
    upper: float
    """rad"""

    @property
    def excess(self) -> float:
        """Rad beyond the limit."""
        return max(self.lower - self.position, self.position - self.upper)

    @property
    def words(self) -> str:
        """Return the rest of a sentence that begins with the joint."""
        where = f"is at {self.position:.3f} rad in frame {self.frame}"
        return f"{where}, beyond its limits {self.lower:g} to {self.upper:g}"


def check_bodies(motion: SourceMotion, skeleton: Skeleton, tolerance: Tolerance) -> tuple[BodyCheck, ...]:
    """Errors per body, in the motion's order; empty where the motion lacks joints or bodies to compare.

    The tolerance decides which frame is the worst. Raises `InputError` if the world cannot be related to the robot's
    base.
    """
    if motion.joint_position is None or motion.body_position is None:
        return ()
    expected_position, expected_rotation = skeleton.poses(motion.joint_position, motion.body_names)
    position = motion.body_position
    rotation = None if motion.body_quaternion is None else matrix(motion.body_quaternion)
    if motion.frame == "world":
        base_position, base_rotation = _base(motion, skeleton, expected_position, expected_rotation)
        position = np.einsum("tji,tbj->tbi", base_rotation, position - base_position[:, None])
        rotation = None if rotation is None else np.einsum("tji,tbjk->tbik", base_rotation, rotation)
    offset = position - expected_position
    distance = np.sqrt((offset * offset).sum(axis=-1))
    angle = np.zeros_like(distance) if rotation is None else rotation_angle(rotation, expected_rotation)
    return tuple(_summary(name, distance[:, i], angle[:, i], tolerance) for i, name in enumerate(motion.body_names))


def _base(
    motion: SourceMotion, skeleton: Skeleton, position: FloatArray, rotation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Position (F, 3) and rotation (F, 3, 3) of the base in the motion's world."""
    if motion.base_position is not None and motion.base_quaternion is not None:
        return motion.base_position, matrix(motion.base_quaternion)
    if skeleton.description.is_floating:
        raise InputError(
            f"motion: holds no pose of '{skeleton.base}', the floating base of '{skeleton.description.name}', so its "
            "bodies cannot be compared; it needs that body too"
        )
    if motion.body_position is None or motion.body_quaternion is None:
        raise InputError(
            f"motion: holds neither the pose of '{skeleton.base}' nor orientations, so its world frame "
            "cannot be related to the robot"
        )
    # A base that does not move stands wherever the first body of the first frame says.
    turn = matrix(motion.body_quaternion[0, 0]) @ rotation[0, 0].T
    place = motion.body_position[0, 0] - turn @ position[0, 0]
    return np.repeat(place[None], len(position), axis=0), np.repeat(turn[None], len(position), axis=0)


def _summary(name: str, distance: FloatArray, angle: FloatArray, tolerance: Tolerance) -> BodyCheck:
    worst = distance if distance.max() > tolerance.position else angle
    return BodyCheck(
        name=name,
        position_rms=float(np.sqrt((distance * distance).mean())),
        position_max=float(distance.max()),
        angle_rms=float(np.sqrt((angle * angle).mean())),
        angle_max=float(angle.max()),
        worst_frame=int(worst.argmax()),
    )


def worst_excess(joint_position: FloatArray, description: RobotDescription) -> LimitExcess | None:
    """Return the joint and frame farthest beyond the limits; None if all (F, n), rad, robot's order, are within."""
    beyond = np.maximum(description.lower - joint_position, joint_position - description.upper)
    if beyond.max() <= 0.0:
        return None
    frame, joint = (int(i) for i in np.unravel_index(int(beyond.argmax()), beyond.shape))
    described = description.joints[joint]
    position = float(joint_position[frame, joint])
    return LimitExcess(described.name, frame, position, described.lower, described.upper)


def is_upside_down(source: SourceMotion) -> bool:
    """Tell whether the base is mostly upside down, and would be upright with quaternions in the other order."""
    if source.base_quaternion is None:
        return False
    order = source.quaternion_order
    up, otherwise = (
        float(matrix(swap_quaternion_order(source.base_quaternion, each))[:, 2, 2].mean())
        for each in (order, other_quaternion_order(order))
    )
    return up < 0.0 and otherwise > 0.5


def refuse_velocities(motion: SourceMotion) -> None:
    """Refuse joint velocities that are not the derivatives of the joint positions at the motion's frame rate.

    Raises `InputError`.
    """
    if motion.joint_position is None or motion.joint_velocity is None or motion.frame_count < 3:
        return
    rate = np.gradient(motion.joint_position, 1.0 / motion.fps, axis=0)
    velocity = motion.joint_velocity
    power, own, cross = (float((a * b).mean()) for a, b in ((rate, rate), (velocity, velocity), (rate, velocity)))
    if power < _LEAST_SPEED**2:
        return
    ratio, correlation = cross / power, cross / math.sqrt(power * own) if own > 0.0 else 0.0
    if correlation < _CORRELATION or not 1.0 / _RATIO < ratio < _RATIO:
        raise InputError(
            f"{motion.source}: joint velocities are {ratio:.2g} times the derivatives of joint positions at fps "
            f"{motion.fps:g}, correlation {correlation:.2f}, expected 1 and 1; correct fps or velocities, or let "
            "--velocities positions compute them"
        )
