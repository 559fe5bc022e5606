"""The parameters of a robot's guards: its description's, and where that gives none, what follows from its limits."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from humanoid_sim.controllers.guards import Guards
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.motors import MOTORS
from humanoid_sim.robots.schema import FollowingGuard, LimitGuard, RobotDescription, SpeedGuard

Bounds = tuple[float | None, ...]
"""One bound per joint; None: the joint is not watched."""


class _Following(msgspec.Struct, frozen=True):
    effort: Bounds
    time: float
    progress: float
    within: bool


class _Limit(msgspec.Struct, frozen=True):
    margin: Bounds
    time: float


class _Speed(msgspec.Struct, frozen=True):
    limit: Bounds
    time: float
    assumed: tuple[str, ...]


class GuardRecord(msgspec.Struct, frozen=True):
    """Guards that ran, and their parameters, as in a recording's header."""

    following: _Following
    """N·m, s, rad."""
    limit: _Limit
    """rad, s."""
    speed: _Speed
    """rad/s, s."""

    @classmethod
    def of(cls, guards: Guards) -> GuardRecord:
        """Return what is written down of some guards."""

        def part(name: str, kind: type[msgspec.Struct]) -> Any:
            values = {field: getattr(guards, f"{name}_{field}") for field in kind.__struct_fields__}
            return kind(**{key: _bounds(v) if isinstance(v, np.ndarray) else v for key, v in values.items()})

        return cls(part("following", _Following), part("limit", _Limit), part("speed", _Speed))

    def on(self, robot: RobotDescription) -> Guards:
        """Return the same guards again, on the robot of the recording. Raises `FieldError` if they do not fit."""
        values: dict[str, Any] = {
            f"{name}_{field}": value
            for name in self.__struct_fields__
            for field, value in msgspec.structs.asdict(getattr(self, name)).items()
        }
        values |= {name: _numbers(values[name]) for name in ("following_effort", "limit_margin", "speed_limit")}
        return Guards(robot.joint_names, robot.lower, robot.upper, robot.effort_limit, **values)


def _bounds(values: FloatArray) -> Bounds:
    return tuple(float(value) if np.isfinite(value) else None for value in values)


def _numbers(bounds: Bounds) -> FloatArray:
    return np.array([np.inf if bound is None else bound for bound in bounds])


_FOLLOWING_TIME = {"fixed": 0.15, "floating": 0.3}
"""s. Legs that carry a robot are pressed and pushed back by its weight: of six policies that walked, on rough ground
too, and were pushed, none that stayed up kept a joint from coming nearer for so long. Arms on a fixed base: 0.02 s."""
_CROSSING_TIME = {"fixed": 0.1, "floating": 0.05}
"""s in which no joint crosses its whole range. Of walking robots that were pushed until they fell the fastest took
0.05 s in a simulation whose motors have no speed limit; the sample motions on arms take 0.7 s at least."""
_SLOWEST_LIMIT = {"fixed": 5.0, "floating": 15.0}
"""rad/s: a joint with a small range may still be this fast."""
_OF_SCALE = 0.99
"""Share of the largest speed that a motor can report. A Sito reports at most 3.14 rad/s, however fast it really is."""


def guards_of(robot: RobotDescription) -> Guards | None:
    """Return the guards of a robot; None if its description turns all of them off.

    A following guard needs an effort limit, a limit guard limits, a speed guard limits or a known motor: joints without
    are not watched by it.
    """
    settings, kind = robot.guards, robot.base.type
    following, limit, speed = settings.following, settings.limit, settings.speed
    if following is None and limit is None and speed is None:
        return None
    off = np.full(robot.joint_count, np.inf)
    chosen = following or FollowingGuard()
    margin, fast = limit or LimitGuard(), speed or SpeedGuard()
    pulled_hard = _numbers(chosen.effort) if chosen.effort else chosen.effort_share * robot.effort_limit
    return Guards(
        joints=robot.joint_names,
        lower=robot.lower,
        upper=robot.upper,
        effort_limit=robot.effort_limit,
        following_effort=off if following is None else pulled_hard,
        following_time=_FOLLOWING_TIME[kind] if chosen.time is None else chosen.time,
        following_progress=chosen.progress,
        following_within=robot.is_floating,
        limit_margin=off if limit is None else np.full(robot.joint_count, margin.margin),
        limit_time=margin.time,
        speed_limit=off if speed is None else speed_limit(robot),
        speed_time=fast.time,
        speed_assumed=() if speed is None else _assumed_speed(robot),
    )


