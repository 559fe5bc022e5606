"""Checks of a contract against a robot, without running it: names, ranges, gains, torques, and evidence at hand.

Each yields findings, one for all the joints that it concerns; `contract_findings` runs all.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np

from humanoid_sim.controllers.contract import JOINT_LIMITS, PolicyContract
from humanoid_sim.mit import BASE, IMU, BoolArray, FloatArray
from humanoid_sim.names import mirrored_pairs, near_miss
from humanoid_sim.policy.describe import assumptions
from humanoid_sim.policy.findings import Finding, Severity, list_joints
from humanoid_sim.policy.layers import ROBOTS_ORDER
from humanoid_sim.robots.actuators import NO_RANGE, own_actuators, own_joint_damping
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.motors import MOTORS

_ALIKE = 0.85  # likeness of two names, 0 to 1, from which one is probably a slip of the other
_FEW = 4  # joints below which values that are alike show nothing
_ANGLE = 1e-3  # rad; exporters round poses to three decimals
_POSE = 0.01  # rad by which the two sides of a pose may differ
_CLOSE = 0.02  # relative, within which two gains are the same
_PLACEHOLDER = 1.0  # N·m/rad; K_p is hardly as low at every joint
_DECIMALS = 3  # as mjlab's exporter rounds
_LOST = (0.005, 0.1)  # relative error by rounding, from which it is a warning, and an error
_UNSTATED = ": no source states it; x.contract.yaml can"
_RULED = 0.7  # share of the joints from which on a formula is probably the exporter's


def contract_findings(
    contract: PolicyContract, description: RobotDescription, model: mujoco.MjModel, *, hardware: bool
) -> list[Finding]:
    """Run every check of a contract, in the order in which a person would.

    `model` is the robot's, as `bare_model` gives it; `hardware`: the real robot, which has no estimator, and needs
    motors.
    """
    damping = own_joint_damping(model, description)
    own = [joint.stiffness for joint in description.joints]
    own += [servo.stiffness for servo in own_actuators(model).values()]
    return [
        *_joint_findings(contract, description),
        *_frame_findings(contract, description.name, model),
        *(motor_findings(contract, description) if hardware else ()),
        *_range_findings(contract, description),
        *effort_findings(contract, description),
        *suspicious_findings(contract, damping, max(own)),
        *_term_findings(contract, hardware=hardware),
        *_symmetry_findings(contract),
        *_actuator_findings(contract, model, damping),
        *_scale_findings(contract, description),
        *model_damping_findings(contract, damping),
        *_rounding_findings(contract),
        *(Finding("warning", source, f"{values}{_UNSTATED}") for source, values in assumptions(contract).items()),
    ]


def _on(
    severity: Severity, field: str, message: str, names: Sequence[str], hits: Any, text: str = "", *columns: FloatArray
) -> Iterator[Finding]:
    """Yield one finding for all joints that a mask hits, in the place of `{}`, with values as `text`."""
    joints = [name for name, hit in zip(names, hits, strict=True) if hit]
    if joints:
        rows = [text.format(*(column[i] for column in columns)) for i in np.flatnonzero(hits)]
        listed = list_joints(dict(zip(joints, rows, strict=True))) if text else list_joints(joints, len(names))
        yield Finding(severity, field, message.replace("{}", listed))


def _of_robot(description: RobotDescription, names: Sequence[str], attribute: str) -> FloatArray:
    """Return a value of each joint's description, in the order of `names`; NaN for joints that the robot lacks."""
    own = {joint.name: getattr(joint, attribute) for joint in description.joints}
    return np.array([own.get(name, np.nan) for name in names])


# --- names ---


