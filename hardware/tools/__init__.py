"""`python -m humanoid_sim.hardware <tool>`: tools for the bench.

Each raises `InputError` for an option that it does not accept or a confirmation that was not given, `SilentMotorError`
where a motor does not answer, and `RobotError` where a channel cannot be used or a motor is not as it must be.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Sequence
from typing import Any

from humanoid_sim.cli import ExitStatus, complain

__all__ = ["main"]

_MODULES = {"set_id": "only_motor", "set_zero": "only_motor"}
"""By function, where its name is not the module's."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `hardware` with command-line arguments; returns the exit status."""
    from humanoid_sim.cli import parse  # noqa: PLC0415 - heavy imports stay out of importing this package
    from humanoid_sim.hardware.tools.options import TOOLS  # noqa: PLC0415

    options: Any = parse(TOOLS, "hardware", arguments)
    from humanoid_sim.hardware.tools.bench import SilentMotorError  # noqa: PLC0415

    # The options of `set-id` are `SetId`, its function is `set_id`, in a module of that name but for some.
    name = re.sub(r"(?<!^)(?=[A-Z])", "_", type(options).__name__).lower()
    tool: Callable[[Any], int] = getattr(importlib.import_module(f"{__name__}.{_MODULES.get(name, name)}"), name)
    try:
        return tool(options)
    except SilentMotorError as error:
        complain(f"error: {error}")
        return ExitStatus.NO_ANSWER
