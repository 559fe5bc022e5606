"""`python -m humanoid_sim.hardware <tool>`: find, test, set up and calibrate motors, or emulate them.

A tool raises `InputError` for an option that it does not accept or a confirmation that was not given,
`SilentMotorError` where a motor does not answer, and `RobotError` where a channel cannot be used or a motor is not as
it must be.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from humanoid_sim.cli import ExitStatus, complain

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `hardware` with command-line arguments; returns the exit status."""
    from humanoid_sim.cli import parse
    from humanoid_sim.hardware.tools.options import TOOLS

    chosen = parse(TOOLS, "hardware", arguments)
    from humanoid_sim.hardware.tools.bench import SilentMotorError

    try:
        return _run(chosen)
    except SilentMotorError as error:
        complain(f"error: {error}")
        return ExitStatus.NO_ANSWER


def _run(chosen: Any) -> int:
    """Run the tool of these options, which is imported now: `--help` must be quick."""
    from humanoid_sim.hardware.tools import options

    match chosen:
        case options.Discover():
            from humanoid_sim.hardware.tools.discover import discover

            return discover(chosen)
        case options.Ping():
            from humanoid_sim.hardware.tools.param import ping

            return ping(chosen)
        case options.Param():
            from humanoid_sim.hardware.tools.param import param

            return param(chosen)
        case options.Identify():
            from humanoid_sim.hardware.tools.identify import identify

            return identify(chosen)
        case options.Calibrate():
            from humanoid_sim.hardware.tools.calibrate import calibrate

            return calibrate(chosen)
        case options.SetId():
            from humanoid_sim.hardware.tools.only_motor import set_id

            return set_id(chosen)
        case options.SetZero():
            from humanoid_sim.hardware.tools.only_motor import set_zero

            return set_zero(chosen)
        case options.Emulate():
            from humanoid_sim.hardware.tools.emulate import emulate

            return emulate(chosen)
    raise AssertionError(chosen)
