"""Acceptance of a motion: it is this robot's, at this rate, in this order. If not, what would fit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from humanoid_sim.controllers.rotation import matrix
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.conventions import ANGLE_UNITS, LENGTH_UNITS, Conventions, in_si, interpret
from humanoid_sim.prepare.motion_fit import (
    BodyCheck,
    LimitExcess,
    Tolerance,
    check_bodies,
    implausible_height,
    is_upside_down,
    orders_within_limits,
    worst_excess,
)
from humanoid_sim.prepare.skeleton import Orders, Skeleton
from humanoid_sim.prepare.source_motion import SourceMotion, other_quaternion_order
from humanoid_sim.prepare.velocities import RateCheck, VelocityCheck, check_rate, check_velocities, refuse_velocities
from humanoid_sim.simulation.kinematics import InverseKinematics

FORWARD = "forward kinematics"
INVERSE = "inverse kinematics"
"""For motions without joint positions: is there a pose of the robot that puts the bodies where they are?"""

_MOST_POSES = 120
"""Frames for which joint positions are sought."""


@dataclass(frozen=True, slots=True)
class Findings:
    """Findings about a motion that may be written."""

    motion: SourceMotion
    method: str
    """Method by which joints and bodies were compared; empty if they could not be."""
    bodies: tuple[BodyCheck, ...]
    rate: RateCheck | None
    velocities: tuple[VelocityCheck, ...]
    """Checks of the joints that move; empty without velocities."""
    beyond_limits: LimitExcess | None
    notes: tuple[str, ...]


def accept(source: SourceMotion, conventions: Conventions, skeleton: Skeleton, tolerance: Tolerance) -> Findings:
    """Check a motion against the robot.

    Raises `InputError` naming the body, the joint or the rate that does not fit, and what would.
    """
    motion = interpret(source, conventions, skeleton)
    rate, velocities = _check_velocities(motion, skeleton)
    excess = None if motion.joint_position is None else worst_excess(motion.joint_position, skeleton.description)
    high, hint = ("", "") if conventions.is_length_given else implausible_height(motion, skeleton)
    notes: list[str] = []
    method, bodies = FORWARD, check_bodies(motion, skeleton, tolerance)
    if bodies:
        _refuse_mismatch(source, conventions, skeleton, tolerance, bodies)
    elif motion.joint_position is None:
        method, bodies = INVERSE, _check_bodies_alone(motion, skeleton, tolerance)
    else:
        method = ""
        if high:
            raise InputError(f"{source.source}: {high}{hint}; --length-unit m says that it is right")
        _check_joints_alone(source, conventions, skeleton, tolerance, excess)
        notes.append(
            "the source holds no body poses, so the order of its joints could not be verified, only that they stay "
            "within the robot's limits"
        )
    if high:
        notes.append(high)
    if excess is not None:
        notes.append(f"joint {excess.joint} {excess.words}")
    return Findings(motion, method, bodies, rate, velocities, excess, tuple(notes))


def _refuse_mismatch(
    source: SourceMotion,
    conventions: Conventions,
    skeleton: Skeleton,
    tolerance: Tolerance,
    bodies: tuple[BodyCheck, ...],
) -> None:
    worst = max(bodies, key=lambda check: check.excess(tolerance))
    if worst.excess(tolerance) <= 1.0:
        return
    off = sum(check.excess(tolerance) > 1.0 for check in bodies)
    hint = (
        what_would_fit(source, conventions, skeleton, tolerance)
        or "no other order of joints, bodies or quaternions that was tried fits: is this another robot's motion?"
    )
    raise InputError(
        f"{source.source}: body '{worst.name}' is up to {_far(worst)} from where the robot's forward kinematics puts "
        f"it (frame {worst.worst_frame}); {off} of {len(bodies)} bodies are off; tolerance {_shown(tolerance)}; {hint}"
    )


def _far(check: BodyCheck) -> str:
    return f"{100.0 * check.position_max:.1f} cm and {math.degrees(check.angle_max):.1f}°"


def _shown(tolerance: Tolerance) -> str:
    return f"{100.0 * tolerance.position:g} cm, {math.degrees(tolerance.angle):g}°"


def _check_velocities(motion: SourceMotion, skeleton: Skeleton) -> tuple[RateCheck | None, tuple[VelocityCheck, ...]]:
    if motion.joint_position is None or motion.joint_velocity is None:
        return None, ()
    rate = check_rate(motion.joint_position, motion.joint_velocity, motion.fps)
    checks = check_velocities(motion.joint_position, motion.joint_velocity, motion.fps, skeleton.joints)
    refuse_velocities(motion.source, motion.fps, rate, checks, len(skeleton.joints))
    return rate, checks


def _check_bodies_alone(motion: SourceMotion, skeleton: Skeleton, tolerance: Tolerance) -> tuple[BodyCheck, ...]:
    """Seek joint positions that reach the bodies, and see what is left."""
    if motion.frame == "world" or motion.body_position is None or motion.body_quaternion is None:
        raise InputError(
            f"{motion.source}: holds bodies and no joint positions, which can only be verified from positions and "
            "orientations in the robot's base frame"
        )
    step = max(1, math.ceil(motion.frame_count / _MOST_POSES))
    bodies = _reach(motion.select(np.arange(0, motion.frame_count, step)), skeleton, tolerance)
    worst = max(bodies, key=lambda check: check.excess(tolerance))
    if worst.excess(tolerance) > 1.0:
        raise InputError(
            f"{motion.source}: no pose of the robot that was found puts body '{worst.name}' nearer than {_far(worst)} "
            f"to where the motion has it (frame {step * worst.worst_frame}); tolerance {_shown(tolerance)}; it "
            "holds no joint positions to say more: are its bodies in the order of --body-order, its lengths in "
            "--length-unit, its orientations in rows, or do they need --conjugate?"
        )
    return tuple(replace(check, worst_frame=step * check.worst_frame) for check in bodies)


def _reach(motion: SourceMotion, skeleton: Skeleton, tolerance: Tolerance) -> tuple[BodyCheck, ...]:
    """Errors of the bodies at the poses of the robot that come nearest to a motion's."""
    assert motion.body_position is not None
    assert motion.body_quaternion is not None
    solver = InverseKinematics(skeleton.description, motion.body_names)
    joints = np.array(skeleton.description.initial_position)
    path: list[FloatArray] = []
    for place, turn in zip(motion.body_position, matrix(motion.body_quaternion), strict=True):
        joints = solver.solve(place, turn, joints, iterations=40 if path else 400)
        path.append(joints)
    return check_bodies(replace(motion, joint_position=np.stack(path), joint_velocity=None), skeleton, tolerance)


