"""What `robot describe` shows of a robot and its model, and the robot file that it writes."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec
import mujoco
import yaml
from rich.markup import escape
from rich.table import Table

from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.imu import imu_line
from humanoid_sim.robots.own_actuators import own_actuators

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
    names = [model.joint(i).name or "unnamed" for i in range(model.njnt) if int(model.jnt_type[i]) in _SCALAR]
    passive = [name for name in names if name not in robot.joint_names]
    if passive:
        yield "passive joints", ", ".join(passive)


def robot_yaml(robot: RobotDescription, folder: Path) -> str:
    """Return a robot file for `folder` that is the robot of an MJCF, to be changed; lines may be left out again."""
    numbers = ("lower", "upper", "effort_limit", "stiffness", "damping")
    joints: dict[str, dict[str, float]] = {}
    for joint in robot.joints:
        values = {name: getattr(joint, name) for name in numbers}
        joints[joint.name] = {name: value for name, value in values.items() if math.isfinite(value)}
    document = {
        "name": robot.name,
        "mjcf": os.path.relpath(robot.mjcf_path, folder),
        "imu": robot.imu,
        "base": {"height": robot.base.height},
        "simulation": msgspec.to_builtins(robot.simulation),
        "initial_position": dict(zip(robot.joint_names, robot.initial_position, strict=True)),
        "joints": joints,
    }
    text: str = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=math.inf, default_flow_style=None)
    return text
