"""What `robot describe` shows of a robot and its model, and the robot file that it writes."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import mujoco
import yaml
from rich.markup import escape
from rich.table import Table

from humanoid_sim.robots.actuators import own_actuators
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.imu import imu_line
from humanoid_sim.robots.mjcf import prefix_line

_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def joint_table(robot: RobotDescription, model: mujoco.MjModel) -> Table:
    """Return the robot's joints with limits, gains, and the dynamics that simulations have."""
    table = _table(
        f"joints of '{escape(robot.name)}' (rad, N·m, kg·m²)",
        *("range", "effort limit", "K_p", "K_d", "armature", "friction", "damping", "start"),
    )
    for joint, start in zip(robot.joints, robot.initial_position, strict=True):
        dof = int(model.joint(joint.name).dofadr[0])
        dynamics = [model.dof_armature[dof], model.dof_frictionloss[dof], model.dof_damping[dof]]
        if joint.dynamics is not None:
            measured = (joint.dynamics.armature, joint.dynamics.friction, joint.dynamics.damping)
            dynamics = [own if value is None else value for own, value in zip(dynamics, measured, strict=True)]
        effort = "none" if math.isinf(joint.effort_limit) else f"{joint.effort_limit:g}"
        gains = [f"{value:g}" if value else "policy's" for value in (joint.stiffness, joint.damping)]
        values = [f"{value:g}" for value in (*dynamics, start)]
        table.add_row(escape(joint.name), _span((joint.lower, joint.upper)), effort, *gains, *values)
    return table


def actuator_table(model: mujoco.MjModel) -> Table:
    """Return what the model's own actuators do to its joints."""
    title = "the model's own actuators, which are left out"
    table = _table(title, "kind", "K_p", "K_d", "force", "target clipped to")
    for own in own_actuators(model).values():
        gains = f"{own.stiffness:g}", f"{own.damping:g}"
        table.add_row(escape(own.joint), own.kind, *gains, _span(own.force_range), _span(own.target_range))
    return table


def _table(title: str, *headings: str) -> Table:
    table = Table(title=title, title_justify="left")
    for heading in ("joint", *headings):
        table.add_column(heading, no_wrap=True)
    return table


def _span(bounds: tuple[float, float]) -> str:
    return "any" if math.isinf(bounds[0]) and math.isinf(bounds[1]) else f"{bounds[0]:g} to {bounds[1]:g}"


def lines(robot: RobotDescription, model: mujoco.MjModel) -> Iterator[tuple[str, str]]:
    """Yield what else is known of a robot, each with its heading."""
    base, settings = robot.base, robot.simulation
    above = "its lowest part on the floor" if base.height is None else f"{base.height:g} m high"
    yield "model", str(robot.mjcf_path)
    yield "base", f"floating, body '{base.body}', starts with {above}" if robot.is_floating else "fixed"
    yield "IMU", imu_line(model, robot)
    rates = f"physics step {settings.physics_timestep:g} s, control at {settings.control_frequency:g} Hz"
    yield "simulation", f"{rates}, the joints' own damping: {settings.joint_damping}"
    motors = Counter(joint.motor.model for joint in robot.joints if joint.motor is not None)
    none = "none: hardware needs a robot file that gives them (actuators of an MJCF say nothing of a bus)"
    yield "CAN motors", ", ".join(f"{count} {name}" for name, count in motors.items()) or none
    unlimited = [joint.name for joint in robot.joints if math.isinf(joint.effort_limit)]
    if unlimited:
        yield "without effort limit", ", ".join(unlimited)
    clip = _position_clip(robot, model)
    if clip:
        yield "position clip", f"a policy trained with the model's own actuators has seen {clip} (x.contract.yaml)"
    names = [model.joint(i).name or "unnamed" for i in range(model.njnt) if int(model.jnt_type[i]) in _SCALAR]
    passive = [name for name in names if name not in robot.joint_names]
    if passive:
        yield "passive joints", ", ".join(passive)
    coupled = list(_equalities(model))
    if coupled:
        yield "equalities", ", ".join(coupled)
    prefix = prefix_line(robot.mjcf_path)
    if prefix:
        yield "names", prefix


def _position_clip(robot: RobotDescription, model: mujoco.MjModel) -> str:
    """Return the `position_clip` that the model's own actuators amount to; '' for none."""
    targets = {name: own.target_range for name, own in own_actuators(model).items()}
    clipped = {joint.name for joint in robot.joints if math.isfinite(targets.get(joint.name, (math.inf,))[0])}
    if not clipped:
        return ""
    is_limit = all(math.dist(targets[j.name], (j.lower, j.upper)) < 1e-6 for j in robot.joints if j.name in clipped)
    which = "" if len(clipped) == robot.joint_count else f" for {len(clipped)} of {robot.joint_count} joints"
    return f"position_clip: {'joint_limits' if is_limit else 'the ranges above'}{which}"


def _equalities(model: mujoco.MjModel) -> Iterator[str]:
    """Yield what couples joints, such as the mimic `finger = 0.1 -2 · thumb`, and the number of other equalities."""
    others: Counter[str] = Counter()
    for i in range(model.neq):
        kind = mujoco.mjtEq(int(model.eq_type[i]))
        if kind != mujoco.mjtEq.mjEQ_JOINT:
            others[kind.name.removeprefix("mjEQ_").lower()] += 1
            continue
        follower, leader = model.joint(int(model.eq_obj1id[i])).name, int(model.eq_obj2id[i])
        offset, ratio, *powers = (float(value) for value in model.eq_data[i, :5])
        text = f"{follower} = {offset:g}" + (f" {ratio:+g} · {model.joint(leader).name}" if leader >= 0 else "")
        yield f"{text} + higher powers" if any(powers) else text
    yield from (f"{count} {kind}" for kind, count in others.items())


def robot_yaml(robot: RobotDescription, model: mujoco.MjModel, folder: Path) -> str:
    """Return a robot file for `folder` that is the robot of an MJCF, with what was read in comments, to be changed."""
    document = msgspec.to_builtins(robot)
    given = {"name": robot.name, "mjcf": os.path.relpath(robot.mjcf_path, folder), "imu": robot.imu}
    pose = {"initial_position": dict(zip(robot.joint_names, robot.initial_position, strict=True))}
    numbers = ("lower", "upper", "effort_limit", "stiffness", "damping")
    read = {
        "base": {"height": robot.base.height},
        "simulation": document["simulation"],
        "joints": {
            joint["name"]: {name: joint[name] for name in numbers if math.isfinite(joint[name])}
            for joint in document["joints"]
        },
    }
    shown = _yaml(pose, flow=False) + _yaml(read)
    return f"""\
# What is not given here is read from the MJCF. Lines that begin with # show what was read: to change a value, remove
# the mark from its line and from the heading above it. humanoid_sim/robots/schema.py has every field.
# A height of null: the robot's lowest part touches the floor. A K_p or K_d of 0 is the policy's.
# IMU: {imu_line(model, robot)}
{_yaml(given, flow=False)}""" + "".join(f"# {line}\n" for line in shown.splitlines())


def _yaml(document: dict[str, Any], flow: bool | None = None) -> str:
    text: str = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=math.inf, default_flow_style=flow)
    return text
