"""Motors on a CAN bus: protocol, bus, robot adapter, emulated motors and bench tools.

As a program, `python -m humanoid_sim.hardware`, it finds, tests, sets up and calibrates motors, or emulates them.
"""

from __future__ import annotations

from collections.abc import Sequence

if __name__ != "humanoid_sim.hardware":
    raise ImportError("import this package as 'humanoid_sim.hardware', not as 'hardware'")

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `hardware` with command-line arguments; returns the exit status."""
    from humanoid_sim.hardware.tools import main as program  # noqa: PLC0415 - importing the package must stay quick

    return program(arguments)