def _joint_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Joints that only the policy or only the robot has, and names that only the robot gives."""
    field, robot = "joint_names", f"'{description.name}'"
    surplus = [name for name in description.joint_names if name not in contract.joint_names]
    foreign = [name for name in contract.joint_names if name not in description.joint_names]
    meant = {name: near_miss(name, surplus, _ALIKE) for name in foreign}
    slips = {name: f"robot has {other}" for name, other in meant.items() if other}
    others = [name for name in foreign if name not in slips]
    lacking = [name for name in surplus if name not in meant.values()]
    for joints, what in (
        (slips, f"not of {robot}, rename in x.contract.yaml:"),
        (others, f"not of {robot}:"),
        (lacking, f"have to be the robot's, the policy lacks {robot}'s"),
    ):
        if joints:
            yield Finding("error", field, f"{what} {list_joints(joints)}")
    source = contract.source.get(field, "")
    if source == ROBOTS_ORDER or source.endswith("and the robot"):
        message = f"are those of {robot} ({source}): any robot with as many would do; x.contract.yaml can name them"
        yield Finding("warning", field, message)


def _frame_findings(contract: PolicyContract, robot: str, model: mujoco.MjModel) -> Iterator[Finding]:
    """Bodies of the motion, and points whose velocity or ground is observed, that the robot's model lacks."""
    bodies = [model.body(i).name for i in range(1, model.nbody)]
    sites = [BASE, IMU, *(model.site(i).name for i in range(model.nsite) if model.site(i).name)]
    needed = [("body_names", name, "body", bodies) for name in contract.body_names]
    if contract.anchor_body:
        needed.append(("anchor_body", contract.anchor_body, "body", bodies))
    for term in contract.terms:
        if term.scan is not None:
            needed.append((f"observation term {term.name}", term.scan.at, "site or body", [*sites, *bodies]))
        elif "at" in contract.kind(term).conventions:
            needed.append((f"observation term {term.name}", term.at, "site", sites))
    for field, name, kind, known in needed:
        if name not in known:
            listed = near_miss(name, known, _ALIKE) or ", ".join(known)
            yield Finding("error", field, f"'{name}' is no {kind} of '{robot}', which has {listed}")


# --- what the robot can do ---


def motor_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Joints without a motor, and gains beyond what CAN motors can encode."""
    models = {joint.name: joint.motor.model for joint in description.joints if joint.motor is not None}
    joints = contract.joint_names
    if not models:
        message = f"the description of '{description.name}' names no CAN motors, so that gains were not compared"
        yield Finding("error", "robot", f"{message} with what they encode")
    else:
        without = [name in description.joint_names and name not in models for name in joints]
        yield from _on("error", "robot", "the description names no motor of {}", joints, without)
    motors = [MOTORS.get(models.get(name, "")) for name in joints]
    for gain in ("stiffness", "damping"):
        most = np.array([np.inf if motor is None else getattr(motor, gain) for motor in motors])
        gains, message = getattr(contract, f"joint_{gain}"), "is more than the motor can encode for {}"
        yield from _on("error", f"joint_{gain}", message, joints, gains > most, "{:g}, at most {:g}", gains, most)


def _range_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Poses and targets beyond the joints' ranges."""
    joints, driven, pose = contract.joint_names, contract.action_joint_names, contract.default_joint_pos
    offset: Any = contract.action_offset
    held = np.where(np.isin(joints, driven), np.nan, 0.0)
    moved = np.where(np.abs(offset - pose[[joints.index(name) for name in driven]]) > _ANGLE, offset, np.nan)
    for field, names, values, what in (
        ("default_joint_pos", joints, pose, ""),
        ("action_offset", driven, moved, ""),
        ("action_joint_names", joints, held, "at 0, where it is held, "),
    ):
        lower, upper = (_of_robot(description, names, end) for end in ("lower", "upper"))
        far = (values < lower - _ANGLE) | (values > upper + _ANGLE)
        turned = np.deg2rad(values)
        in_degrees = (np.abs(values) > np.pi) & (turned >= lower) & (turned <= upper)
        message = f"is {what}beyond the range, rad, of {{}}{'; is it in degrees?' if in_degrees[far].all() else ''}"
        yield from _on("error", field, message, names, far, "{:g}, range {:.4g} to {:.4g}", values, lower, upper)


