"""Checks of a contract's values: slips that exporters and people make, and evidence at hand that says otherwise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import mujoco
import numpy as np

from humanoid_sim.controllers.contract import JOINT_LIMITS, PolicyContract
from humanoid_sim.mit import BoolArray, FloatArray
from humanoid_sim.names import mirrored_pairs
from humanoid_sim.policy.describe import field_lines
from humanoid_sim.policy.findings import Finding, Severity, on_joints
from humanoid_sim.robots.actuators import NO_RANGE, OwnActuator
from humanoid_sim.robots.description import RobotDescription

_FEW = 4  # joints below which values that are alike say nothing
_POSE = 0.01  # rad by which the two sides of a pose may differ
_CLOSE = 0.02  # relative, within which two gains are the same
_RATIO = (0.005, 0.5)  # s, K_d / K_p of position-controlled legs and arms
_PLACEHOLDER = 1.0  # N·m/rad; K_p is hardly as low at every joint
_RATES = (20.0, 200.0)  # Hz, of policies that run on robots
_DECIMALS = 3  # as mjlab's exporter rounds
_LOST = (0.005, 0.1)  # relative error by rounding, from which it is a warning, and an error
_FACTORS = (1e-3, 1e3)  # beyond these a factor of an observation term is not a change of units
_RULED = 0.7  # share of the joints from which on a formula is taken for the exporter's


def suspicious_findings(
    contract: PolicyContract, own_damping: Mapping[str, float] = MappingProxyType({}), own_stiffness: float = 0.0
) -> Iterator[Finding]:
    """Look at the contract's values alone.

    Args:
        own_damping: N·m·s/rad by joint, of the robot's model: where it is kept, it brakes a joint without K_d.
        own_stiffness: N·m/rad, the robot's largest; a low one excuses low ones in the contract.
    """
    joints, driven = contract.joint_names, contract.action_joint_names
    stiffness, damping, scale = contract.joint_stiffness, contract.joint_damping, contract.action_scale
    limp = [name for name in _where(joints, stiffness == 0.0) if name in driven]
    yield from on_joints("error", "joint_stiffness", "is 0: the action cannot move", limp, count=len(joints))
    is_weak = 0.0 < own_stiffness <= _PLACEHOLDER
    if len(joints) >= _FEW and 0.0 < stiffness.max() <= _PLACEHOLDER and not is_weak:
        message = f"is {stiffness.max():g} or less for every joint: a placeholder?"
        yield Finding("error", "joint_stiffness", message, joints)
    kept = {} if contract.model_joint_damping == "drop" else own_damping
    free = [name for name in _where(joints, damping == 0.0) if name not in kept]
    severity: Severity = "error" if len(free) == len(joints) else "warning"
    yield from on_joints(severity, "joint_damping", "is 0: nothing brakes", free, count=len(joints))
    pairs = zip(joints, damping.tolist(), stiffness.tolist(), strict=True)
    ratios = {name: kd / kp for name, kd, kp in pairs if kd > 0.0 and kp > 0.0}
    if ratios and min(ratios.values()) > 1.0:
        message = "is larger than joint_stiffness for every joint: swapped?"
        yield Finding("error", "joint_damping", message, tuple(ratios))
    else:
        unusual = {name: f"{ratio:.2g}" for name, ratio in ratios.items() if not _RATIO[0] <= ratio <= _RATIO[1]}
        remark = f"; {_RATIO[0]:g} to {_RATIO[1]:g} are usual"
        yield from on_joints("warning", "joint_damping", "over joint_stiffness, in s, is unusual for", unusual, remark)
    still, turned = _where(driven, scale == 0.0), _where(driven, scale < 0.0)
    yield from on_joints("error", "action_scale", "is 0: the action cannot move", still, count=len(driven))
    yield from on_joints("warning", "action_scale", "is negative, direction reversed? for", turned)
    if (scale == 1.0).all():
        message = "is 1 rad for every joint: usual are 0.25 or less than 0.6, and 1 where it was forgotten"
        yield Finding("warning", "action_scale", message)
    if len(joints) >= _FEW and not contract.default_joint_pos.any():
        message = "is 0 for every joint: is it the pose that the policy was trained around?"
        yield Finding("warning", "default_joint_pos", message)
    rate, period = 1.0 / contract.policy_dt, f"is {contract.policy_dt:g} s"
    if not _RATES[0] <= rate <= _RATES[1]:
        usual = f"policies run at {_RATES[0]:g} to {_RATES[1]:g} Hz"
        yield Finding("warning", "policy_dt", f"{period} ({rate:g} Hz); {usual}")
    elif abs(rate - round(rate)) > 1e-3 * rate:
        yield Finding("warning", "policy_dt", f"{period}, {rate:.4g} Hz: rounded by an exporter?")


def term_findings(contract: PolicyContract) -> Iterator[Finding]:
    """Scales and clips of observation terms that hardly anybody trains with."""
    for term in contract.terms:
        field, scale = f"observation term {term.name}", np.atleast_1d(term.scale)
        size = np.abs(scale[scale != 0.0])
        if (scale < 0.0).any():
            up = ": when upright, gravity points up; almost always wrong" if term.name == "projected_gravity" else ""
            yield Finding("warning", field, f"has the negative scale {scale.min():g}{up}")
        if not len(size):
            yield Finding("warning", field, "has scale 0: the policy sees zeros there")
        elif size.min() < _FACTORS[0] or size.max() > _FACTORS[1]:
            message = f"has the scale {size.max():g}, expected {_FACTORS[0]:g} to {_FACTORS[1]:g}"
            yield Finding("warning", field, message)
        if term.clip is not None and (term.clip[0] == term.clip[1] or not term.clip[0] <= 0.0 <= term.clip[1]):
            message = f"is clipped to {term.clip[0]:g} to {term.clip[1]:g}, which does not hold 0"
            yield Finding("warning", field, message)


def rounding_findings(contract: PolicyContract) -> Iterator[Finding]:
    """Gains and scales that an exporter rounded to three decimals: one line."""
    worst, lost = 0.0, []
    for field in ("action_scale", "joint_stiffness", "joint_damping"):
        values: FloatArray = np.abs(getattr(contract, field))
        fine = np.round(values, _DECIMALS) != np.round(values, _DECIMALS - 1)
        # Values that end early by themselves (0.25, 50) do not show that anything was cut off.
        is_cut = fine.any() and (np.round(values, _DECIMALS) == values).all()
        if is_cut and len(values) >= _FEW and "metadata" in contract.source.get(field, ""):
            smallest = int(np.argmin(np.where(fine, values, np.inf)))
            share = 0.5 * 10.0**-_DECIMALS / float(values[smallest])
            lost.append(f"{field} {100.0 * share:.2g} % ({_names_of(contract, field)[smallest]})")
            worst = max(worst, share)
    if lost:
        severity: Severity = "error" if worst > _LOST[1] else "warning" if worst > _LOST[0] else "info"
        message = f"cut at {_DECIMALS} decimals: off by up to {', '.join(lost)}; x.contract.yaml can hold all"
        yield Finding(severity, "rounding", message)


def symmetry_findings(contract: PolicyContract) -> Iterator[Finding]:
    """Gains, limits, scales and poses that differ between left and right; a pose may be mirrored by its sign."""
    for field in ("joint_stiffness", "joint_damping", "effort_limit", "default_joint_pos", "action_scale"):
        values, names = getattr(contract, field), _names_of(contract, field)
        if values is None:
            continue
        size = dict(zip(names, np.abs(values).tolist(), strict=True))
        far, relative = (_POSE, 0.0) if field == "default_joint_pos" else (0.0, _CLOSE)
        found = {
            left: f"{size[left]:g}, {right} {size[right]:g}"
            for left, right in mirrored_pairs(names)
            if not np.isclose(size[left], size[right], rtol=relative, atol=far)
        }
        yield from on_joints("warning", field, "differs between left and right:", found)


def actuator_findings(
    contract: PolicyContract, actuators: Mapping[str, OwnActuator], own_damping: Mapping[str, float]
) -> Iterator[Finding]:
    """Gains and targets that differ from those of the model's own actuators, which simulations leave out.

    Args:
        actuators: by joint, in the model's order.
        own_damping: N·m·s/rad by joint, of the model, which a contract may hold in its K_d.
    """
    servos = {name: own for name, own in actuators.items() if own.stiffness > 0.0 and name in contract.joint_names}
    places = [contract.joint_names.index(name) for name in servos]
    passive = np.array([own_damping.get(name, 0.0) for name in servos])
    for gain, extra in (("stiffness", 0.0), ("damping", passive)):
        field, gains = f"joint_{gain}", np.array([getattr(own, gain) for own in servos.values()])
        values = getattr(contract, field)
        ours = values[places] + 0.0  # no -0
        is_same = _is_rounded(ours, gains) | _is_rounded(ours, gains + extra) | (gains == 0.0)
        found = {name: f"{ours[i]:g}, actuator {gains[i]:g}" for i, name in enumerate(servos) if not is_same[i]}
        remark = ""
        if len(servos) == len(values) and np.allclose(np.sort(values), np.sort(gains), rtol=_CLOSE):
            in_order = np.allclose(values, gains, rtol=_CLOSE)
            remark = ": they stand in the order of its actuators" if in_order else ": the same ones in another order"
        # One gain for all is a placeholder in the model.
        severity: Severity = "warning" if len(set(gains.tolist())) > 1 else "info"
        message = f"is not that of the model's own actuators for {len(found)} joints:"
        yield from on_joints(severity, field, message, found, remark)
    if contract.position_clip is None:
        clipped = [name for name, own in servos.items() if own.target_range != NO_RANGE]
        message, remark = "none, but the model's own actuators clip the targets of", "is what training saw"
        yield from on_joints("warning", "position_clip", message, clipped, f": `{JOINT_LIMITS}` {remark}", len(servos))


def formula_findings(
    contract: PolicyContract, description: RobotDescription, model: mujoco.MjModel
) -> Iterator[Finding]:
    """Joints that leave a formula of exporters which holds for most: mjlab derives gains and scale from the motors.

    K_p = armature · ω², K_d = 2 · ζ · armature · ω, scale = 0.25 · effort limit / K_p, with one ω and ζ.
    """
    joints, own = contract.joint_names, {joint.name: joint.effort_limit for joint in description.joints}
    armature = np.array([model.dof_armature[model.joint(name).dofadr[0]] if name in own else 0.0 for name in joints])
    effort = np.array([own.get(name, np.inf) for name in joints])
    if contract.effort_limit is not None:
        effort = np.minimum(effort, contract.effort_limit)
    reach = np.where(np.isfinite(effort), effort, 0.0) / np.maximum(contract.joint_stiffness, 1e-9)
    driven = [joints.index(name) for name in contract.action_joint_names]
    for field, unit, what in (
        ("joint_stiffness", armature, "armature"),
        ("joint_damping", armature, "armature"),
        ("action_scale", reach[driven], "effort limit / K_p"),
    ):
        values = getattr(contract, field)
        is_known = (unit > 0.0) & (values > 0.0)
        if is_known.sum() < _FEW:
            continue
        factors = (values[is_known] / unit[is_known]).tolist()
        factor = max(factors, key=lambda factor: int(_is_rounded(values, factor * unit).sum()))
        holds = is_known & _is_rounded(values, factor * unit)
        kinds = len({f"{value:.2g}" for value in unit[holds].tolist()})
        if kinds < 3 or holds.sum() < _RULED * is_known.sum():  # no formula, or nothing shows that it is one
            continue
        found = {
            name: f"{values[i]:g}, expected {factor * unit[i]:.3g}"
            for i, name in enumerate(_names_of(contract, field))
            if is_known[i] and not holds[i]
        }
        yield from on_joints("warning", field, f"is {factor:.3g} · {what} for {holds.sum()} joints, but not for", found)


def assumption_findings(contract: PolicyContract) -> Iterator[Finding]:
    """Values that no source states: one line for each dialect that implies them."""
    found: dict[str, list[str]] = {}
    for line in field_lines(contract):
        if line.is_assumed:
            found.setdefault(line.source, []).append(f"{line.name} {line.value}")
    for source, lines in found.items():
        yield Finding("warning", source, f"{'; '.join(lines)}: no source states it; x.contract.yaml can")


def _is_rounded(values: FloatArray, expected: FloatArray) -> BoolArray:
    """Return where values are the expected ones, as far as the decimals with which they are written go."""
    decimals = np.array([len(f"{value:.6g}".partition(".")[2]) for value in values.tolist()])
    return np.abs(values - expected) <= np.maximum(_CLOSE * expected, 0.51 * 10.0**-decimals)


def _names_of(contract: PolicyContract, field: str) -> tuple[str, ...]:
    return contract.action_joint_names if field == "action_scale" else contract.joint_names


def _where(names: Sequence[str], mask: BoolArray) -> tuple[str, ...]:
    return tuple(name for name, hit in zip(names, mask, strict=True) if hit)
