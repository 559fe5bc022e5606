"""`python -m humanoid_sim.hardware <tool>`: find, test, set up and calibrate motors, or emulate them.

A tool raises `InputError` for an option that it does not accept or a confirmation that was not given,
`SilentMotorError` where a motor does not answer, and `RobotError` where a channel cannot be used or a motor is not as
it must be.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from humanoid_sim.cli import ExitStatus, complain, parse
from humanoid_sim.hardware.tools import options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `hardware` with command-line arguments; returns the exit status."""
    chosen = parse(options.TOOLS, "hardware", arguments)
    from humanoid_sim.hardware.tools import bench, calibrate, emulate, identify, robstride  # `--help` must be quick

    tools: dict[type, Callable[[Any], int]] = {
        options.Discover: robstride.discover,
        options.Ping: robstride.ping,
        options.Param: robstride.param,
        options.SetId: robstride.set_id,
        options.SetZero: robstride.set_zero,
        options.Identify: identify.identify,
        options.Calibrate: calibrate.calibrate,
        options.Emulate: emulate.emulate,
    }
    try:
        return tools[type(chosen)](chosen)
    except bench.SilentMotorError as error:
        complain(f"error: {error}")
        return ExitStatus.NO_ANSWER
