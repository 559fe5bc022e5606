"""Checks of a contract against a robot: joints, bodies, motors, ranges, torques, damping, estimates, rate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import mujoco
import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.rl_policy import ticks_per_step
from humanoid_sim.errors import known_names
from humanoid_sim.mit import BASE, IMU
from humanoid_sim.names import near_miss
from humanoid_sim.policy.findings import Finding, Severity, joint_list, on_joints
from humanoid_sim.policy.layers import is_from_robot
from humanoid_sim.policy.plausibility import (
    actuator_findings,
    assumption_findings,
    formula_findings,
    rounding_findings,
    suspicious_findings,
    symmetry_findings,
    term_findings,
)
from humanoid_sim.robots.actuators import own_actuators, own_joint_damping
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.motors import MOTORS

_ALIKE = 0.85  # likeness of two names, 0 to 1, from which one is taken for a slip of the other
_ANGLE = 1e-3  # rad; exporters round poses to three decimals
_STUCK = 0.02  # rad; a joint that an action of one unit moves by less hardly moves
_COARSE = 0.02  # relative error of a gain by the motor's format


def contract_findings(
    contract: PolicyContract, description: RobotDescription, model: mujoco.MjModel, *, hardware: bool
) -> list[Finding]:
    """Run every check of a contract, in the order in which a person would.

    Args:
        model: the robot's, as `humanoid_sim.robots.mjcf.bare_model` gives it.
        hardware: the real robot, which has no estimator, and needs motors.
    """
    own_damping, actuators = own_joint_damping(model, description), own_actuators(model)
    own = [joint.stiffness for joint in description.joints] + [servo.stiffness for servo in actuators.values()]
    return [
        *joint_findings(contract, description),
        *frame_findings(contract, description.name, model),
        *motor_findings(contract, description, hardware=hardware),
        *range_findings(contract, description),
        *effort_findings(contract, description),
        *suspicious_findings(contract, own_damping, max(own)),
        *term_findings(contract),
        *symmetry_findings(contract),
        *actuator_findings(contract, actuators, own_damping),
        *formula_findings(contract, description, model),
        *model_damping_findings(contract, own_damping),
        *input_findings(contract, hardware=hardware),
        *(rate_findings(contract, description) if hardware else ()),
        *rounding_findings(contract),
        *assumption_findings(contract),
    ]


def joint_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Joints that only the policy or only the robot has, and names that only the robot gives."""
    field, robot = "joint_names", f"'{description.name}'"
    surplus = [name for name in description.joint_names if name not in contract.joint_names]
    foreign = [name for name in contract.joint_names if name not in description.joint_names]
    meant = {name: near_miss(name, surplus, _ALIKE) for name in foreign}
    slips = {name: f"robot has {other}" for name, other in meant.items() if other}
    yield from on_joints("error", field, f"not of {robot}, rename in x.contract.yaml:", slips)
    yield from on_joints("error", field, f"not of {robot}:", [name for name in foreign if name not in slips])
    missing = [name for name in surplus if name not in meant.values()]
    yield from on_joints("error", field, f"have to be the robot's, the policy lacks {robot}'s", missing)
    source = contract.source.get(field, "")
    if is_from_robot(source):
        message = f"are those of {robot} ({source}): any robot with as many would do; x.contract.yaml can name them"
        yield Finding("warning", field, message)


def frame_findings(contract: PolicyContract, robot: str, model: mujoco.MjModel) -> Iterator[Finding]:
    """Bodies of the motion, and points whose velocity or ground is observed, that the robot's model lacks."""
    bodies = [model.body(i).name for i in range(1, model.nbody)]
    sites = [BASE, IMU, *(model.site(i).name for i in range(model.nsite) if model.site(i).name)]
    needed = [("body_names", name, "body", bodies) for name in contract.body_names]
    if contract.anchor_body:
        needed.append(("anchor_body", contract.anchor_body, "body", bodies))
        if contract.body_names and contract.anchor_body not in contract.body_names:
            message = f"'{contract.anchor_body}' is not among body_names; a motion of those does not say where it is"
            yield Finding("warning", "anchor_body", message)
    for term in contract.terms:
        if term.scan is not None:
            needed.append((f"observation term {term.name}", term.scan.at, "site or body", [*sites, *bodies]))
        elif "at" in contract.kind(term).conventions:
            needed.append((f"observation term {term.name}", term.at, "site", sites))
    for field, name, kind, known in needed:
        if name not in known:
            near = near_miss(name, known, _ALIKE)
            listed = f"'{near}'" if near else ", ".join(known)
            yield Finding("error", field, f"'{name}' is no {kind} of '{robot}', which has {listed}")


