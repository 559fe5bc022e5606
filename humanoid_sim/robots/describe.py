"""What `robot describe` shows of a robot and its model."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator

import mujoco
import numpy as np
from rich.markup import escape
from rich.table import Table

from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.mjcf import ON_JOINT, imu_line, odd_gravity, own_actuators

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_WIDEST = (0.12, 25.0)  # rad, between which a robot's widest range is; 2π read as degrees is less, 1440° as rad more


def joint_table(robot: RobotDescription, model: mujoco.MjModel) -> Table:
    """Return the robot's joints with limits, gains, and the dynamics that simulations have."""
    headings = ("range", "effort limit", "K_p", "K_d", "armature", "friction", "damping", "spring", "start")
    table = _table(f"joints of '{escape(robot.name)}' (rad, N·m, kg·m²)", *headings)
    for joint, start in zip(robot.joints, robot.initial_position, strict=True):
        dof = int(model.joint(joint.name).dofadr[0])
        dynamics = [model.dof_armature[dof], model.dof_frictionloss[dof], model.dof_damping[dof]]
        if joint.dynamics is not None:
            measured = (joint.dynamics.armature, joint.dynamics.friction, joint.dynamics.damping)
            dynamics = [own if value is None else value for own, value in zip(dynamics, measured, strict=True)]
        effort = "none" if math.isinf(joint.effort_limit) else f"{joint.effort_limit:g}"
        gains = [f"{value:g}" if value else "policy's" for value in (joint.stiffness, joint.damping)]
        values = [f"{value:g}" for value in (*dynamics, model.joint(joint.name).stiffness[0], start)]
        table.add_row(escape(joint.name), _span((joint.lower, joint.upper)), effort, *gains, *values)
    return table


def actuator_table(model: mujoco.MjModel) -> Table:
    """Return what the model's own actuators do to its joints."""
    headings = ("kind", "K_p", "K_d", "force", "target clipped to")
    table = _table("the model's own actuators, which are left out", *headings)
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


def lines(robot: RobotDescription, model: mujoco.MjModel) -> dict[str, str]:
    """Return what else is known of a robot, by its heading; empty texts for nothing."""
    base, settings = robot.base, robot.simulation
    above = "its lowest part on the floor" if base.height is None else f"{base.height:g} m high"
    rates = f"physics step {settings.physics_timestep:g} s, control at {settings.control_frequency:g} Hz"
    motors = Counter(joint.motor.model for joint in robot.joints if joint.motor is not None)
    names = [model.joint(i).name or "unnamed" for i in range(model.njnt) if model.jnt_type[i] != _FREE]
    widths = robot.upper - robot.lower
    width = float(widths[np.isfinite(widths)].max(initial=0.0))
    is_odd = width > 0.0 and not _WIDEST[0] < width < _WIDEST[1]
    elsewhere = np.flatnonzero(~np.isin(model.actuator_trntype, ON_JOINT)).tolist()
    return {
        "model": str(robot.mjcf_path),
        "base": f"floating, body '{base.body}', starts with {above}" if robot.is_floating else "fixed",
        "IMU": imu_line(model, robot),
        "simulation": f"{rates}, the joints' own damping: {settings.joint_damping}",
        "CAN motors": ", ".join(f"{count} {name}" for name, count in motors.items()) or "none",
        "without effort limit": ", ".join(joint.name for joint in robot.joints if math.isinf(joint.effort_limit)),
        "passive joints": ", ".join(name for name in names if name not in robot.joint_names),
        "other actuators": ", ".join(model.actuator(i).name or "unnamed" for i in elsewhere),
        "ranges": f"at most {width:.3g} rad wide; is the compiler's angle right?" if is_odd else "",
        "gravity": odd_gravity(model),
        "equalities": ", ".join(_equalities(model)),
    }


def _equalities(model: mujoco.MjModel) -> Iterator[str]:
    for i in range(model.neq):
        off = "" if model.eq_active0[i] else " (inactive)"
        kind, leader = mujoco.mjtEq(int(model.eq_type[i])), int(model.eq_obj2id[i])
        offset, ratio, *powers = model.eq_data[i, :5]
        if kind != mujoco.mjtEq.mjEQ_JOINT:
            yield f"{kind.name.removeprefix('mjEQ_').lower()}{off}"
            continue
        text = f"{model.joint(int(model.eq_obj1id[i])).name} = {offset:g}"
        if leader >= 0:
            text += f" {ratio:+g} · {model.joint(leader).name}"
        yield f"{text}{' + higher powers' if any(powers) else ''}{off}"
