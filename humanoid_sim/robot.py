"""`python -m humanoid_sim.robot`: what is read from an MJCF, a robot file to change some of it, an MJCF of a URDF."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from humanoid_sim.cli import parse, run_program
from humanoid_sim.errors import InputError

if TYPE_CHECKING:
    import mujoco

    from humanoid_sim.robots.description import RobotDescription


@dataclass(frozen=True)
class Describe:
    """Show what is read from a robot's MJCF, or from its YAML file: joints, limits, damping, IMU, base, rates.

    With --output also write a YAML file that is the same robot, to be changed: it gives the MJCF, and whatever
    differs from it.
    """

    robot: tyro.conf.Positional[str]
    """An MJCF, a robot's YAML file, a shipped robot, or robot_descriptions:NAME."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """YAML file to write; only for an MJCF."""
    imu_site: str | None = None
    """The site or body of the MJCF that is the IMU. Default: its gyro's."""
    overwrite: bool = False
    """Replace the output if it exists."""


@dataclass(frozen=True)
class Convert:
    """Make an MJCF of a URDF, and list what it does not say.

    A URDF leaves open whether the robot's base floats; MuJoCo alone would fix it to the world.
    """

    source: tyro.conf.Positional[Path]
    """A URDF, whose meshes are looked for beside it."""
    base: Literal["floating", "fixed"]
    """The root link floats, as a walking robot's does, or is fixed to the world."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """File to write. Default: beside the URDF, with .xml for .urdf."""
    imu: str | None = None
    """Link that the IMU is fixed to."""
    overwrite: bool = False
    """Replace the output if it exists."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `robot` with command-line arguments; returns the exit status."""
    options: Describe | Convert = parse(
        Describe | Convert,
        "robot",
        arguments,
    )
    return _convert(options) if isinstance(options, Convert) else _describe(options)


def _convert(options: Convert) -> int:
    from humanoid_sim.files import output_file, whole_file  # noqa: PLC0415 - heavy imports stay out of `--help`
    from humanoid_sim.robots.from_urdf import convert_urdf  # noqa: PLC0415

    output = options.source.with_suffix(".xml") if options.output is None else options.output
    output_file(output, "--output", ".xml", overwrite=options.overwrite)
    text, gaps = convert_urdf(options.source, options.base, output.resolve().parent, options.imu)
    with whole_file(output) as file:
        file.write(text.encode())
    print(f"wrote {output}")
    if gaps:
        print("what the URDF does not say:")
    for line in gaps:
        print(f"  {line}")
    return 0


def _describe(options: Describe) -> int:
    from humanoid_sim.files import output_file  # noqa: PLC0415 - heavy imports stay out of `--help`
    from humanoid_sim.robots.description import load_robot, with_imu  # noqa: PLC0415
    from humanoid_sim.robots.mjcf import bare_model  # noqa: PLC0415

    if options.output is not None:
        if Path(options.robot).suffix != ".xml":
            raise InputError(f"--output: is for an MJCF (.xml), and '{options.robot}' is none")
        output_file(options.output, "--output", ".yaml", ".yml", overwrite=options.overwrite)
    robot = with_imu(load_robot(options.robot), options.imu_site)
    model = bare_model(robot)
    _print(robot, model)
    if options.output is not None:
        _write(robot, model, Path(options.robot), options.output)
    return 0


