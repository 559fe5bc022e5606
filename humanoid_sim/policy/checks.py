"""Checks of a contract: against a robot (joints, bodies, motors, limits, rate, estimates), and of its values alone.

Values that a contract may have more often are a slip: placeholders, swapped gains, rounded numbers.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.rl_policy import ticks_per_step
from humanoid_sim.errors import known_names
from humanoid_sim.mit import BASE, HEIGHT_SCAN, IMU, FloatArray
from humanoid_sim.names import near_miss
from humanoid_sim.policy.describe import field_lines
from humanoid_sim.policy.readers.partial import is_assumed, is_from_robot
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.motors import MOTORS, MotorModel
from humanoid_sim.robots.schema import MotorDescription

Severity = Literal["error", "warning", "info"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "info")
"""The worst first. An error keeps the policy from running as it was meant to; a warning is worth a look."""

_TOLERANCE = 1e-3
"""rad. Exporters round poses to three decimals."""
_STUCK = 0.02
"""rad. A joint that an action of one unit moves by less hardly moves."""
_LISTED = 3
"""Joints that a message names."""
_ALIKE = 0.85
"""Likeness of two names from which they are taken for one: a wrong pair would be worse than none."""
_COARSE = 0.02
"""Relative error at which the rounding of a gain by the motor's format is worth a word."""

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


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a check found."""

    severity: Severity
    field: str
    """Field of the contract, or `model`, `golden vectors`, `robot`."""
    message: str
    """Text with what was found, and what was expected."""
    joint: str = ""
    value: float | None = None
    limit: float | None = None
    is_decisive: bool = False
    """Shown before the others of its severity."""

    def __str__(self) -> str:
        return f"{self.field}{f' of {self.joint}' if self.joint else ''}: {self.message}"


def sorted_findings(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return the worst first, of a severity what is decisive, otherwise in the order in which they were found."""
    return tuple(sorted(findings, key=lambda finding: (SEVERITIES.index(finding.severity), not finding.is_decisive)))


def joint_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Joints that only the policy or only the robot has."""
    robot, policy = description.joint_names, contract.joint_names
    surplus = [name for name in robot if name not in policy]
    for name in policy:
        if name not in robot:
            meant = near_miss(name, surplus, _ALIKE)
            hint = f", which has '{meant}': rename it in x.contract.yaml" if meant else ""
            yield Finding("error", "joint_names", f"is not a joint of '{description.name}'{hint}", joint=name)
    meant_ones = {near_miss(name, surplus, _ALIKE) for name in policy if name not in robot}
    for name in surplus:
        if name not in meant_ones:
            message = f"'{description.name}' has it, the policy does not; its joints have to be the robot's"
            yield Finding("error", "joint_names", message, joint=name)


def model_damping_findings(contract: PolicyContract, own: Mapping[str, float]) -> Iterator[Finding]:
    """Joints that the robot's model damps as well, beside the contract's K_d.

    Args:
        own: N·m·s/rad by joint, as `humanoid_sim.robots.mjcf.own_joint_damping` gives it.
    """
    pairs: dict[tuple[float, float], list[str]] = {}
    for name, damping in zip(contract.joint_names, contract.joint_damping.tolist(), strict=True):
        if name in own:
            pairs.setdefault((damping, own[name]), []).append(name)
    if not pairs:
        return
    listed = "; ".join(f"{kd:g} + {model:g} for {', '.join(names)}" for (kd, model), names in pairs.items())
    decision = contract.model_joint_damping
    field, what = "model_joint_damping", f"the contract's K_d + the model's own damping, N·m·s/rad: {listed}"
    if decision == "drop":
        yield Finding("info", field, f"drop: simulations leave out the second number of {what}")
    elif decision == "keep":
        yield Finding("info", field, f"keep: both act: {what}")
    else:
        doubled = any(kd > 0.0 for kd, _ in pairs)
        message = f"nobody decides, so both act: {what}; `{field}: keep` or `drop` in x.contract.yaml decides"
        yield Finding("warning" if doubled else "info", field, message)


def effort_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Joints whose torque nothing limits, and those whose robot is weaker than the policy was trained with.

    Args:
        description: of the robot, as it is by itself.
    """
    own = {joint.name: joint.effort_limit for joint in description.joints}
    limits = np.full(len(contract.joint_names), np.inf) if contract.effort_limit is None else contract.effort_limit
    trained = dict(zip(contract.joint_names, limits.tolist(), strict=True))
    free = [name for name in contract.joint_names if np.isinf(own.get(name, 0.0)) and np.isinf(trained[name])]
    if free:
        more = ", …" if len(free) > _LISTED else ""
        message = (
            f"{len(free)} of {len(own)} joints have no torque limit, neither in the contract nor in "
            f"'{description.name}' ({', '.join(free[:_LISTED])}{more}): the simulation will apply any torque, a real "
            "motor will not. Give effort_limit in x.contract.yaml (docs/contract.md, Limits)"
        )
        yield Finding("warning", "effort_limit", message)
    for name, limit in trained.items():
        if own.get(name, np.inf) < limit < np.inf:
            message = f"is {limit:g} N·m, but '{description.name}' allows {own[name]:g}, which stays"
            yield Finding("warning", "effort_limit", message, name, limit, own[name])


