"""The parameters of a robot's guards: its description's, else what follows from its limits and motors."""

from __future__ import annotations

import numpy as np

from humanoid_sim.controllers.guards import Guards
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.robots.schema import RobotDescription

_FOLLOWING_TIME = {"fixed": 0.15, "floating": 0.3}  # s; six pushed walkers that stayed up held no joint off so long
_CROSSING_TIME = {"fixed": 0.1, "floating": 0.05}  # s in which no joint crosses its range, but of walkers that fell
_SLOWEST_LIMIT = {"fixed": 5.0, "floating": 15.0}  # rad/s: a joint with a small range may still be this fast
_OF_SCALE = 0.99  # share of the largest speed that a motor can report: a Sito's is 3.14 rad/s, whatever its speed


def guards_of(robot: RobotDescription) -> Guards | None:
    """Return the guards of a robot, infinite for joints without limits; None if its description turns all off."""
    given, off = robot.guards, np.full(robot.joint_count, np.inf)
    if given.following is None and given.limit is None and given.speed is None:
        return None
    effort = off
    if given.following is not None and given.following_effort:
        effort = np.array([np.inf if bound is None else bound for bound in given.following_effort])
    elif given.following is not None:
        effort = given.following * robot.effort_limit
    return Guards(
        joints=robot.joint_names,
        lower=robot.lower,
        upper=robot.upper,
        following_effort=effort,
        following_time=given.following_time or _FOLLOWING_TIME[robot.base.type],
        following_progress=given.following_progress,
        following_within=robot.is_floating,
        limit_margin=off if given.limit is None else np.full(robot.joint_count, given.limit),
        limit_time=given.limit_time,
        speed_limit=off if given.speed is None else speed_limit(robot),
        speed_time=given.speed_time,
    )


def describe_unwatched(robot: RobotDescription) -> str:
    """Return in one line which guards watch fewer joints than there are; '' if each watches all."""
    guards, n = guards_of(robot), robot.joint_count
    if guards is None:
        return "guards: all are off in the robot's description"
    has_limits = np.isfinite(robot.lower) | np.isfinite(robot.upper)
    watched = {
        "following": np.isfinite(guards.following_effort).sum(),
        "limit": (np.isfinite(guards.limit_margin) & has_limits).sum(),
        "speed": np.isfinite(guards.speed_limit).sum(),
    }
    texts = [f"{name} is off for {n - count} of {n} joints" for name, count in watched.items() if count < n]
    return f"guards: {', '.join(texts)}" if texts else ""


def speed_limit(robot: RobotDescription) -> FloatArray:
    """Return rad/s, (n,): the description's, else the whole range in the crossing time, within the motor's speeds."""
    reported, unloaded = _motor_speeds(robot)
    kind = robot.base.type
    crossing = np.maximum((robot.upper - robot.lower) / _CROSSING_TIME[kind], _SLOWEST_LIMIT[kind])
    limit: FloatArray = np.minimum(robot.guards.speed or np.minimum(crossing, unloaded), _OF_SCALE * reported)
    return limit


def rated_speed(robot: RobotDescription) -> FloatArray:
    """Return rad/s, shape (n,): the motor's without load, as far as it can report it; inf without a motor."""
    return np.minimum(*_motor_speeds(robot))


def _motor_speeds(robot: RobotDescription) -> tuple[FloatArray, FloatArray]:
    models = [MOTORS.get(joint.motor.model) if joint.motor else None for joint in robot.joints]
    reported = np.array([model.velocity if model else np.inf for model in models])
    return reported, np.array([model.no_load_velocity if model else np.inf for model in models])