def _print(robot: RobotDescription, model: mujoco.MjModel) -> None:
    import mujoco  # noqa: PLC0415 - heavy, as are those below
    from rich.markup import escape  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    from humanoid_sim.policy_tools.show import make_console  # noqa: PLC0415
    from humanoid_sim.robots.mjcf import imu_line, own_joint_damping, prefix_line  # noqa: PLC0415

    console, settings = make_console(), robot.simulation
    figures = ("effort limit N·m", "K_p", "K_d", "model's damping", "start rad")
    table = Table("", "joint", "range rad", *figures, title=f"joints of '{escape(robot.name)}'", title_justify="left")
    own = own_joint_damping(model, robot)
    for i, joint in enumerate(robot.joints):
        limits = "any" if math.isinf(joint.lower) and math.isinf(joint.upper) else f"{joint.lower:g} to {joint.upper:g}"
        effort = "none" if math.isinf(joint.effort_limit) else f"{joint.effort_limit:g}"
        gains = [f"{value:g}" if value else "policy's" for value in (joint.stiffness, joint.damping)]
        damping = f"{own[joint.name]:g}" if joint.name in own else "none"
        start = f"{robot.initial_position[i]:g}"
        table.add_row(str(i), escape(joint.name), limits, effort, *gains, damping, start)
    console.print(table)
    base, height = robot.base, robot.base.height
    above = "its lowest part on the floor" if height is None else f"{height:g} m high"
    lines = {
        "model": str(robot.mjcf_path),
        "base": f"floating, body '{base.body}', starts with {above}" if robot.is_floating else "fixed",
        "IMU": imu_line(model, robot),
        "simulation": f"physics step {settings.physics_timestep:g} s, control at {settings.control_frequency:g} Hz, "
        f"the joints' own damping: {settings.joint_damping}",
    }
    scalar = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    passive = [model.joint(i).name for i in range(model.njnt) if int(model.jnt_type[i]) in scalar]
    passive = [name or "unnamed" for name in passive if name not in robot.joint_names]
    if passive:
        lines["passive joints"] = ", ".join(passive)
    unlimited = [joint.name for joint in robot.joints if math.isinf(joint.effort_limit)]
    if unlimited:
        lines["without effort limit"] = ", ".join(unlimited)
    if note := prefix_line(robot.mjcf_path):
        lines["names"] = note
    for name, text in lines.items():
        console.print(f"[bold]{name}[/bold]  {escape(text)}", soft_wrap=True)


def _write(robot: RobotDescription, model: mujoco.MjModel, mjcf: Path, output: Path) -> None:
    from humanoid_sim.files import whole_file  # noqa: PLC0415
    from humanoid_sim.robots.mjcf import imu_line  # noqa: PLC0415

    settings = robot.simulation
    text = f"""\
# {robot.name}: whatever is not given here is read from the MJCF. Lines that begin with # show what was read.
# To change a value, remove the mark from its line and from the heading above it; leave the others as they are.
# humanoid_sim/robots/schema.py explains every field.
name: {_text(robot.name)}
mjcf: {_text(os.path.relpath(mjcf.resolve(), output.resolve().parent))}
imu: {_text(robot.imu)}  # {imu_line(model, robot)}
# base: {{height: null}}  # m, of the base's origin at the start; null: its lowest part touches the floor
# simulation:
#   physics_timestep: {settings.physics_timestep:g}
#   control_frequency: {settings.control_frequency:g}
#   floor_height: {settings.floor_height:g}
#   joint_damping: {settings.joint_damping}  # of the joints in the MJCF itself: keep or drop
# initial_position:
"""
    starts = zip(robot.joint_names, robot.initial_position, strict=True)
    text += "".join(f"#   {_text(name)}: {value:.6g}\n" for name, value in starts)
    text += "# joints:  # K_p and K_d of 0 are the policy's\n"
    for joint in robot.joints:
        names = ("lower", "upper", "effort_limit", "stiffness", "damping")
        known = {name: getattr(joint, name) for name in names if math.isfinite(getattr(joint, name))}
        fields = ", ".join(f"{name}: {value:.6g}" for name, value in known.items())
        text += f"#   {_text(joint.name)}: {{{fields}}}\n"
    with whole_file(output) as file:
        file.write(text.encode())
    print(f"wrote {output}")


def _text(value: str) -> str:
    """As YAML has it: what is not a plain word in quotes."""
    is_plain = value.replace("_", "a").replace(".", "a").replace("/", "a").isalnum() and not value[0].isdigit()
    is_word = value.lower() not in ("null", "true", "false", "yes", "no", "on", "off", "y", "n")
    return value if is_plain and value.isascii() and is_word else json.dumps(value, ensure_ascii=False)


if __name__ == "__main__":
    sys.exit(run_program(main))