def effort_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Joints whose torque nothing limits, and those whose robot has other limits than the policy was trained with."""
    names, field, text = contract.joint_names, "effort_limit", "{:g}, robot {:g}"
    robot = _of_robot(description, names, "effort_limit")
    trained = np.full(len(names), np.inf) if contract.effort_limit is None else contract.effort_limit
    where = f"no torque limit, in the contract or in '{description.name}', for {{}}: a simulation applies any torque"
    yield from _on("warning", field, where, names, (robot == np.inf) & (trained == np.inf))
    weaker, stronger = (robot < trained) & (trained < np.inf), (robot > trained) & (robot < np.inf)
    less, more = (
        "the robot allows less, N·m, which counts, for {}",
        "the robot allows more, N·m; simulations keep these for {}",
    )
    yield from _on("warning", field, less, names, weaker, text, trained, robot)
    yield from _on("info", field, more, names, stronger, text, trained, robot)


def model_damping_findings(contract: PolicyContract, own: Mapping[str, float]) -> Iterator[Finding]:
    """Joints that the robot's model damps as well, N·m·s/rad by joint, beside the contract's K_d."""
    damping, model = contract.joint_damping, np.array([own.get(name, 0.0) for name in contract.joint_names])
    is_open = contract.model_joint_damping == "undecided" and (damping * model > 0.0).any()
    effect = {
        "undecided": "nobody decides, so both act; x.contract.yaml decides, keep or drop",
        "keep": "keep: both act",
        "drop": "drop: simulations leave out the second number",
    }[contract.model_joint_damping]
    message = f"{effect}: the contract's K_d + the model's own damping, N·m·s/rad: {{}}"
    severity: Severity = "warning" if is_open else "info"
    joints, both = contract.joint_names, model > 0.0
    yield from _on(severity, "model_joint_damping", message, joints, both, "{:g} + {:g}", damping, model)


# --- values that are hardly meant ---


def suspicious_findings(
    contract: PolicyContract, own_damping: Mapping[str, float] = MappingProxyType({}), own_stiffness: float = 0.0
) -> Iterator[Finding]:
    """Gains and scales that hardly anybody means.

    `own_damping`, N·m·s/rad by joint, is of the robot's model: where it is kept, it brakes a joint without K_d; a low
    `own_stiffness`, N·m/rad, the robot's largest, excuses low ones in the contract.
    """
    joints, driven, scale = contract.joint_names, contract.action_joint_names, contract.action_scale
    stiffness, damping = contract.joint_stiffness, contract.joint_damping
    limp = (stiffness == 0.0) & np.isin(joints, driven)
    yield from _on("error", "joint_stiffness", "is 0: the action cannot move {}", joints, limp)
    is_weak = 0.0 < own_stiffness <= _PLACEHOLDER
    if len(joints) >= _FEW and 0.0 < stiffness.max() <= _PLACEHOLDER and not is_weak:
        yield Finding("error", "joint_stiffness", f"is {stiffness.max():g} or less for every joint: a placeholder?")
    kept = [] if contract.model_joint_damping == "drop" else list(own_damping)
    free = (damping == 0.0) & ~np.isin(joints, kept)
    yield from _on("error" if free.all() else "warning", "joint_damping", "is 0: nothing brakes {}", joints, free)
    both = (damping > 0.0) & (stiffness > 0.0)
    if both.any() and (damping > stiffness)[both].all():
        yield Finding("error", "joint_damping", "is larger than joint_stiffness for every joint: swapped?")
    yield from _on("error", "action_scale", "is 0: the action cannot move {}", driven, scale == 0.0)
    yield from _on("warning", "action_scale", "is negative, direction reversed? for {}", driven, scale < 0.0)
    if (scale == 1.0).all():
        yield Finding("warning", "action_scale", "is 1 rad for every joint: usual are less than 0.6; was it forgotten?")


def _term_findings(contract: PolicyContract, *, hardware: bool) -> Iterator[Finding]:
    """Scales that hardly anybody trains with, and estimates that a robot lacks."""
    for term in contract.terms:
        kind, field, scale = contract.kind(term), f"observation term {term.name}", np.atleast_1d(term.scale)
        if (scale <= 0.0).any():
            up = ": when upright, gravity points up" if kind.name == "projected_gravity" and scale.min() else ""
            yield Finding("warning", field, f"has the scale {scale.min():g}{up}")
        if kind.name == "motion_anchor_ori":
            if hardware:
                yield Finding("info", field, "needs an orientation alone, which the IMU and the joints give")
        elif kind.estimate:
            message = f"needs {kind.estimate}, which a simulation knows and a robot has to estimate"
            remark = "; there is no estimator" if hardware else ""
            yield Finding("error" if hardware else "info", field, f"{message}{remark}")
        if term.width is not None or term.scan is not None:
            yield Finding("info", field, f"is a live input: on a robot, programs send it by {term.topic or kind.topic}")


# --- evidence at hand ---


def _symmetry_findings(contract: PolicyContract) -> Iterator[Finding]:
    """Gains, limits, scales and poses that differ between left and right; a pose may be mirrored by its sign."""
    for field in ("joint_stiffness", "joint_damping", "effort_limit", "default_joint_pos", "action_scale"):
        names = contract.action_joint_names if field == "action_scale" else contract.joint_names
        values = getattr(contract, field)
        size = {} if values is None else dict(zip(names, np.abs(values).tolist(), strict=True))
        far, relative = (_POSE, 0.0) if field == "default_joint_pos" else (0.0, _CLOSE)
        found = {
            left: f"{size[left]:g}, {right} {size[right]:g}"
            for left, right in mirrored_pairs(list(size))
            if not np.isclose(size[left], size[right], rtol=relative, atol=far)
        }
        if found:
            yield Finding("warning", field, f"differs between left and right: {list_joints(found)}")


def _actuator_findings(
    contract: PolicyContract, model: mujoco.MjModel, own_damping: Mapping[str, float]
) -> Iterator[Finding]:
    """Gains and targets that differ from those of the model's own actuators, which simulations leave out."""
    actuators = own_actuators(model).items()
    servos = {name: own for name, own in actuators if own.stiffness > 0.0 and name in contract.joint_names}
    names, places = list(servos), [contract.joint_names.index(name) for name in servos]
    passive = np.array([own_damping.get(name, 0.0) for name in names])  # a contract may hold it in its K_d
    for gain, extra in (("stiffness", 0.0), ("damping", passive)):
        gains = np.array([getattr(own, gain) for own in servos.values()])
        ours = getattr(contract, f"joint_{gain}")[places] + 0.0  # no -0
        differs = ~(_is_rounded(ours, gains) | _is_rounded(ours, gains + extra) | (gains == 0.0))
        # One gain for all is a placeholder in the model.
        severity: Severity = "warning" if len(set(gains.tolist())) > 1 else "info"
        message = f"is not that of the model's own actuators for {differs.sum()} joints: {{}}"
        yield from _on(severity, f"joint_{gain}", message, names, differs, "{:g}, actuator {:g}", ours, gains)
    if contract.position_clip is None:
        clips = [own.target_range != NO_RANGE for own in servos.values()]
        message = f"none, but the model's own actuators clip the targets of {{}}: `{JOINT_LIMITS}` is what training saw"
        yield from _on("warning", "position_clip", message, names, clips)


