"""The end of a run of `train`: how good the policy is."""

from __future__ import annotations

import sys
from pathlib import Path

from humanoid_sim.errors import InputError
from humanoid_sim.regress.options import RegressConfig
from humanoid_sim.regress.run import regress
from humanoid_sim.training.ppo.subject import Subject

__all__ = ["SUITES", "measure"]

SUITES = {"tracking": "lite_tracking", "velocity": "velocity", "walking": "velocity", "piano": "lite_piano"}
"""The shipped suite of `regress` for a task."""


def measure(subject: Subject, policy: Path, folder: Path) -> None:
    """Run the suite for the task, and leave its figures in `regress.json`."""
    suite = SUITES.get(subject.task)
    if suite is None:
        print(f"regress: no suite ships for the task {subject.task}", file=sys.stderr)
        return
    config = RegressConfig(
        policies=(str(policy),), suite=suite, robot=subject.robot, json=folder / "regress.json", overwrite=True
    )
    try:
        regress(config)
    except InputError as error:  # the policy is there; a suite of another robot does not undo it
        print(f"regress: the suite {suite} does not fit: {error}", file=sys.stderr)
