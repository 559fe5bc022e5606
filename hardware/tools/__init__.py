"""`python -m humanoid_sim.hardware <tool>`: tools for the bench."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Sequence
from typing import Any

from humanoid_sim.cli import ExitStatus, complain

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `hardware` with command-line arguments; returns the exit status."""
    import tyro  # noqa: PLC0415 - heavy imports stay out of importing this package

    from humanoid_sim.hardware.tools.options import Tool  # noqa: PLC0415

    options: Any = tyro.cli(
        Tool,
        prog="humanoid_sim.hardware",
        description="Find, test, set up and calibrate motors on a CAN bus, or emulate them.",
        args=arguments,
        config=(tyro.conf.OmitSubcommandPrefixes,),
    )
    from humanoid_sim.hardware.tools.bench import SilentMotorError  # noqa: PLC0415

    # The options of `bring-up` are `BringUp`, its module and function are `bring_up`.
    name = re.sub(r"(?<!^)(?=[A-Z])", "_", type(options).__name__).lower()
    tool: Callable[[Any], int] = getattr(importlib.import_module(f"{__name__}.{name}"), name)
    try:
        return tool(options)
    except SilentMotorError as error:
        complain(f"error: {error}")
        return ExitStatus.NO_ANSWER
