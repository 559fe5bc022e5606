"""`python -m humanoid_sim.hardware <tool>`: find, test, set up and calibrate motors, or emulate them.

A tool raises `InputError` for an option that it does not accept or a confirmation that was not given,
`SilentMotorError` where a motor does not answer, and `RobotError` where a channel cannot be used or a motor is not as
it must be.
"""

from __future__ import annotations

from collections.abc import Sequence

from humanoid_sim.cli import ExitStatus, complain, parse
from humanoid_sim.hardware.tools import options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `hardware` with command-line arguments; returns the exit status."""
    chosen = parse(options.TOOLS, "hardware", arguments)
    from humanoid_sim.hardware.tools import bench, calibrate, emulate, identify, robstride  # `--help` must be quick

    try:
        match chosen:
            case options.Discover():
                return robstride.discover(chosen)
            case options.Ping():
                return robstride.ping(chosen)
            case options.Param():
                return robstride.param(chosen)
            case options.SetId():
                return robstride.set_id(chosen)
            case options.SetZero():
                return robstride.set_zero(chosen)
            case options.Identify():
                return identify.identify(chosen)
            case options.Calibrate():
                return calibrate.calibrate(chosen)
        return emulate.emulate(chosen)
    except bench.SilentMotorError as error:
        complain(f"error: {error}")
        return ExitStatus.NO_ANSWER
