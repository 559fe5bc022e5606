"""`python -m humanoid_sim.hardware <tool>`: find, test, set up and calibrate motors, or emulate them.

A tool raises `InputError` for an option that it does not accept or a confirmation that was not given,
`SilentMotorError` where a motor does not answer, and `RobotError` where a channel cannot be used or a motor is not as
it must be.
"""

# ruff: noqa: PLC0415 - `--help` must be quick, and no tool imports what another one needs

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from humanoid_sim.cli import ExitStatus, complain

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `hardware` with command-line arguments; returns the exit status."""
    from humanoid_sim.cli import parse
    from humanoid_sim.hardware.tools.options import TOOLS

    options: Any = parse(TOOLS, "hardware", arguments)
    from humanoid_sim.hardware.tools.bench import SilentMotorError

    try:
        return _run(options)
    except SilentMotorError as error:
        complain(f"error: {error}")
        return ExitStatus.NO_ANSWER


def _run(options: Any) -> int:  # noqa: PLR0911 - one for each tool
    from humanoid_sim.hardware.tools import options as tool

    match options:
        case tool.Discover():
            from humanoid_sim.hardware.tools.discover import discover

            return discover(options)
        case tool.Ping():
            from humanoid_sim.hardware.tools.param import ping

            return ping(options)
        case tool.Param():
            from humanoid_sim.hardware.tools.param import param

            return param(options)
        case tool.Identify():
            from humanoid_sim.hardware.tools.identify import identify

            return identify(options)
        case tool.Calibrate():
            from humanoid_sim.hardware.tools.calibrate import calibrate

            return calibrate(options)
        case tool.SetId():
            from humanoid_sim.hardware.tools.only_motor import set_id

            return set_id(options)
        case tool.SetZero():
            from humanoid_sim.hardware.tools.only_motor import set_zero

            return set_zero(options)
        case _:
            from humanoid_sim.hardware.tools.emulate import emulate

            return emulate(options)
