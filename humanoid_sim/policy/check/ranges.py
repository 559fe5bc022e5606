"""Whether the default pose and the positions that the action reaches lie within the robot's joint limits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.policy.check.finding import Finding
from humanoid_sim.robots.description import RobotDescription

__all__ = ["range_findings"]

_TOLERANCE = 1e-3
"""rad. Exporters round poses to three decimals."""
_STUCK = 0.02
"""rad. A joint that an action of one unit moves by less hardly moves."""


def range_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Poses and actions against limits, for joints that the robot has."""
    limits = {joint.name: (joint.lower, joint.upper) for joint in description.joints}
    for i, joint in enumerate(contract.joint_names):
        if joint in limits:
            yield from _pose(joint, "default_joint_pos", float(contract.default_joint_pos[i]), limits[joint])
            if joint not in contract.action_joint_names:
                yield from _pose(joint, "action_joint_names", 0.0, limits[joint], " where it is held")
    for i, joint in enumerate(contract.action_joint_names):
        if joint in limits:
            yield from _action(contract, i, joint, limits[joint])


def _pose(joint: str, field: str, value: float, limits: tuple[float, float], where: str = "") -> Iterator[Finding]:
    lower, upper = limits
    if lower - _TOLERANCE <= value <= upper + _TOLERANCE:
        return
    degrees = lower - _TOLERANCE <= np.deg2rad(value) <= upper + _TOLERANCE and abs(value) > np.pi
    hint = "; is it in degrees?" if degrees else ""
    limit = lower if value < lower else upper
    message = f"is {value:g} rad{where}, beyond the joint's range {lower:.4g} to {upper:.4g}{hint}"
    yield Finding("error", field, message, joint, value, limit)


def _action(contract: PolicyContract, i: int, joint: str, limits: tuple[float, float]) -> Iterator[Finding]:
    """What an action of one unit reaches: trained policies go further, but rarely by much."""
    assert contract.action_offset is not None  # filled in at construction
    scale, offset = abs(float(contract.action_scale[i])), float(contract.action_offset[i])
    default = float(contract.default_joint_pos[contract.joint_names.index(joint)])
    lower, upper = limits
    if abs(offset - default) > _TOLERANCE:
        yield from _pose(joint, "action_offset", offset, limits)
    if 0.0 < scale < _STUCK:
        message = f"is {scale:g} rad: an action of 1 hardly moves the joint"
        yield Finding("warning", "action_scale", message, joint, scale, _STUCK)
    if contract.position_clip is not None:
        low, high = (float(value) for value in contract.position_clip[i])
        if low < lower - _TOLERANCE or high > upper + _TOLERANCE:
            message = f"is {low:g} to {high:g} rad, wider than the joint's range {lower:.4g} to {upper:.4g}"
            yield Finding("warning", "position_clip", message, joint)
        return
    low, high = offset - scale, offset + scale
    if low < lower - _TOLERANCE or high > upper + _TOLERANCE:
        limit = lower if low < lower - _TOLERANCE else upper
        message = (
            f"is {scale:g} rad: actions of -1 to 1 ask for {low:.4g} to {high:.4g}, "
            f"beyond the joint's range {lower:.4g} to {upper:.4g}"
        )
        yield Finding("info", "action_scale", message, joint, scale, limit)