def naming_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Joints that only their places tell: the wiring would be put on any robot with as many joints."""
    source = contract.provenance.get("joint_names", "")
    if is_from_robot(source):
        message = (
            f"are those of '{description.name}' ({source}): nothing in the checkpoint names its joints, so any robot "
            "with as many would be taken; joint_names in x.contract.yaml, or a stamp, names them"
        )
        yield Finding("warning", "joint_names", message)


def body_findings(contract: PolicyContract, bodies: Sequence[str], robot: str) -> Iterator[Finding]:
    """Bodies of the motion that the robot's model lacks."""
    named = [("body_names", name) for name in contract.body_names]
    if contract.anchor_body:
        named.append(("anchor_body", contract.anchor_body))
    for field, name in named:
        if name not in bodies:
            meant = near_miss(name, bodies, _ALIKE)
            hint = f", which has '{meant}'" if meant else f"; it has: {', '.join(bodies)}"
            yield Finding("error", field, f"'{name}' is not a body of '{robot}'{hint}")
    if contract.anchor_body and contract.body_names and contract.anchor_body not in contract.body_names:
        message = f"'{contract.anchor_body}' is not among body_names: {', '.join(contract.body_names)}"
        yield Finding("warning", "anchor_body", f"{message}; a motion of those bodies does not tell where it is")


def point_findings(
    contract: PolicyContract, sites: Sequence[str], bodies: Sequence[str], robot: str
) -> Iterator[Finding]:
    """Find points whose velocity is observed, or around which the ground is scanned, that the robot's model lacks."""
    for term in contract.terms:
        kind = contract.kind(term)
        is_scan = kind.reads == HEIGHT_SCAN and term.width is None
        known, what = ([*sites, *bodies], "a site or body") if is_scan else (sites, "a site")
        if (is_scan or "at" in kind.conventions) and term.at not in (BASE, IMU, *known):
            meant = near_miss(term.at, known, _ALIKE)
            hint = f"which has '{meant}'" if meant else f"which has: {', '.join(known) or 'none'}"
            message = f"at is '{term.at}', neither base nor imu nor {what} of '{robot}', {hint}"
            yield Finding("error", f"observation term {term.name}", message)


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
    """Yield what an action of one unit reaches: trained policies go further, but rarely by much."""
    assert contract.action_offset is not None  # filled in at construction
    scale, offset = abs(float(contract.action_scale[i])), float(contract.action_offset[i])
    default = float(contract.default_joint_pos[contract.joint_names.index(joint)])
    lower, upper = limits
    if abs(offset - default) > _TOLERANCE:
        yield from _pose(joint, "action_offset", offset, limits)
    if 0.0 < scale < _STUCK:
        message = f"is {scale:g} rad: an action of 1 hardly moves the joint"
        yield Finding("warning", "action_scale", message, joint, scale, _STUCK)
    if isinstance(contract.position_clip, str):  # the joint's own range
        return
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


