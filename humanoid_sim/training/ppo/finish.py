"""The end of a run of `train`: how good the policy is."""

from __future__ import annotations

import sys
from pathlib import Path

from humanoid_sim.errors import InputError
from humanoid_sim.regress.options import RegressConfig
from humanoid_sim.regress.run import regress
from humanoid_sim.regress.suite_file import SUITE_OF, load_suite
from humanoid_sim.training.ppo.subject import Subject

__all__ = ["measure"]


def measure(subject: Subject, policy: Path, folder: Path) -> bool:
    """Run the suite for the task, and leave its figures in `regress.json`; False where Ctrl-C left that out."""
    name = SUITE_OF.get(subject.task)
    if name is None:
        print(f"regress: no suite ships for the task {subject.task}", file=sys.stderr)
        return True
    suite, _ = load_suite(name)
    episodes = len(suite.cases) * len(suite.seed_numbers)
    print(f"measuring with the suite {name}: {episodes} episodes; Ctrl-C leaves it out", file=sys.stderr, flush=True)
    config = RegressConfig(
        policies=(str(policy),), suite=name, robot=subject.robot, json=folder / "regress.json", overwrite=True
    )
    try:
        regress(config)
    except InputError as error:  # the policy is there; a suite of another robot does not undo it
        print(f"regress: the suite {name} does not fit: {error}", file=sys.stderr)
    except KeyboardInterrupt:
        print(f"regress: left out; {policy} is whole", file=sys.stderr)
        return False
    return True
