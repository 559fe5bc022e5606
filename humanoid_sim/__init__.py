"""Run, test and deploy humanoid policies: one control stack in MuJoCo, on emulated motors and on the robot."""

import sys
from importlib import import_module
from types import TracebackType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from humanoid_sim.python_api import (
        Diagnosis,
        Policy,
        Recording,
        Simulation,
        SuiteRun,
        diagnose,
        load_robot,
        open_recording,
        run_suite,
        simulate,
    )


def _report_interruption(kind: type[BaseException], error: BaseException, traceback: TracebackType | None) -> None:
    from humanoid_sim.errors import was_interrupted  # noqa: PLC0415 - before it nothing is loaded

    if not was_interrupted(error):
        sys.__excepthook__(kind, error, traceback)
        return
    if sys.stderr is not None:
        print("interrupted", file=sys.stderr)
    sys.exit(130)  # 128 + SIGINT, as shells have it


if getattr(sys, "argv", [])[:1] == ["-m"]:  # what Python has there while it looks for `-m humanoid_sim.…`
    sys.excepthook = _report_interruption  # Ctrl-C while everything loads

__version__ = "0.1.0"

__all__ = [
    "Diagnosis",
    "Policy",
    "Recording",
    "Simulation",
    "SuiteRun",
    "diagnose",
    "load_robot",
    "open_recording",
    "run_suite",
    "simulate",
]


def __getattr__(name: str) -> Any:
    """Load the functions for notebooks and scripts when they are used first."""
    if name in __all__:
        return getattr(import_module("humanoid_sim.python_api"), name)
    raise AttributeError(f"module 'humanoid_sim' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