def _scale_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Joints that leave mjlab's formula, scale = factor · effort limit / K_p, where it holds for most."""
    names, scale = contract.action_joint_names, contract.action_scale
    effort = _of_robot(description, contract.joint_names, "effort_limit")
    if contract.effort_limit is not None:
        effort = np.fmin(effort, contract.effort_limit)
    reach = np.where(np.isfinite(effort), effort, 0.0) / np.maximum(contract.joint_stiffness, 1e-9)
    unit = reach[[contract.joint_names.index(name) for name in names]]
    is_known = (unit > 0.0) & (scale > 0.0)
    if is_known.sum() < _FEW:
        return
    factors = (scale[is_known] / unit[is_known]).tolist()
    factor = max(factors, key=lambda factor: int(_is_rounded(scale, factor * unit).sum()))
    holds = is_known & _is_rounded(scale, factor * unit)
    kinds = len({f"{value:.2g}" for value in unit[holds].tolist()})
    if kinds >= 3 and holds.sum() >= _RULED * is_known.sum():  # otherwise nothing shows that it is the exporter's
        message = f"is {factor:.3g} · effort limit / K_p for {holds.sum()} joints, but not for {{}}"
        others, text = is_known & ~holds, "{:g}, expected {:.3g}"
        yield from _on("warning", "action_scale", message, names, others, text, scale, factor * unit)


def _rounding_findings(contract: PolicyContract) -> Iterator[Finding]:
    """Gains and scales that an exporter rounded to three decimals: one line."""
    worst, lost = 0.0, []
    for field in ("action_scale", "joint_stiffness", "joint_damping"):
        names = contract.action_joint_names if field == "action_scale" else contract.joint_names
        values: FloatArray = np.abs(getattr(contract, field))
        fine = np.round(values, _DECIMALS) != np.round(values, _DECIMALS - 1)
        # Values that end early by themselves (0.25, 50) do not show that anything was cut off.
        is_cut = fine.any() and (np.round(values, _DECIMALS) == values).all()
        if is_cut and len(values) >= _FEW and "metadata" in contract.source.get(field, ""):
            smallest = int(np.argmin(np.where(fine, values, np.inf)))
            share = 0.5 * 10.0**-_DECIMALS / float(values[smallest])
            lost.append(f"{field} {100.0 * share:.2g} % ({names[smallest]})")
            worst = max(worst, share)
    if lost:
        severity: Severity = "error" if worst > _LOST[1] else "warning" if worst > _LOST[0] else "info"
        message = f"cut at {_DECIMALS} decimals: off by up to {', '.join(lost)}; x.contract.yaml can hold all"
        yield Finding(severity, "rounding", message)


def _is_rounded(values: FloatArray, expected: FloatArray) -> BoolArray:
    """Return where values are the expected ones, as far as the decimals with which they are written go."""
    decimals = np.array([len(f"{value:.6g}".partition(".")[2]) for value in values.tolist()])
    return np.abs(values - expected) <= np.maximum(_CLOSE * expected, 0.51 * 10.0**-decimals)
