"""Does a motion fit the robot: its bodies, and its joints' limits."""

from __future__ import annotations

import math

import numpy as np

from humanoid_sim.controllers.rotation import matrix, rotation_angle
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.convert import Skeleton
from humanoid_sim.prepare.sources import SourceMotion, derivative
from humanoid_sim.robots.guards import speed_limit
from humanoid_sim.simulation.kinematics import InverseKinematics

_DISTANCE, _ANGLE = 0.01, math.radians(2.0)  # m and rad, largest between a body and where kinematics puts it
_BEYOND = 0.035  # rad beyond a limit, by which motions that nothing else confirms may be off
_HIGHEST = 10.0  # m above the floor, of the base of any robot whose lengths are in m
_OFF_SPEED = 0.1  # share by which velocities may differ from the change of positions
_STILL = 1e-4  # (rad/s)², mean square below which joints do not move
_UPRIGHT = 0.5  # least mean of the vertical part of the base's own z axis
_MOST_POSES = 120  # frames for which joint positions are sought


def check(motion: SourceMotion, skeleton: Skeleton) -> list[str]:
    """Return what a user should know about a motion that fits; raises `InputError` for one that does not.

    Its joints are in the robot's order, its bodies in the base frame.
    """
    lines = [] if motion.joints is None else _check_joints(motion, motion.joints, skeleton)
    upright = 1.0 if motion.base is None else float(matrix(motion.base[:, 3:])[:, 2, 2].mean())
    if upright < _UPRIGHT:
        lines.append("note: its base lies most of the time, as if y were up, or --quaternions another")
    if motion.bodies is not None:
        return [_check_bodies(motion, motion.bodies, skeleton), *lines]
    if upright < 0.0:
        raise InputError(f"{motion.source}: its base is upside down most of the time; are --quaternions right?")
    if motion.base is not None and (height := np.abs(motion.base[:, 2]).max()) > _HIGHEST:
        raise InputError(f"{motion.source}: its base is up to {height:g} m high; are its lengths in m?")
    return [
        *lines,
        "note: without body poses nothing confirms the meaning of its columns but the joints' limits",
    ]


def _check_bodies(motion: SourceMotion, bodies: FloatArray, skeleton: Skeleton) -> str:
    """Compare the bodies with forward kinematics, or with the nearest pose where the motion has no joints."""
    names, joints, method, step = motion.body_names or (), motion.joints, "forward kinematics", 1
    if joints is None:
        step, method = math.ceil(len(bodies) / _MOST_POSES), "inverse kinematics"
        bodies = bodies[::step]
        solver = InverseKinematics(skeleton.description, names)
        start = np.array(skeleton.description.initial_position)
        joints = solver.solve_path(bodies[..., :3], matrix(bodies[..., 3:]), start)
    expected = skeleton.poses(joints, names)
    offset = bodies[..., :3] - expected[..., :3]
    distance = np.sqrt((offset * offset).sum(axis=-1))
    angle = rotation_angle(matrix(bodies[..., 3:]), matrix(expected[..., 3:]))
    excess = np.maximum(distance / _DISTANCE, angle / _ANGLE)
    i, body = np.unravel_index(int(excess.argmax()), excess.shape)
    error = f"{1000.0 * distance[i, body]:.1f} mm and {math.degrees(angle[i, body]):.1f}°"
    text = f"body '{names[body]}' is {error} from where {method} puts it in frame {step * i}"
    if excess[i, body] > 1.0:
        off = int((excess.max(axis=0) > 1.0).sum())
        right = "is it this robot's motion, and are --joint-order, --body-order, --quaternions and --degrees right?"
        raise InputError(f"{motion.source}: {text}; {off} of {len(names)} bodies are off; {right}")
    return f"{len(names)} bodies fit: at most, {text}"


def _check_joints(motion: SourceMotion, joints: FloatArray, skeleton: Skeleton) -> list[str]:
    lines, robot, names = [], skeleton.description, skeleton.joints
    beyond = np.maximum(robot.lower - joints, joints - robot.upper)
    frame, joint = np.unravel_index(int(beyond.argmax()), beyond.shape)
    if beyond[frame, joint] > 0.0:
        limits = f"{robot.lower[joint]:.3g} to {robot.upper[joint]:.3g}"
        text = f"joint '{names[joint]}' is at {joints[frame, joint]:.3f} rad in frame {frame}, beyond {limits}"
        if motion.bodies is None and beyond[frame, joint] > _BEYOND:
            raise InputError(f"{motion.source}: {text}; are --joint-order and --degrees right?")
        lines.append(f"note: {text}")
    speed = np.diff(joints, axis=0) / np.diff(motion.times)[:, None]
    for frame, joint in np.argwhere(np.abs(speed) > speed_limit(robot))[:1].tolist():
        pace = f"{speed[frame, joint]:.3g} rad/s after frame {frame}"
        lines.append(f"note: joint '{names[joint]}' moves at {pace}, faster than its guard allows")
    speed = derivative(joints, motion.times)
    squares = float((speed * speed).sum())
    if motion.joint_velocity is not None and squares > _STILL * speed.size:
        share = float((speed * motion.joint_velocity).sum()) / squares
        if abs(share - 1.0) > _OFF_SPEED:
            lines.append(f"note: its joint velocities are {share:.2f} times its positions' change; is its rate right?")
    return lines
