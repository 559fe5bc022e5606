"""Observation terms that compare the robot with a motion reference, or depend on an estimate of the base's motion."""

from __future__ import annotations

import numpy as np

from humanoid_sim.controllers.context import ObservationContext, Request, Source, nan_when_stale
from humanoid_sim.controllers.rotation import conjugate, matrix, multiply, rotate_inverse
from humanoid_sim.controllers.terms import Term
from humanoid_sim.mit import ANCHOR_POSE, BASE_LINEAR_VELOCITY, FloatArray

__all__ = ["anchor", "linear_velocity", "motion_command", "progress", "referenced"]


def _need_estimate(request: Request, extern: str) -> None:
    if extern not in request.extern:
        what = extern.replace("_", " ")
        raise request.missing(f"the robot's {what}: a simulation knows it, a robot needs an estimator for it")


def linear_velocity(request: Request) -> tuple[int, Source]:
    """The base's velocity, m/s."""
    _need_estimate(request, BASE_LINEAR_VELOCITY)
    if request.term.frame == "world":
        return 3, lambda context: nan_when_stale(context.state, BASE_LINEAR_VELOCITY)

    def in_body(context: ObservationContext) -> FloatArray:
        return rotate_inverse(context.state.imu_quaternion, nan_when_stale(context.state, BASE_LINEAR_VELOCITY))

    return 3, in_body


def anchor(request: Request) -> tuple[int, Source]:
    """Position or orientation of the reference's anchor body as seen from the robot's."""
    _need_estimate(request, ANCHOR_POSE)
    if "anchor_pos" not in request.reference.terms:
        raise request.missing("a motion with the poses of the anchor body")
    term = request.term
    return (3, _anchor_position(term)) if request.kind == "motion_anchor_pos" else (6, _anchor_orientation(term))


def _anchor_position(term: Term) -> Source:
    def source(context: ObservationContext) -> FloatArray:
        pose = nan_when_stale(context.state, ANCHOR_POSE)
        target, _ = context.reference.anchor(context.frame, context.alignment)
        offset = target - pose[..., :3]
        return offset if term.frame == "world" else rotate_inverse(pose[..., 3:], offset)

    return source


def _anchor_orientation(term: Term) -> Source:
    def source(context: ObservationContext) -> FloatArray:
        pose = nan_when_stale(context.state, ANCHOR_POSE)
        _, target = context.reference.anchor(context.frame, context.alignment)
        relative = multiply(conjugate(pose[..., 3:]), target)
        rotation = matrix(conjugate(relative) if term.inverse else relative)
        if term.layout == "two_rows":
            return rotation[..., :2, :].reshape(*rotation.shape[:-2], 6)
        columns = rotation[..., :, :2]
        if term.layout == "columns":
            columns = np.swapaxes(columns, -1, -2)
        return columns.reshape(*rotation.shape[:-2], 6)

    return source


def motion_command(request: Request) -> tuple[int, Source]:
    """The reference's joint positions and velocities."""
    if "reference_joint_pos" not in request.reference.terms:
        raise request.missing("a motion with joint positions and velocities")
    n = len(request.contract.joint_names)
    offset = request.contract.default_joint_pos if request.term.relative else np.zeros(n)

    def source(context: ObservationContext) -> FloatArray:
        position = context.reference.term("reference_joint_pos", context.frame) - offset
        velocity = context.reference.term("reference_joint_vel", context.frame)
        return np.concatenate([position, velocity], axis=-1)

    return 2 * n, source


def progress(request: Request) -> tuple[int, Source]:
    """Frame over last frame."""
    if not request.reference.terms:
        raise request.missing("a motion")
    return 1, lambda context: np.asarray(context.reference.progress(context.frame))[..., None]


def referenced(request: Request) -> tuple[int, Source]:
    """A table of the reference as it stands."""
    if request.kind not in request.reference.terms:
        raise request.missing("a piano motion" if request.kind.startswith("target_keys") else "a tracking motion")
    return request.reference.terms[request.kind].shape[1], lambda context: context.reference.term(
        request.kind, context.frame
    )
