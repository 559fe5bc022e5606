"""`python -m humanoid_sim.hardware discover|ping|param|calibrate|identify|budget|emulate`: tools for the bench."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import Any

from humanoid_sim.cli import ExitStatus, complain

__all__ = ["main"]

_TOOLS = {
    "Discover": "humanoid_sim.hardware.tools.discover:discover",
    "Ping": "humanoid_sim.hardware.tools.ping:ping",
    "Param": "humanoid_sim.hardware.tools.param:param",
    "Calibrate": "humanoid_sim.hardware.tools.calibrate:calibrate",
    "Identify": "humanoid_sim.hardware.tools.identify:identify",
    "Budget": "humanoid_sim.hardware.tools.budget:budget",
    "Emulate": "humanoid_sim.hardware.tools.emulate:emulate",
}
"""What carries out which options; imported when it is needed."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `hardware` with command-line arguments; returns the exit status."""
    import tyro  # noqa: PLC0415 - heavy imports stay out of importing this package

    from humanoid_sim.hardware.tools.options import (  # noqa: PLC0415
        Budget,
        Calibrate,
        Discover,
        Emulate,
        Identify,
        Param,
        Ping,
    )

    options: Any = tyro.cli(
        Discover | Ping | Param | Calibrate | Identify | Budget | Emulate,
        prog="humanoid_sim.hardware",
        description="Find, test, set up and calibrate motors on a CAN bus, or emulate them.",
        args=arguments,
        config=(tyro.conf.OmitSubcommandPrefixes,),
    )
    from humanoid_sim.hardware.tools.bench import SilentMotorError  # noqa: PLC0415

    module, _, name = _TOOLS[type(options).__name__].partition(":")
    tool: Callable[[Any], int] = getattr(importlib.import_module(module), name)
    try:
        return tool(options)
    except SilentMotorError as error:
        complain(f"error: {error}")
        return ExitStatus.NO_ANSWER
