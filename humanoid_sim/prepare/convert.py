"""From a motion whose columns have names to the frames of a motion file: in the policy's layout, at its rate."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.rotation import continuous, matrix, multiply, quaternion_from_matrix, rotate, slerp
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.motion import Motion, MotionLayout, body_frames
from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.prepare.source_motion import SourceMotion

FROM_SOURCE = "the source"
FROM_KINEMATICS = "forward kinematics"

_EQUAL = 1e-4
"""Relative difference of rates that writing them as decimals explains: half a frame in a hundred seconds at 50 Hz."""


def has_rate(fps: float, policy_dt: float) -> bool:
    """Return whether frames come once per policy step."""
    return abs(fps * policy_dt - 1.0) <= _EQUAL


def resample(motion: SourceMotion, policy_dt: float) -> SourceMotion:
    """Return the motion with a frame every `policy_dt` s, from its first frame to at most its last.

    Positions are interpolated linearly, orientations along the shortest arc, joint velocities as they are: rates per
    second.
    """
    count = motion.frame_count
    # The margin keeps the last frame where both rates fall together but for rounding.
    frames = int(np.floor((count - 1) / motion.fps / policy_dt + 1e-6)) + 1
    place = np.minimum(np.arange(frames) * policy_dt * motion.fps, count - 1)
    lower = np.minimum(place.astype(np.intp), max(count - 2, 0))
    weight = place - lower
    upper = np.minimum(lower + 1, count - 1)
    mixed: dict[str, Any] = {}
    for name, array in motion.arrays().items():
        w = weight.reshape(-1, *[1] * (array.ndim - 1))
        if name.endswith("quaternion"):
            mixed[name] = slerp(array[lower], array[upper], w)
        else:
            mixed[name] = (1.0 - w) * array[lower] + w * array[upper]
    return replace(motion, fps=1.0 / policy_dt, **mixed)


def layout_of(contract: PolicyContract) -> MotionLayout:
    """`bodies_b` for policies that see bodies in the base frame, `joints_bodies_w` for those with anchor terms."""
    return "bodies_b" if contract.requires("body_names") else "joints_bodies_w"


def convert(motion: SourceMotion, contract: PolicyContract, skeleton: Skeleton) -> tuple[Motion, str]:
    """Return the content of a file for a motion at the policy's rate, and whose its body poses are.

    Raises `InputError` if the motion does not hold what the layout needs.
    """
    layout = layout_of(contract)
    bodies = contract.body_names or ((contract.anchor_body,) if contract.anchor_body else ())
    if layout == "bodies_b":
        position, rotation, origin = _base_frame(motion, bodies, skeleton)
        frames = body_frames(position, rotation)
        joints: tuple[str, ...] = ()
    else:
        if motion.joint_position is None:
            raise InputError(f"{motion.source}: holds no joint positions, which the policy's reference needs")
        position, quaternion, origin = _world_frame(motion, bodies, skeleton)
        order = [skeleton.joints.index(joint) for joint in contract.joint_names]
        count = len(position)
        parts = (
            motion.joint_position[:, order],
            _velocity(motion)[:, order],
            position.reshape(count, -1),
            continuous(quaternion).reshape(count, -1),
        )
        frames, joints = np.concatenate(parts, axis=1), contract.joint_names
    return (
        Motion(
            frames=frames.astype(np.float32),
            body_names=bodies,
            policy_dt=contract.policy_dt,
            task_type=contract.task_type,
            robot=skeleton.description.name,
            layout=layout,
            joint_names=joints,
        ),
        origin,
    )


def _velocity(motion: SourceMotion) -> FloatArray:
    """Shape (F, n), rad/s: the source's, else central differences, one-sided at the ends."""
    if motion.joint_velocity is not None:
        return motion.joint_velocity
    assert motion.joint_position is not None
    if len(motion.joint_position) < 2:
        return np.zeros_like(motion.joint_position)
    rate: FloatArray = np.gradient(motion.joint_position, 1.0 / motion.fps, axis=0)
    return rate


def _own_poses(motion: SourceMotion, bodies: tuple[str, ...]) -> tuple[FloatArray, FloatArray] | None:
    """Positions (F, B, 3), m, and quaternions (F, B, 4) of bodies, in the motion's frame; None if it lacks some."""
    if motion.body_position is None or motion.body_quaternion is None or not set(bodies) <= set(motion.body_names):
        return None
    columns = [motion.body_names.index(name) for name in bodies]
    return motion.body_position[:, columns], motion.body_quaternion[:, columns]


def _base_frame(
    motion: SourceMotion, bodies: tuple[str, ...], skeleton: Skeleton
) -> tuple[FloatArray, FloatArray, str]:
    """Positions (F, B, 3), m, and rotation matrices (F, B, 3, 3) in the base frame."""
    poses = _own_poses(motion, bodies)
    if poses is not None and (motion.frame == "base" or motion.base_quaternion is not None):
        position, rotation = poses[0], matrix(poses[1])
        if motion.base_position is not None and motion.base_quaternion is not None and motion.frame == "world":
            base = matrix(motion.base_quaternion)
            position = np.einsum("tji,tbj->tbi", base, position - motion.base_position[:, None])
            rotation = np.einsum("tji,tbjk->tbik", base, rotation)
        return position, rotation, FROM_SOURCE
    if motion.joint_position is None:
        missing = [name for name in bodies if name not in motion.body_names]
        raise InputError(
            f"{motion.source}: holds no joint positions, and its bodies lack {', '.join(missing) or 'orientations'}, "
            "which the policy follows"
        )
    return *skeleton.poses(motion.joint_position, bodies), FROM_KINEMATICS


def _world_frame(
    motion: SourceMotion, bodies: tuple[str, ...], skeleton: Skeleton
) -> tuple[FloatArray, FloatArray, str]:
    """Positions (F, B, 3), m, and quaternions (F, B, 4), w x y z, in the world frame."""
    poses = _own_poses(motion, bodies)
    if motion.frame == "world" and poses is not None:
        return *poses, FROM_SOURCE
    position, rotation, origin = _base_frame(motion, bodies, skeleton)
    base_position, base_quaternion = motion.base_position, motion.base_quaternion
    if base_position is None or base_quaternion is None:
        if skeleton.description.is_floating:
            raise InputError(f"{motion.source}: holds no pose of the floating base '{skeleton.base}', which is needed")
        # A fixed base stands where the robot's model has it.
        base_position, base_quaternion = (
            np.repeat(value[None], len(position), axis=0)
            for value in (skeleton.base_position, skeleton.base_quaternion)
        )
    turn = np.broadcast_to(base_quaternion[:, None], (*position.shape[:2], 4))
    return (rotate(turn, position) + base_position[:, None], multiply(turn, quaternion_from_matrix(rotation)), origin)
