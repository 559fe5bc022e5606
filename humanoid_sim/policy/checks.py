"""Checks of a contract against a robot, without running it; each finding is one line for all joints it concerns."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from humanoid_sim.controllers.contract import JOINT_LIMITS, PolicyContract
from humanoid_sim.errors import known_names, meant
from humanoid_sim.mit import BASE, IMU, BoolArray, FloatArray
from humanoid_sim.names import list_joints, mirrored_pairs
from humanoid_sim.policy.findings import Finding, Severity
from humanoid_sim.policy.layers import rounding
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.mjcf import NO_RANGE, odd_gravity, own_actuators, own_joint_damping
from humanoid_sim.robots.motors import MOTORS

_FEW = 4  # joints below which values that are alike show nothing
_ANGLE = 1e-3  # rad; exporters round poses to three decimals
_POSE = 0.01  # rad by which the two sides of a pose may differ
_CLOSE = 0.02  # relative, within which two gains are the same
_PLACEHOLDER = 1.0  # N·m/rad; K_p is hardly as low at every joint
_LOST = (0.005, 0.1)  # relative error by rounding, from which it is a warning, and an error
_RULED = 0.7  # share of the joints from which on a formula is probably the exporter's


def contract_findings(
    contract: PolicyContract, description: RobotDescription, model: mujoco.MjModel, *, hardware: bool
) -> list[Finding]:
    """Run every check of a contract; `model` is the robot's own, `hardware`: for the real robot, without estimator."""
    damping = own_joint_damping(model, description)
    return [
        *_name_findings(contract, description, model),
        *(motor_findings(contract, description) if hardware else ()),
        *_pose_findings(contract, description),
        *effort_findings(contract, description),
        *suspicious_findings(contract, damping),
        *_term_findings(contract, hardware=hardware),
        *_symmetry_findings(contract),
        *_actuator_findings(contract, model, damping),
        *_formula_findings(contract, description, model),
        *model_findings(contract, description, model),
        *_rounding_findings(contract),
    ]


def _on(
    severity: Severity, field: str, message: str, names: Sequence[str], hits: Any, text: str = "", *columns: FloatArray
) -> Iterator[Finding]:
    places = np.flatnonzero(hits).tolist()
    rows = {names[i]: text.format(*(column[i] for column in columns)) for i in places}
    if rows:
        listed = list_joints(rows) if text else list_joints(list(rows), len(names))
        yield Finding(severity, field, message.replace("{}", listed))


def _of_robot(description: RobotDescription, names: Sequence[str], attribute: str) -> FloatArray:
    own = {joint.name: getattr(joint, attribute) for joint in description.joints}
    return np.array([own.get(name, np.nan) for name in names])


def _agree(values: FloatArray, expected: FloatArray) -> BoolArray:
    """Return where values are the expected ones, as far as an exporter's rounding lets them."""
    return np.abs(values - expected) <= rounding(values) + _CLOSE * np.abs(expected)


def _name_findings(contract: PolicyContract, description: RobotDescription, model: mujoco.MjModel) -> Iterator[Finding]:
    robot = f"'{description.name}'"
    lacking = [name for name in description.joint_names if name not in contract.joint_names]
    foreign = [name for name in contract.joint_names if name not in description.joint_names]
    if foreign:
        listed = list_joints([f"{name}{meant(name, lacking)}" for name in foreign])
        yield Finding("error", "joint_names", f"not of {robot}, x.contract.yaml can rename: {listed}")
    if lacking:
        yield Finding("error", "joint_names", f"have to be the robot's, the policy lacks {list_joints(lacking)}")
    if contract.source.get("joint_names", "").endswith("and the robot"):
        message = f"are those of {robot}, by their places: any robot with as many would do"
        yield Finding("warning", "joint_names", f"{message}; x.contract.yaml can name them")
    bodies = [model.body(i).name for i in range(1, model.nbody)]
    sites = [BASE, IMU, *(model.site(i).name for i in range(model.nsite) if model.site(i).name)]
    needed = [("body_names", name, bodies) for name in contract.body_names]
    needed += [("anchor_body", contract.anchor_body, bodies)] if contract.anchor_body else []
    for term in contract.terms:
        field = f"observation term {term.name}"
        needed += [(field, term.scan.at, [*sites, *bodies])] if term.scan is not None else []
        needed += [(field, term.at, sites)] if "at" in contract.kind(term).conventions else []
    for field, name, known in needed:
        if name not in known:
            yield Finding("error", field, known_names(f"body or site of {robot}", name, known))


