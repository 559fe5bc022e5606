"""Acceptance of a motion: it is this robot's, at this rate, in this order."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from humanoid_sim.controllers.rotation import matrix
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.prepare.conventions import Conventions, interpret
from humanoid_sim.prepare.motion_fit import (
    BodyCheck,
    LimitExcess,
    Tolerance,
    check_bodies,
    is_upside_down,
    refuse_velocities,
    worst_excess,
)
from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.prepare.source_motion import SourceMotion, other_quaternion_order
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
    beyond_limits: LimitExcess | None
    notes: tuple[str, ...]


def accept(source: SourceMotion, conventions: Conventions, skeleton: Skeleton, tolerance: Tolerance) -> Findings:
    """Check a motion against the robot.

    Raises `InputError` naming the body, the joint or the rate that does not fit.
    """
    motion = interpret(source, conventions, skeleton)
    refuse_velocities(motion)
    excess = None if motion.joint_position is None else worst_excess(motion.joint_position, skeleton.description)
    notes: list[str] = []
    method, bodies = FORWARD, check_bodies(motion, skeleton, tolerance)
    if bodies:
        _refuse_mismatch(source, tolerance, bodies)
    elif motion.joint_position is None:
        method, bodies = INVERSE, _check_bodies_alone(motion, skeleton, tolerance)
    else:
        method = ""
        _check_joints_alone(source, conventions, tolerance, excess)
        notes.append(
            "the source holds no body poses, so the order of its joints could not be verified, only that they stay "
            "within the robot's limits"
        )
    if excess is not None:
        notes.append(f"joint {excess.joint} {excess.words}")
    return Findings(motion, method, bodies, excess, tuple(notes))


def _refuse_mismatch(source: SourceMotion, tolerance: Tolerance, bodies: tuple[BodyCheck, ...]) -> None:
    worst = max(bodies, key=lambda check: check.excess(tolerance))
    if worst.excess(tolerance) <= 1.0:
        return
    off = sum(check.excess(tolerance) > 1.0 for check in bodies)
    raise InputError(
        f"{source.source}: body '{worst.name}' is up to {_far(worst)} from where the robot's forward kinematics puts "
        f"it (frame {worst.worst_frame}); {off} of {len(bodies)} bodies are off; tolerance {_shown(tolerance)}; "
        "expected this robot's motion, as --joint-order, --body-order, --quaternions and --angle-unit say"
    )


def _far(check: BodyCheck) -> str:
    return f"{100.0 * check.position_max:.1f} cm and {math.degrees(check.angle_max):.1f}°"


def _shown(tolerance: Tolerance) -> str:
    return f"{100.0 * tolerance.position:g} cm, {math.degrees(tolerance.angle):g}°"


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
            "holds no joint positions to say more: are its bodies in the order of --body-order, in m, and its "
            "orientations in rows?"
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
    source: SourceMotion, conventions: Conventions, tolerance: Tolerance, excess: LimitExcess | None
) -> None:
    """Check limits, and which way is up."""
    if is_upside_down(replace(source, quaternion_order=conventions.quaternions)):
        raise InputError(
            f"{source.source}: with quaternions as {conventions.quaternions} the base is upside down most of the time; "
            f"it would be upright with --quaternions {other_quaternion_order(conventions.quaternions)}"
        )
    if excess is not None and excess.excess > tolerance.angle:
        raise InputError(
            f"{source.source}: joint '{excess.joint}' {excess.words} rad, with joints and unit as --joint-order and "
            "--angle-unit say"
        )
