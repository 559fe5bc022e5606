"""From a motion as the robot has it to a motion file: at the policy's rate, in its layout."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.rotation import continuous, matrix, multiply, rotate, slerp
from humanoid_sim.errors import InputError
from humanoid_sim.policy.motion import Motion, body_frames
from humanoid_sim.prepare.conventions import Skeleton
from humanoid_sim.prepare.sources import SourceMotion, derivative

_OFF_RATE = 0.1  # share of a policy step by which a frame's time may be off


def at_rate(motion: SourceMotion, policy_dt: float, *, resample: bool) -> SourceMotion:
    """Return the motion with a frame every `policy_dt` s, from its first frame to at most its last.

    Positions are interpolated linearly, orientations along the shortest arc. Raises `InputError` if the frames do not
    come at this rate, and `resample` is False.
    """
    times = motion.times - motion.times[0]
    steps = policy_dt * np.arange(len(times))
    if np.abs(times - steps).max() <= _OFF_RATE * policy_dt:
        return motion
    if not resample:
        raise InputError(
            f"{motion.source}: has {motion.rate:.4g} frames per second, the policy takes {1.0 / policy_dt:g} evenly "
            "spaced steps; add --resample to interpolate"
        )
    count = int(times[-1] / policy_dt + 1e-6) + 1  # the last frame stays where only rounding is in the way
    place = np.minimum(policy_dt * np.arange(count), times[-1])
    upper = np.clip(np.searchsorted(times, place, side="right"), 1, len(times) - 1)
    lower = upper - 1
    weight = (place - times[lower]) / (times[upper] - times[lower])
    mixed: dict[str, Any] = {}
    for name, array in motion.arrays().items():
        w = weight.reshape(-1, *[1] * (array.ndim - 1))
        mixed[name] = (1.0 - w) * array[lower] + w * array[upper]
        if name in ("base", "bodies"):
            mixed[name][..., 3:] = slerp(array[lower][..., 3:], array[upper][..., 3:], w)
    return replace(motion, times=place, **mixed)


def convert(motion: SourceMotion, contract: PolicyContract, skeleton: Skeleton) -> Motion:
    """Return the content of a motion file: `bodies_b` for policies that observe bodies in the base frame.

    Else `joints_bodies_w`, for those with anchor terms. Raises `InputError` if the motion lacks what the layout needs.
    """
    names = contract.body_names or ((contract.anchor_body,) if contract.anchor_body else ())
    own, bodies, joints = motion.body_names or (), motion.bodies, motion.joints
    in_base_frame = contract.requires("body_names")
    if joints is None and not (in_base_frame and set(names) <= set(own)):
        raise InputError(f"{motion.source}: lacks joint positions, or bodies of {', '.join(names)}, which are needed")
    if bodies is not None and set(names) <= set(own):
        bodies = bodies[:, [own.index(name) for name in names]]
    elif joints is not None:
        bodies = skeleton.poses(joints, names)
    assert bodies is not None
    if in_base_frame:
        frames = body_frames(bodies[..., :3], matrix(bodies[..., 3:]))
    else:
        assert joints is not None
        if motion.base is None:
            raise InputError(f"{motion.source}: has no pose of the floating base '{skeleton.base}', which is needed")
        turn = np.broadcast_to(motion.base[:, None, 3:], bodies[..., 3:].shape)
        position = rotate(turn, bodies[..., :3]) + motion.base[:, None, :3]
        quaternion = continuous(multiply(turn, bodies[..., 3:]))
        velocity = derivative(joints, motion.times) if motion.joint_velocity is None else motion.joint_velocity
        order = [skeleton.joints.index(joint) for joint in contract.joint_names]
        parts = (joints[:, order], velocity[:, order], position, quaternion)
        frames = np.concatenate([part.reshape(len(joints), -1) for part in parts], axis=1)
    return Motion(
        frames=frames.astype(np.float32),
        body_names=names,
        policy_dt=contract.policy_dt,
        task_type=contract.task_type,
        robot=skeleton.description.name,
        layout="bodies_b" if in_base_frame else "joints_bodies_w",
        joint_names=() if in_base_frame else contract.joint_names,
    )