def describe_unwatched(robot: RobotDescription) -> str:
    """Say in one line which guards watch fewer joints than there are, and why; '' if each watches all."""
    guards, settings, n = guards_of(robot), robot.guards, robot.joint_count
    if guards is None:
        return "guards: all are off, as the robot's description says"
    bounded = np.isfinite(robot.lower) | np.isfinite(robot.upper)
    watched = {
        "following": (settings.following, np.isfinite(guards.following_effort), "an effort limit of the robot's own"),
        "limit": (settings.limit, bounded & np.isfinite(guards.limit_margin), "position limits"),
        "speed": (settings.speed, np.isfinite(guards.speed_limit), "position limits or a known motor"),
    }
    texts = []
    for name, (chosen, seen, needed) in watched.items():
        if chosen is None:
            texts.append(f"{name} is off, as the robot's description says")
        elif not seen.all():
            texts.append(f"{name} is off for {n - int(seen.sum())} of {n} joints, which lack {needed}")
    return f"guards: {'; '.join(texts)}" if texts else ""


def speed_limit(robot: RobotDescription) -> FloatArray:
    """Shape (n,), rad/s: the description's, or what follows from range and motor; never more than can be read.

    What follows is the whole range in the crossing time, but no more than the motor turns without load. What a motor
    can report has an end of its scale, where nobody knows how fast it is.
    """
    told, fastest = _motor_speeds(robot)
    limit: FloatArray = np.minimum(_given_speed(robot) or np.minimum(_crossing_speed(robot), fastest), _OF_SCALE * told)
    return limit


def rated_speed(robot: RobotDescription) -> FloatArray:
    """Shape (n,), rad/s: as fast as the motor turns without load and can be told; without one the guard's, or inf."""
    known = np.minimum(*_motor_speeds(robot))
    return np.where(np.isfinite(known), known, _given_speed(robot) or np.inf)


def _given_speed(robot: RobotDescription) -> tuple[float, ...]:
    return () if robot.guards.speed is None else robot.guards.speed.limit


def _motor_speeds(robot: RobotDescription) -> tuple[FloatArray, FloatArray]:
    """Shape (n,) each, rad/s: the largest speed that a motor can report, and that without load; inf for no motor."""
    motors = [None if joint.motor is None else MOTORS.get(joint.motor.model) for joint in robot.joints]
    told = [np.inf if motor is None else motor.velocity for motor in motors]
    return np.array(told), np.array([np.inf if motor is None else motor.no_load_velocity for motor in motors])


def _crossing_speed(robot: RobotDescription) -> FloatArray:
    """Shape (n,), rad/s, with which a joint crosses its whole range in the crossing time."""
    kind = robot.base.type
    return np.maximum((robot.upper - robot.lower) / _CROSSING_TIME[kind], _SLOWEST_LIMIT[kind])


def _assumed_speed(robot: RobotDescription) -> tuple[str, ...]:
    """Return the joints whose speed limit is neither the description's nor their motor's."""
    if _given_speed(robot):
        return ()
    crossing = _crossing_speed(robot)
    chosen = speed_limit(robot) >= crossing
    return tuple(name for name, is_assumed in zip(robot.joint_names, chosen, strict=True) if is_assumed)
