"""The actuators, and the joint damping, that a robot's model itself has; simulations leave the actuators out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import RobotDescription

NO_RANGE = (-math.inf, math.inf)
_ON_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))


def own_joint_damping(model: mujoco.MjModel, description: RobotDescription) -> Mapping[str, float]:
    """Return damping in N·m·s/rad that a `bare_model` itself gives the joints, by name, where it gives any."""
    damping = {name: float(model.dof_damping[model.joint(name).dofadr[0]]) for name in description.joint_names}
    return {name: value for name, value in damping.items() if value}


@dataclass(frozen=True, slots=True)
class OwnActuator:
    """What the actuators of a model itself do to a joint, at the joint."""

    joint: str
    kind: Literal["servo", "motor", "other"]  # its control is a target of position or velocity, or a force
    stiffness: float  # N·m/rad, K_p; 0 for a motor
    damping: float  # N·m·s/rad, K_d; 0 for a motor
    force_range: tuple[float, float]  # N·m
    target_range: tuple[float, float]  # rad, to which a servo clips its target (`ctrlrange`, `inheritrange`)


def own_actuators(model: mujoco.MjModel) -> dict[str, OwnActuator]:
    """Return what the model's own actuators do to each joint that they drive, by the joint's name."""
    found: dict[str, OwnActuator] = {}
    for i in np.flatnonzero(np.isin(model.actuator_trntype, _ON_JOINT)).tolist():
        actuator = _own_actuator(model, i)
        other = found.get(actuator.joint)
        found[actuator.joint] = actuator if other is None else _together(other, actuator)
    return found


def _own_actuator(model: mujoco.MjModel, i: int) -> OwnActuator:
    joint, gear = model.joint(int(model.actuator_trnid[i, 0])).name, float(model.actuator_gear[i, 0])
    gain = float(model.actuator_gainprm[i, 0])
    rest, stiffness, damping = (0.0 - float(value) for value in model.actuator_biasprm[i, :3])
    force = _range(model.actuator_forcerange[i] * gear, bool(model.actuator_forcelimited[i]))
    control = np.array(_range(model.actuator_ctrlrange[i], bool(model.actuator_ctrllimited[i])))
    is_fixed = bool(model.actuator_gaintype[i] == mujoco.mjtGain.mjGAIN_FIXED)
    if is_fixed and model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_AFFINE:
        is_position = stiffness * gear != 0.0  # its target is where it has no force
        target = _range((gain * control - rest) / (stiffness * gear), True) if is_position else NO_RANGE
        return OwnActuator(joint, "servo", stiffness * gear**2, damping * gear**2, force, target)
    if is_fixed and model.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_NONE and not model.actuator_dyntype[i]:
        low, high = _range(control * gain * gear, True)
        return OwnActuator(joint, "motor", 0.0, 0.0, (max(force[0], low), min(force[1], high)), NO_RANGE)
    return OwnActuator(joint, "other", 0.0, 0.0, force, NO_RANGE)


def _range(values: FloatArray, is_limited: bool) -> tuple[float, float]:
    return (float(min(values)), float(max(values))) if is_limited else NO_RANGE


def _together(one: OwnActuator, other: OwnActuator) -> OwnActuator:
    return replace(
        one if one.stiffness >= other.stiffness else other,
        stiffness=one.stiffness + other.stiffness,
        damping=one.damping + other.damping,
        force_range=(one.force_range[0] + other.force_range[0], one.force_range[1] + other.force_range[1]),
    )