def motor_findings(contract: PolicyContract, description: RobotDescription, *, hardware: bool) -> Iterator[Finding]:
    """Gains beyond what the robot's motors can encode, joint by joint."""
    motors = {joint.name: joint.motor for joint in description.joints if joint.motor is not None}
    if not motors:
        message = f"'{description.name}' has no motors in its description"
        yield Finding("error" if hardware else "info", "robot", f"{message}: gains were not compared with their limits")
        return
    for i, joint in enumerate(contract.joint_names):
        motor = motors.get(joint)
        if motor is None:
            if hardware and joint in description.joint_names:
                yield Finding("error", "robot", "has no motor in the robot's description", joint=joint)
            continue
        limits = MOTORS.get(motor.model)
        if limits is None:
            message = known_names("motor model", motor.model, MOTORS)
            yield Finding("warning", "robot", message, joint=joint)
            continue
        yield from _joint_findings(joint, contract, i, motor, limits)


def _joint_findings(
    joint: str, contract: PolicyContract, i: int, motor: MotorDescription, limits: MotorModel
) -> Iterator[Finding]:
    for field, value, limit, step in (
        ("joint_stiffness", float(contract.joint_stiffness[i]), limits.stiffness, limits.stiffness_step),
        ("joint_damping", float(contract.joint_damping[i]), limits.damping, limits.damping_step),
    ):
        if value > limit:
            message = f"is {value:g}, but motor {motor.model} encodes at most {limit:g}"
            yield Finding("error", field, message, joint, value, limit)
        elif 0.0 < value < step / _COARSE:
            message = f"is {value:g}, which motor {motor.model} encodes in steps of {step:.2g}"
            yield Finding("warning", field, message, joint, value, step)


def estimate_findings(contract: PolicyContract, *, hardware: bool) -> Iterator[Finding]:
    """Terms that need an estimator on a robot: an error on hardware, which has none."""
    for term in contract.terms:
        what = contract.kind(term).estimate
        if not what:
            continue
        message = f"needs {what}, which a simulation knows and a robot has to estimate"
        if hardware:
            yield Finding("error", f"observation term {term.name}", f"{message}; there is no estimator")
        else:
            yield Finding("info", f"observation term {term.name}", message)


def live_findings(contract: PolicyContract) -> Iterator[Finding]:
    """Live inputs that have to come from somewhere: declared ones, and on a robot a height scan."""
    for term in contract.terms:
        if term.width is None and contract.kind(term).reads == HEIGHT_SCAN:
            scan = term.height_scan
            message = f"a simulation scans {scan.count} points; on a robot a program sends them, or it does not start"
            yield Finding("info", f"observation term {term.name}", message)
        if term.width is not None:
            topic = term.topic or contract.kind(term).topic
            message = f"is a live input of width {term.width}: programs send it by {topic}, or `live` feeds it"
            yield Finding("info", f"observation term {term.name}", f"{message}; doctor and regress cannot")


def rate_finding(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Yield whether the policy's period is a whole number of the real robot's control periods."""
    frequency = description.hardware.control_frequency
    if not ticks_per_step(contract.policy_dt, 1.0 / frequency)[1]:
        message = f"is {contract.policy_dt:g} s, no multiple of the robot's control period, {1.0 / frequency:g} s"
        yield Finding("warning", "policy_dt", f"{message}: it has to run at another rate", value=contract.policy_dt)


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
    yield from _action_scale(contract)
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


def _action_scale(contract: PolicyContract) -> Iterator[Finding]:
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