def _check_joints_alone(
    source: SourceMotion, conventions: Conventions, skeleton: Skeleton, tolerance: Tolerance, excess: LimitExcess | None
) -> None:
    """Limits, and which way is up."""
    if is_upside_down(replace(source, quaternion_order=conventions.quaternions)):
        raise InputError(
            f"{source.source}: with quaternions as {conventions.quaternions} the base is upside down most of the time; "
            f"it would be upright with --quaternions {other_quaternion_order(conventions.quaternions)}"
        )
    if excess is None or excess.excess <= tolerance.angle:
        return
    hint = _within_limits(source, conventions, skeleton, tolerance)
    raise InputError(f"{source.source}: joint '{excess.joint}' {excess.words} rad{hint}")


def _within_limits(source: SourceMotion, conventions: Conventions, skeleton: Skeleton, tolerance: Tolerance) -> str:
    """Return the order of joints, or the unit, in which joints stay within their limits; empty if there is none."""
    orders = {"": conventions.joint_names} | dict(skeleton.joint_orders)
    for unit in ANGLE_UNITS:
        columns = in_si(source, replace(conventions, angle_unit=unit)).joint_position
        assert columns is not None  # which is why they are beyond
        for order in orders_within_limits(columns, orders, skeleton.description, tolerance.angle):
            options = (("--joint-order", order), ("--angle-unit", unit if unit != conventions.angle_unit else ""))
            return "; it stays within all limits with " + " ".join(f"{o} {value}" for o, value in options if value)
    return ""


_FRAMES = 12
_MUCH = 0.1
"""Largest share of the error that remains of a motion that comes much nearer."""


def what_would_fit(source: SourceMotion, conventions: Conventions, skeleton: Skeleton, tolerance: Tolerance) -> str:
    """Return the options with which a motion that was read by these conventions would fit; empty if none tried does.

    Where none does, but one brings the bodies much nearer, it is that one, with what remains.
    """
    frames = np.linspace(0, source.frame_count - 1, min(_FRAMES, source.frame_count)).round()
    few = source.select(np.unique(frames.astype(np.intp)))
    present, best, best_words = np.inf, np.inf, ""
    for candidate, words in _named_orders(conventions, skeleton):
        try:
            checks = check_bodies(interpret(few, candidate, skeleton), skeleton, tolerance)
        except InputError:  # a body order without the base of a floating robot
            continue
        excess = max((check.excess(tolerance) for check in checks), default=np.inf)
        if not words:
            present = excess
        elif excess <= 1.0:
            return f"it would fit with {words}"
        elif excess < best:
            best, best_words = excess, words
    if best < _MUCH * present:
        return f"it would come {present / best:.0f} times nearer with {best_words}, but not within the tolerance"
    return ""


def _named_orders(conventions: Conventions, skeleton: Skeleton) -> Iterator[tuple[Conventions, str]]:
    """Orders that exporters use, the other order of quaternions, the inverse rotations, other units.

    None changed comes first, without words; then one change before two, two before three.
    """
    joints = {"": conventions.joint_names} | _others(skeleton.joint_orders, conventions.joint_names)
    bodies = {"": conventions.body_names} | _others(skeleton.body_orders, conventions.body_names)
    present = conventions.quaternions
    turns = {"": present, other_quaternion_order(present): other_quaternion_order(present)}
    conjugates = {"": conventions.conjugate} | ({} if conventions.conjugate else {" ": True})
    angles = {"": conventions.angle_unit} | {unit: unit for unit in ANGLE_UNITS if unit != conventions.angle_unit}
    lengths = {"": conventions.length_unit} | {unit: unit for unit in LENGTH_UNITS if unit != conventions.length_unit}
    changes = sorted(
        product(joints, bodies, turns, conjugates, angles, lengths), key=lambda change: len(change) - change.count("")
    )
    options = ("--joint-order", "--body-order", "--quaternions", "--conjugate", "--angle-unit", "--length-unit")
    for change in changes:
        joint, body, turn, conjugate, angle, length = change
        words = (f"{option} {value}".rstrip() for option, value in zip(options, change, strict=True) if value)
        candidate = replace(
            conventions,
            joint_names=joints[joint],
            body_names=bodies[body],
            quaternions=turns[turn],
            conjugate=conjugates[conjugate],
            angle_unit=angles[angle],
            length_unit=lengths[length],
        )
        yield candidate, " ".join(words)


def _others(orders: Orders, present: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """Known orders as long as the present one, and different from it and from each other."""
    found: dict[str, tuple[str, ...]] = {}
    for name, order in orders.items():
        if len(order) == len(present) and order != present and order not in found.values():
            found[name] = order
    return found
