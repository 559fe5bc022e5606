"""`python -m humanoid_sim.robot`: what is read of a robot, and an MJCF of a URDF."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.markup import escape

from humanoid_sim.cli import parse, run_program
from humanoid_sim.files import output_file, whole_file


@dataclass(frozen=True)
class Describe:
    """Show what is read of a robot: joints, limits, dynamics, the model's own actuators, IMU, base, rates."""

    robot: tyro.conf.Positional[str]
    """An MJCF, a robot's YAML file, a shipped robot, or robot_descriptions:NAME."""


@dataclass(frozen=True)
class Convert:
    """Make an MJCF of a URDF. MuJoCo alone would fix every robot's base to the world."""

    source: tyro.conf.Positional[Path]
    """A URDF."""
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
    options: Describe | Convert = parse(Describe | Convert, "robot", arguments)
    from humanoid_sim.policy_tools.show import make_console  # noqa: PLC0415 - heavy imports stay out of `--help`
    from humanoid_sim.robots import describe  # noqa: PLC0415
    from humanoid_sim.robots.description import load_robot  # noqa: PLC0415
    from humanoid_sim.robots.mjcf import bare_model  # noqa: PLC0415
    from humanoid_sim.robots.urdf import convert_urdf  # noqa: PLC0415

    if isinstance(options, Convert):
        output = options.source.with_suffix(".xml") if options.output is None else options.output
        output_file(output, "--output", ".xml", overwrite=options.overwrite)
        text = convert_urdf(options.source, options.base, output.resolve().parent, options.imu)
        with whole_file(output) as file:
            file.write(text.encode())
        print(f"wrote {output}, with the collision geometry alone; a URDF has no armature: complete it")
        for joint in load_robot(output).joints:
            bounds = {"range": joint.upper, "effort limit": joint.effort_limit}
            lacking = [what for what, bound in bounds.items() if math.isinf(bound)]
            if lacking:
                print(f"{joint.name} has no {' and no '.join(lacking)}")
        return 0
    robot = load_robot(options.robot)
    model, console = bare_model(robot), make_console()
    console.print(describe.joint_table(robot, model))
    if model.nu:
        console.print(describe.actuator_table(model))
    for name, text in describe.lines(robot, model).items():
        if text:
            console.print(f"[bold]{name}[/bold]  {escape(text)}", soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(run_program(main))