def motor_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Joints without a motor, and gains beyond what CAN motors can encode."""
    models = {joint.name: joint.motor.model for joint in description.joints if joint.motor is not None}
    joints = contract.joint_names
    if not models:
        yield Finding("error", "robot", f"the description of '{description.name}' names no CAN motors")
        return
    without = [name in description.joint_names and name not in models for name in joints]
    yield from _on("error", "robot", "the description names no motor of {}", joints, without)
    motors = [MOTORS.get(models.get(name, "")) for name in joints]
    for gain in ("stiffness", "damping"):
        most = np.array([np.inf if motor is None else getattr(motor, gain) for motor in motors])
        gains, message = getattr(contract, f"joint_{gain}"), "is more than the motor can encode for {}"
        yield from _on("error", f"joint_{gain}", message, joints, gains > most, "{:g}, at most {:g}", gains, most)


def _pose_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    names, pose = contract.joint_names, contract.default_joint_pos
    lower, upper = (_of_robot(description, names, end) for end in ("lower", "upper"))
    far = (pose < lower - _ANGLE) | (pose > upper + _ANGLE)
    message = f"is beyond the range, rad, of {{}}{'; is it in degrees?' if (np.abs(pose[far]) > np.pi).all() else ''}"
    text = "{:g}, range {:.4g} to {:.4g}"
    yield from _on("error", "default_joint_pos", message, names, far, text, pose, lower, upper)
    offset, driven = np.array(contract.action_offset, dtype=np.float64), contract.action_joint_names
    default = pose[[names.index(name) for name in driven]]
    differs = (np.abs(offset - default) > rounding(offset) + rounding(default)) & offset.any()
    message, text = "is not default_joint_pos for {}", "{:g}, pose {:g}"
    yield from _on("warning", "action_offset", message, driven, differs, text, offset, default)


def effort_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Joints whose torque nothing limits, and those whose robot has other limits than the policy was trained with."""
    names, field = contract.joint_names, "effort_limit"
    robot = _of_robot(description, names, "effort_limit")
    trained = np.full(len(names), np.inf) if contract.effort_limit is None else contract.effort_limit
    unlimited, weaker = (robot == np.inf) & (trained == np.inf), (robot < trained) & (trained < np.inf)
    message = f"no torque limit, in the contract or in '{description.name}', for {{}}: a simulation applies any torque"
    yield from _on("warning", field, message, names, unlimited)
    message = "the robot allows less, N·m, which counts, for {}"
    yield from _on("warning", field, message, names, weaker, "{:g}, robot {:g}", trained, robot)


def model_findings(contract: PolicyContract, robot: RobotDescription, bare: mujoco.MjModel) -> Iterator[Finding]:
    """Find what of a robot's own model a policy cannot mean, and joints that both damp where nobody decides."""
    if gravity := odd_gravity(bare):
        yield Finding("warning", "gravity", f"is {gravity}")
    if contract.takes_velocity_command and not robot.is_floating:
        yield Finding("warning", "base", f"of '{robot.name}' is fixed, and the policy walks")
    joints, damping, own = contract.joint_names, contract.joint_damping, own_joint_damping(bare, robot)
    model = np.array([own.get(name, 0.0) for name in joints])
    both = (damping > 0.0) & (model > 0.0) & (contract.model_joint_damping == "undecided")
    message = "the contract's K_d and the model's own damping both act: keep or drop in x.contract.yaml: {}"
    yield from _on("warning", "model_joint_damping", message, joints, both, "{:g} + {:g}", damping, model)


def suspicious_findings(contract: PolicyContract, own_damping: Collection[str] = ()) -> Iterator[Finding]:
    """Gains and scales of no effect; `own_damping`: joints that the robot's model brakes itself."""
    joints, driven, scale = contract.joint_names, contract.action_joint_names, contract.action_scale
    stiffness, damping = contract.joint_stiffness, contract.joint_damping
    limp = (stiffness == 0.0) & np.isin(joints, driven)
    yield from _on("error", "joint_stiffness", "is 0: the action cannot move {}", joints, limp)
    if len(joints) >= _FEW and 0.0 < stiffness.max() <= _PLACEHOLDER:
        yield Finding("error", "joint_stiffness", f"is {stiffness.max():g} or less for every joint: a placeholder?")
    kept = [] if contract.model_joint_damping == "drop" else list(own_damping)
    free = (damping == 0.0) & ~np.isin(joints, kept)
    yield from _on("error" if free.all() else "warning", "joint_damping", "is 0: nothing brakes {}", joints, free)
    yield from _on("error", "action_scale", "is 0: the action cannot move {}", driven, scale == 0.0)


def _term_findings(contract: PolicyContract, *, hardware: bool) -> Iterator[Finding]:
    for term in contract.terms:
        kind, field = contract.kind(term), f"observation term {term.name}"
        if hardware and kind.name == "motion_anchor_ori":
            yield Finding("info", field, "needs an orientation alone, which the IMU and the joints give")
        elif kind.is_estimate and kind.name != "motion_anchor_ori":
            message = f"needs the {kind.input(term)}, which a simulation knows and a robot has to estimate"
            remark = "; there is no estimator" if hardware else ""
            yield Finding("error" if hardware else "info", field, f"{message}{remark}")


