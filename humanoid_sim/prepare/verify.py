"""Is a motion this robot's? Forward kinematics of its joints must put the bodies where the motion has them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.rotation import matrix, rotation_angle
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.conventions import NamedMotion
from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.kinematics import ForwardKinematics

__all__ = ["BodyCheck", "RateCheck", "Tolerance", "Verifier", "check_rate"]


@dataclass(frozen=True, slots=True)
class Tolerance:
    """How far bodies may be off."""

    position: float
    """m"""
    angle: float
    """rad"""


@dataclass(frozen=True, slots=True)
class BodyCheck:
    """How far a body of the motion is from where the robot's forward kinematics puts it."""

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
    """Of the largest position error; of the largest angle where the position is within the tolerance."""

    def excess(self, tolerance: Tolerance) -> float:
        """The larger error in tolerances: more than 1 is a mismatch."""
        return max(self.position_max / tolerance.position, self.angle_max / tolerance.angle)


class Verifier:
    """Compares motions with one robot's forward kinematics. Keeps one model; one instance per thread."""

    def __init__(self, description: RobotDescription, skeleton: Skeleton) -> None:
        """Build the model."""
        self._forward = ForwardKinematics(description, skeleton.bodies)
        self._skeleton = skeleton
        self.is_floating = description.is_floating
        self._name = description.name

    def poses(self, joint_position: FloatArray, bodies: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
        """Positions (F, B, 3), m, and rotation matrices (F, B, 3, 3) of bodies in the base frame."""
        columns = [self._skeleton.bodies.index(name) for name in bodies]
        position, rotation = self._forward(joint_position)
        return position[:, columns], rotation[:, columns]

    def check(self, motion: NamedMotion, tolerance: Tolerance) -> tuple[BodyCheck, ...]:
        """Errors per body, in the motion's order; empty where the motion lacks joints or bodies to compare.

        Args:
            motion: with names.
            tolerance: decides which frame is the worst.

        Raises:
            InputError: if the world frame cannot be related to the robot's base.
        """
        if motion.joint_position is None or motion.body_position is None:
            return ()
        expected_position, expected_rotation = self.poses(motion.joint_position, motion.body_names)
        position = motion.body_position
        rotation = None if motion.body_quaternion is None else matrix(motion.body_quaternion)
        if motion.is_world:
            base_position, base_rotation = self._base(motion, expected_position, expected_rotation)
            position = np.einsum("tji,tbj->tbi", base_rotation, position - base_position[:, None])
            rotation = None if rotation is None else np.einsum("tji,tbjk->tbik", base_rotation, rotation)
        offset = position - expected_position
        distance = np.sqrt((offset * offset).sum(axis=-1))
        angle = np.zeros_like(distance) if rotation is None else rotation_angle(rotation, expected_rotation)
        return tuple(_summary(name, distance[:, i], angle[:, i], tolerance) for i, name in enumerate(motion.body_names))

    def _base(self, motion: NamedMotion, position: FloatArray, rotation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Position (F, 3) and rotation (F, 3, 3) of the base in the motion's world."""
        if motion.base_position is not None and motion.base_quaternion is not None:
            return motion.base_position, matrix(motion.base_quaternion)
        if self.is_floating:
            raise InputError(
                f"motion: holds no pose of '{self._skeleton.base}', the floating base of '{self._name}', so its bodies "
                "cannot be compared; it needs that body too"
            )
        if motion.body_position is None or motion.body_quaternion is None:
            raise InputError(
                f"motion: holds neither the pose of '{self._skeleton.base}' nor orientations, so its world frame "
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


@dataclass(frozen=True, slots=True)
class RateCheck:
    """What the joint velocities say about the frame rate."""

    fps: float
    """Frames per second for which the velocities fit the positions best."""
    correlation: float
    """Between velocities and differences of positions: 1 where they agree."""


_LEAST_SPEED = 0.02
"""rad/s, root mean square: below it a motion is too still to say anything."""


def check_rate(position: FloatArray, velocity: FloatArray, fps: float) -> RateCheck | None:
    """Compare joint velocities (F, n), rad/s, with the central differences of positions (F, n), rad.

    Returns:
        None for motions of less than five frames and for those that hardly move.
    """
    if len(position) < 5:
        return None
    step = 0.5 * (position[2:] - position[:-2])
    rate = velocity[1:-1]
    power, cross = float((step * step).sum()), float((step * rate).sum())
    if min(np.sqrt((rate * rate).mean()), np.sqrt((step * step).mean()) * fps) < _LEAST_SPEED:
        return None
    return RateCheck(cross / power, cross / np.sqrt(power * float((rate * rate).sum())))
