"""Values that a contract may have, but that more often are a slip: placeholders, swapped gains, rounded numbers."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from types import MappingProxyType

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.describe import field_lines
from humanoid_sim.policy.readers.partial import is_assumed
from humanoid_sim.policy.robot_check import Finding
from humanoid_sim.robots.description import RobotDescription

_FEW = 4
"""Joints below which equal gains say nothing."""
_RATIO = (0.005, 0.5)
"""s, K_d / K_p of position-controlled legs and arms; beyond, one of the two is usually wrong."""
_OUTLIER = 10.0
"""Factor between a joint's K_d / K_p and the median of all."""
_RATES = (20.0, 200.0)
"""Hz, of policies that run on robots."""
_DECIMALS = 3
"""As mjlab's exporter rounds."""
_ROUNDING = 0.005
"""Relative error of a rounded value from which on it is a warning."""
_FACTORS = (1e-3, 1e3)
"""Beyond these a factor of an observation term is not a change of units."""


def suspicious_findings(
    contract: PolicyContract,
    description: RobotDescription | None = None,
    own_damping: Mapping[str, float] = MappingProxyType({}),
) -> Iterator[Finding]:
    """Look at the contract alone.

    Args:
        description: of the robot, whose own gains excuse the same ones in the contract.
        own_damping: N·m·s/rad by joint, of the robot's model: where it is kept, it brakes a joint without K_d.
    """
    kept = () if contract.model_joint_damping == "drop" else tuple(own_damping)
    yield from _gains(contract, description, kept)
    yield from _ratios(contract)
    yield from _rounding(contract)
    yield from _action(contract)
    yield from _observation(contract)
    rate = 1.0 / contract.policy_dt
    if not _RATES[0] <= rate <= _RATES[1]:
        message = (
            f"is {contract.policy_dt:g} s ({rate:g} Hz), unusual: policies run at {_RATES[0]:g} to {_RATES[1]:g} Hz"
        )
        yield Finding("warning", "policy_dt", message, value=contract.policy_dt)
    elif abs(rate - round(rate)) > 1e-3 * rate:
        message = f"is {contract.policy_dt:g} s, that is {rate:.4g} Hz, no whole number: rounded by an exporter?"
        yield Finding("warning", "policy_dt", message, value=contract.policy_dt)
    for line in field_lines(contract):
        if is_assumed(line.source):
            yield Finding(
                "warning", line.name, f"{line.value}: {line.source}, no source states it; x.contract.yaml can"
            )


def _gains(
    contract: PolicyContract, description: RobotDescription | None, braked: Collection[str]
) -> Iterator[Finding]:
    known = {} if description is None else {joint.name: joint for joint in description.joints}
    for field, unit, robots in (("joint_stiffness", "N·m/rad", "stiffness"), ("joint_damping", "N·m·s/rad", "damping")):
        values: FloatArray = getattr(contract, field)
        for joint, value in zip(contract.joint_names, values, strict=True):
            if value == 0.0 and joint in contract.action_joint_names and field == "joint_stiffness":
                yield Finding("error", field, "is 0: the action cannot move the joint", joint, 0.0)
            elif value == 0.0 and field == "joint_damping" and joint not in braked:
                yield Finding("warning", field, "is 0: nothing brakes the joint", joint, 0.0)
        if len(values) < _FEW or not (values == values[0]).all() or values[0] == 0.0:
            continue
        own = [getattr(known[name], robots) for name in contract.joint_names if name in known]
        if len(own) == len(values) and (np.array(own) == values).all():
            continue  # the robot's description says the same
        message = f"is {values[0]:g} {unit} for all {len(values)} joints"
        if values[0] == 1.0:
            yield Finding("warning", field, f"{message}: it looks like a placeholder", value=1.0)
        else:
            yield Finding("info", field, f"{message}; most trainers give each motor its own", value=float(values[0]))


