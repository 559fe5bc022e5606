"""`python -m humanoid_sim.policy show|check|stamp|doctor`: look into a checkpoint, check it, complete it."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Sequence
from typing import assert_never

from humanoid_sim.errors import InputError

__all__ = ["main"]

_DOCTOR = "doctor"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `policy` with command-line arguments; returns the exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words and words[0] == _DOCTOR:
        # A program of its own, with its own options.
        doctor: Callable[[Sequence[str]], int] = importlib.import_module("humanoid_sim.doctor").main
        return doctor(words[1:])
    import tyro  # noqa: PLC0415 - heavy imports stay out of importing this package

    from humanoid_sim.policy.cli.options import Check, Doctor, Show, Stamp  # noqa: PLC0415

    command: Show | Check | Stamp | Doctor = tyro.cli(
        Show | Check | Stamp | Doctor,
        prog="humanoid_sim.policy",
        description="Look into a checkpoint, check it against a robot, complete it, or find out what is wrong with it.",
        args=words,
    )
    from humanoid_sim.policy.onnx_model import has_onnxruntime  # noqa: PLC0415

    if not has_onnxruntime():
        raise InputError("policy: needs onnxruntime, which cannot be imported: pip install onnxruntime")
    match command:
        case Show():
            from humanoid_sim.policy.cli.show import show  # noqa: PLC0415

            return show(command)
        case Check():
            from humanoid_sim.policy.cli.check import check  # noqa: PLC0415

            return check(command)
        case Stamp():
            from humanoid_sim.policy.cli.stamp import stamp_copy  # noqa: PLC0415

            return stamp_copy(command)
        case Doctor():  # only its line of help is here: `doctor` was handled above
            raise AssertionError(_DOCTOR)
        case _:
            assert_never(command)
