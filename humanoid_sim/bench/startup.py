"""How long a program takes to answer `--help`."""

from __future__ import annotations

import subprocess
import sys

from humanoid_sim.bench.timing import Row, paired_ratio

__all__ = ["help_start"]


def help_start(repetitions: int) -> list[Row]:
    """`play --help` over an interpreter that does nothing."""

    def run(*arguments: str) -> None:
        subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)

    def describe(ours: float, bare: float) -> str:
        return f"{1e3 * ours:.0f} ms, {1e3 * bare:.0f} ms for python -c pass"

    return [
        paired_ratio(
            "play --help",
            lambda: run("-m", "humanoid_sim.play", "--help"),
            lambda: run("-c", "pass"),
            repetitions,
            15.0,
            describe,
        )
    ]