def _magnitudes(contract: PolicyContract, field: str) -> dict[str, float]:
    names = contract.action_joint_names if field == "action_scale" else contract.joint_names
    values = getattr(contract, field)
    return {} if values is None else dict(zip(names, np.abs(values).tolist(), strict=True))


def _symmetry_findings(contract: PolicyContract) -> Iterator[Finding]:
    for field in ("joint_stiffness", "joint_damping", "effort_limit", "default_joint_pos", "action_scale"):
        size = _magnitudes(contract, field)
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
    actuators = own_actuators(model).items()
    servos = {name: own for name, own in actuators if own.stiffness > 0.0 and name in contract.joint_names}
    names, places = list(servos), [contract.joint_names.index(name) for name in servos]
    passive = np.array([own_damping.get(name, 0.0) for name in names])  # a contract may hold it in its K_d
    for gain, extra in (("stiffness", 0.0), ("damping", passive)):
        gains = np.array([getattr(own, gain) for own in servos.values()])
        ours = getattr(contract, f"joint_{gain}")[places] + 0.0  # no -0
        differs = ~(_agree(ours, gains) | _agree(ours, gains + extra) | (gains == 0.0))
        message = f"is not that of the model's own actuators for {differs.sum()} joints: {{}}"
        if len(set(gains.tolist())) > 1:  # one gain for all is a placeholder in the model
            yield from _on("warning", f"joint_{gain}", message, names, differs, "{:g}, actuator {:g}", ours, gains)
    if contract.position_clip is None:
        clips = [own.target_range != NO_RANGE for own in servos.values()]
        message = f"none, but the model's own actuators clip the targets of {{}}: `{JOINT_LIMITS}` is what training saw"
        yield from _on("warning", "position_clip", message, names, clips)


def _formula_findings(
    contract: PolicyContract, description: RobotDescription, model: mujoco.MjModel
) -> Iterator[Finding]:
    """Yield joints that break a rule which most keep: mjlab derives K_p from the armature, and the scale from K_p."""
    names, stiffness = contract.joint_names, contract.joint_stiffness
    effort = _of_robot(description, names, "effort_limit")
    if contract.effort_limit is not None:
        effort = np.fmin(effort, contract.effort_limit)
    reach = np.where(np.isfinite(effort), effort, 0.0) / np.maximum(stiffness, 1e-9)
    driven = [names.index(name) for name in contract.action_joint_names]
    inertia = {name: float(model.dof_armature[model.joint(name).dofadr[0]]) for name in description.joint_names}
    armature = np.array([inertia.get(name, 0.0) for name in names])
    for field, joints, values, formula, unit in (
        ("action_scale", contract.action_joint_names, contract.action_scale, "effort limit / K_p", reach[driven]),
        ("joint_stiffness", names, stiffness, "armature", armature),
    ):
        is_known = (unit > 0.0) & (values > 0.0)
        if is_known.sum() < _FEW:
            continue
        factors = (values[is_known] / unit[is_known]).tolist()
        factor = max(factors, key=lambda factor: int(_agree(values, factor * unit).sum()))
        holds = is_known & _agree(values, factor * unit)
        kinds = len({f"{value:.2g}" for value in unit[holds].tolist()})
        if kinds >= 3 and holds.sum() >= _RULED * is_known.sum():  # otherwise nothing shows that it is the exporter's
            message = f"is {factor:.3g} · {formula} for {holds.sum()} joints, but not for {{}}"
            others, text = is_known & ~holds, "{:g}, expected {:.3g}"
            yield from _on("warning", field, message, joints, others, text, values, factor * unit)


def _rounding_findings(contract: PolicyContract) -> Iterator[Finding]:
    for field in ("action_scale", "joint_stiffness", "joint_damping"):
        sizes = {name: size for name, size in _magnitudes(contract, field).items() if size > 0.0}
        is_cut = all(round(x, 3) == x for x in sizes.values()) and any(round(x, 2) != x for x in sizes.values())
        if is_cut and "metadata" in contract.source.get(field, ""):
            smallest = min(sizes, key=sizes.__getitem__)
            share = 0.5e-3 / sizes[smallest]
            if share > _LOST[0]:
                message = f"{field} was cut at 3 decimals: off by up to {100.0 * share:.2g} % ({smallest})"
                severity: Severity = "error" if share > _LOST[1] else "warning"
                yield Finding(severity, "rounding", f"{message}; x.contract.yaml can hold all")
