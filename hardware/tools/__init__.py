"""`python -m humanoid_sim.hardware <tool>`: find, test, set up and calibrate motors, or emulate them.

A tool raises `InputError` for an option that it does not accept or a confirmation that was not given,
`SilentMotorError` where a motor does not answer, and `RobotError` where a channel cannot be used or a motor is not as
it must be.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from humanoid_sim.cli import ExitStatus, complain, parse
from humanoid_sim.hardware.tools import options


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `hardware` with command-line arguments; returns the exit status."""
    chosen = parse(options.TOOLS, "hardware", arguments)
    from humanoid_sim.hardware.tools.bench import SilentMotorError

    try:
        return _run(chosen)
    except SilentMotorError as error:
        complain(f"error: {error}")
        return ExitStatus.NO_ANSWER


def _run(chosen: Any) -> int:
    """Run the tool of these options, which is imported now: `--help` must be quick."""
    from humanoid_sim.hardware.tools import calibrate, discover, emulate, identify, only_motor, param

    match chosen:
        case options.Discover():
            return discover.discover(chosen)
        case options.Ping():
            return param.ping(chosen)
        case options.Param():
            return param.param(chosen.command)
        case options.Identify():
            return identify.identify(chosen)
        case options.Calibrate():
            return calibrate.calibrate(chosen)
        case options.SetId():
            return only_motor.set_id(chosen)
        case options.SetZero():
            return only_motor.set_zero(chosen)
    return emulate.emulate(chosen)