def _ratios(contract: PolicyContract) -> Iterator[Finding]:
    stiffness, damping = contract.joint_stiffness, contract.joint_damping
    both = (stiffness > 0.0) & (damping > 0.0)
    if not both.any():
        return
    if (damping[both] > stiffness[both]).all():
        message = "is larger than joint_stiffness for every joint: are the two swapped?"
        yield Finding("error", "joint_damping", message)
        return
    ratio = np.where(both, damping / np.where(both, stiffness, 1.0), np.nan)
    median = float(np.nanmedian(ratio))
    for joint, value, kp, kd in zip(contract.joint_names, ratio, stiffness, damping, strict=True):
        if np.isnan(value):
            continue
        what = f"is {kd:g} at a stiffness of {kp:g}, a ratio of {value:.3g} s"
        if not _RATIO[0] <= value <= _RATIO[1]:
            yield Finding("warning", "joint_damping", f"{what}; usual are {_RATIO[0]:g} to {_RATIO[1]:g} s", joint, kd)
        elif not 1.0 / _OUTLIER < value / median < _OUTLIER:
            yield Finding("warning", "joint_damping", f"{what}; the other joints' is about {median:.3g} s", joint, kd)


def _rounding(contract: PolicyContract) -> Iterator[Finding]:
    for field in ("joint_stiffness", "joint_damping", "default_joint_pos", "action_scale"):
        values: FloatArray = np.abs(getattr(contract, field))
        fine = np.round(values, _DECIMALS) != np.round(values, _DECIMALS - 1)
        # Values that end early by themselves (0.25, 50) do not show that anything was cut off.
        cut = fine.any() and (np.round(values, _DECIMALS) == values).all()
        if len(values) < _FEW or not cut or "metadata" not in contract.provenance.get(field, ""):
            continue
        message = f"has {_DECIMALS} decimals, as exporters round: off by up to 0.0005"
        smallest = float(values[fine].min())
        relative = 0.5 * 10.0**-_DECIMALS / smallest
        if field == "default_joint_pos":
            yield Finding("info", field, f"{message} rad")
            continue
        joints = contract.action_joint_names if field == "action_scale" else contract.joint_names
        joint = joints[int(np.argmin(np.where(fine, values, np.inf)))]
        message += f", {100.0 * relative:.2g} % for {joint}; x.contract.yaml can hold the trainer's own"
        yield Finding("warning" if relative > _ROUNDING else "info", field, message, value=smallest)


def _action(contract: PolicyContract) -> Iterator[Finding]:
    scale = contract.action_scale
    for joint, value in zip(contract.action_joint_names, scale, strict=True):
        if value == 0.0:
            yield Finding("error", "action_scale", "is 0: the action cannot move the joint", joint, 0.0)
        elif value < 0.0:
            message = f"is {value:g}: negative scales are unusual; is the joint's direction reversed?"
            yield Finding("warning", "action_scale", message, joint, float(value))
    if (scale == 1.0).all():
        message = "is 1 rad for every joint: usual are 0.25 or less than 0.6, and 1 where it was forgotten"
        yield Finding("warning", "action_scale", message, value=1.0)
    if len(contract.default_joint_pos) >= _FEW and not contract.default_joint_pos.any():
        message = "is 0 for every joint: is it the pose that the policy was trained around?"
        yield Finding("warning", "default_joint_pos", message, value=0.0)


def _observation(contract: PolicyContract) -> Iterator[Finding]:
    for term in contract.terms:
        scale = np.abs(np.atleast_1d(term.scale))
        field = f"observation term {term.name}"
        if not scale.any():
            yield Finding("warning", field, "has scale 0: the policy sees zeros there", value=0.0)
        elif ((scale > 0.0) & ((scale < _FACTORS[0]) | (scale > _FACTORS[1]))).any():
            message = f"has the scale {float(scale.max()):g}, expected {_FACTORS[0]:g} to {_FACTORS[1]:g}"
            yield Finding("warning", field, message, value=float(scale.max()))
        if term.name == "projected_gravity" and np.ndim(term.scale) == 0 and float(term.scale) < 0.0:
            factor = float(term.scale)
            message = (
                f"scale is {factor:g}: gravity would be fed as (0, 0, {-factor:g}) when upright; almost always wrong"
            )
            yield Finding("warning", field, message, value=factor, is_decisive=True)
        elif (np.atleast_1d(term.scale) < 0.0).any():
            yield Finding("warning", field, "has a negative scale", value=float(np.min(term.scale)))
        if term.clip is not None and (term.clip[0] == term.clip[1] or term.clip[0] > 0.0 or term.clip[1] < 0.0):
            message = f"is clipped to {term.clip[0]:g} to {term.clip[1]:g}, which does not hold 0"
            yield Finding("warning", field, message)
