"""Run, test and deploy humanoid policies: one control stack in MuJoCo, on emulated motors and on the robot."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from humanoid_sim.python_api import Diagnosis, Policy, Simulation, SuiteRun, diagnose, run_suite, simulate
    from humanoid_sim.recording.reader import Recording, open_recording
    from humanoid_sim.robots.description import load_robot

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