def motor_findings(contract: PolicyContract, description: RobotDescription, *, hardware: bool) -> Iterator[Finding]:
    """Gains beyond what the robot's CAN motors can encode."""
    models = {joint.name: joint.motor.model for joint in description.joints if joint.motor is not None}
    if not models:
        message = f"the description of '{description.name}' names no CAN motors, so that gains were not compared"
        yield Finding("error" if hardware else "info", "robot", f"{message} with what they encode")
        return
    if hardware:
        without = [name for name in description.joint_names if name in contract.joint_names and name not in models]
        yield from on_joints("error", "robot", "the description names no motor of", without)
    for model in sorted({*models.values()} - MOTORS.keys()):
        yield Finding("warning", "robot", known_names("motor model", model, MOTORS))
    motors = {name: MOTORS[model] for name, model in models.items() if model in MOTORS}
    for gain in ("stiffness", "damping"):
        over, coarse = {}, {}
        for name, value in zip(contract.joint_names, getattr(contract, f"joint_{gain}").tolist(), strict=True):
            most = getattr(motors[name], gain) if name in motors else np.inf
            step = most / 65535  # gains are 16 bits on the wire
            if value > most:
                over[name] = f"{value:g}, {motors[name].name} at most {most:g}"
            elif 0.0 < value < step / _COARSE < np.inf:
                coarse[name] = f"{value:g}, {motors[name].name} in steps of {step:.2g}"
        yield from on_joints("error", f"joint_{gain}", "is more than the motor can encode for", over)
        yield from on_joints("warning", f"joint_{gain}", "is encoded coarsely by the motor of", coarse)


def range_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Poses and actions against the joints' ranges, for joints that the robot has."""
    ranges = {joint.name: (joint.lower, joint.upper) for joint in description.joints}
    pose = dict(zip(contract.joint_names, contract.default_joint_pos.tolist(), strict=True))
    assert contract.action_offset is not None  # filled in at construction
    offsets = dict(zip(contract.action_joint_names, contract.action_offset.tolist(), strict=True))
    moved = {name: value for name, value in offsets.items() if abs(value - pose[name]) > _ANGLE}
    held = {name: 0.0 for name in pose if name not in offsets}
    for field, values, what in (
        ("default_joint_pos", pose, ""),
        ("action_offset", moved, ""),
        ("action_joint_names", held, "at 0, where it is held, "),
    ):
        far = {name: value for name, value in values.items() if name in ranges and not _is_in(value, ranges[name])}
        in_degrees = all(abs(value) > np.pi and _is_in(np.deg2rad(value), ranges[name]) for name, value in far.items())
        shown = {name: f"{value:g}, range {_span(ranges[name])}" for name, value in far.items()}
        remark = "; is it in degrees?" if in_degrees else ""
        yield from on_joints("error", field, f"is {what}beyond the range, rad, of", shown, remark)
    scales = dict(zip(contract.action_joint_names, np.abs(contract.action_scale).tolist(), strict=True))
    stuck = {name: f"{scale:g}" for name, scale in scales.items() if 0.0 < scale < _STUCK}
    yield from on_joints("warning", "action_scale", "an action of 1 hardly moves, in rad,", stuck)
    clip = contract.position_clip
    if isinstance(clip, str):  # the joints' own ranges
        return
    ends = [(offsets[name] - scale, offsets[name] + scale) for name, scale in scales.items()]
    spans = zip(scales, ends if clip is None else clip.tolist(), strict=True)
    wide = {
        name: f"{_span(span)}, range {_span(ranges[name])}"
        for name, span in spans
        if name in ranges and not all(_is_in(end, ranges[name]) for end in span)
    }
    if clip is None:
        yield from on_joints("info", "action_scale", "actions of -1 to 1 leave the range of", wide)
    else:
        yield from on_joints("warning", "position_clip", "is wider than the range of", wide)


