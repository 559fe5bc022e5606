"""`python -m humanoid_sim.hardware <tool>`: find, test, set up and calibrate motors, or emulate them.

A tool raises `InputError` for an option that it does not accept or a confirmation that was not given,
`SilentMotorError` where a motor does not answer, and `RobotError` where a channel cannot be used or a motor is not as
it must be.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

from humanoid_sim.cli import ExitStatus, complain

__all__ = ["main"]

_FUNCTIONS = {
    "Discover": "discover.discover",
    "Ping": "param.ping",
    "Param": "param.param",
    "Identify": "identify.identify",
    "Calibrate": "calibrate.calibrate",
    "SetId": "only_motor.set_id",
    "SetZero": "only_motor.set_zero",
    "Emulate": "emulate.emulate",
}
"""Module and function of each class of options, imported when it is used: `--help` must be quick."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `hardware` with command-line arguments; returns the exit status."""
    from humanoid_sim.cli import parse  # noqa: PLC0415
    from humanoid_sim.hardware.tools.options import TOOLS  # noqa: PLC0415

    options: Any = parse(TOOLS, "hardware", arguments)
    module, _, name = _FUNCTIONS[type(options).__name__].partition(".")
    from humanoid_sim.hardware.tools.bench import SilentMotorError  # noqa: PLC0415

    try:
        status: int = getattr(importlib.import_module(f"{__name__}.{module}"), name)(options)
    except SilentMotorError as error:
        complain(f"error: {error}")
        return ExitStatus.NO_ANSWER
    return status
