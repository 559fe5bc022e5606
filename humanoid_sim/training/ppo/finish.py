"""The end of a run of `train`: the policy as a checkpoint that needs no other file, and how good it is."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy_tools.stamp import stamp
from humanoid_sim.regress.options import RegressConfig
from humanoid_sim.regress.run import regress
from humanoid_sim.training.export_check import require_same_answers
from humanoid_sim.training.ppo.learner import Learner
from humanoid_sim.training.ppo.network import write_network
from humanoid_sim.training.ppo.subject import Subject
from humanoid_sim.training.ppo.trace import training_run

__all__ = ["SUITES", "export", "measure"]

SUITES = {"tracking": "lite_tracking", "velocity": "velocity", "walking": "velocity", "piano": "lite_piano"}
"""The shipped suite of `regress` for a task."""
_PROBES = 64


def export(subject: Subject, learner: Learner, output: Path) -> None:
    """Write the policy, its contract and golden vectors of a run in which the library itself answered.

    Raises:
        InputError: the file cannot be written.
    """
    network, contract = learner.network(), subject.contract
    with tempfile.TemporaryDirectory() as folder:
        plain, trace = Path(folder) / "plain.onnx", Path(folder) / f"{output.stem}.npz"
        write_network(plain, network, contract, output.stem)
        probes = np.random.default_rng(0).normal(size=(_PROBES, len(network.mean))) * network.deviation + network.mean
        observations = probes.astype(np.float32)
        require_same_answers(load_checkpoint(plain), observations, learner.answer(observations))
        if contract.live_inputs:  # nobody here can make them: no golden vectors
            stamp(plain, output, overwrite=True)
            return
        np.savez_compressed(trace, **training_run(subject, learner, seed=0))  # type: ignore[arg-type]
        motion = subject.motion_file(Path(folder))
        stamp(plain, output, description=subject.scenario.description, trace=trace, motion=motion, overwrite=True)


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