def _is_in(value: float, span: tuple[float, float]) -> bool:
    return bool(span[0] - _ANGLE <= value <= span[1] + _ANGLE)


def _span(span: tuple[float, float]) -> str:
    return f"{span[0]:.4g} to {span[1]:.4g}"


def effort_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Joints whose torque nothing limits, and those whose robot has other limits than the policy was trained with."""
    robot = {joint.name: joint.effort_limit for joint in description.joints}
    trained = np.full(len(contract.joint_names), np.inf) if contract.effort_limit is None else contract.effort_limit
    free, weaker, stronger = list[str](), dict[str, str](), dict[str, str]()
    for name, limit in zip(contract.joint_names, trained.tolist(), strict=True):
        own = robot.get(name, limit)
        if name in robot and own == limit == np.inf:
            free.append(name)
        elif own < limit < np.inf:
            weaker[name] = f"{limit:g}, robot {own:g}"
        elif limit < own < np.inf:
            stronger[name] = f"{limit:g}, robot {own:g}"
    field, where = "effort_limit", f"in the contract or in '{description.name}'"
    remark = ": a simulation applies any torque, a real motor does not; x.contract.yaml can state it"
    yield from on_joints("warning", field, f"no torque limit, {where}, for", free, remark, len(robot))
    yield from on_joints("warning", field, "the robot allows less, N·m, which counts, for", weaker)
    yield from on_joints("info", field, "the robot allows more, N·m; simulations keep the contract's for", stronger)


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
    listed = "; ".join(f"{kd:g} + {model:g} for {joint_list(names)}" for (kd, model), names in pairs.items())
    decision, what = contract.model_joint_damping, f"the contract's K_d + the model's own damping, N·m·s/rad: {listed}"
    severity: Severity = "info"
    if decision == "undecided":
        severity = "warning" if any(kd > 0.0 for kd, _ in pairs) else "info"
        message = f"nobody decides, so both act: {what}; x.contract.yaml decides: keep or drop"
    else:
        act = "both act:" if decision == "keep" else "simulations leave out the second number of"
        message = f"{decision}: {act} {what}"
    yield Finding(severity, "model_joint_damping", message)


def input_findings(contract: PolicyContract, *, hardware: bool) -> Iterator[Finding]:
    """Terms that a robot has to estimate (an error on hardware), and live inputs that have to come from somewhere."""
    for term in contract.terms:
        kind, field = contract.kind(term), f"observation term {term.name}"
        if kind.name == "motion_anchor_ori":
            if hardware:
                yield Finding("info", field, "needs an orientation alone, which the IMU and the joints give")
        elif kind.estimate:
            message = f"needs {kind.estimate}, which a simulation knows and a robot has to estimate"
            remark = "; there is no estimator" if hardware else ""
            yield Finding("error" if hardware else "info", field, f"{message}{remark}")
        if term.width is not None:
            source = f"programs send it by {term.topic or kind.topic}, or `live` feeds it"
            yield Finding("info", field, f"is a live input of width {term.width}: {source}; doctor and regress cannot")
        elif term.scan is not None:
            message = f"a simulation scans {term.scan.count} points; on a robot a program has to send them"
            yield Finding("info", field, message)


def rate_findings(contract: PolicyContract, description: RobotDescription) -> Iterator[Finding]:
    """Find a policy's period that is not a multiple of the real robot's control period."""
    period = 1.0 / description.hardware.control_frequency
    if not ticks_per_step(contract.policy_dt, period)[1]:
        message = f"is {contract.policy_dt:g} s, no multiple of the robot's control period, {period:g} s"
        yield Finding("warning", "policy_dt", f"{message}: it has to run at another rate")
