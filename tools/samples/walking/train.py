"""Train the walking policy from nothing: all stages, export, golden vectors, and its figures."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.envs.scenario import make_scenario
from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.readers.contract_yaml import read_contract_file
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.robots.description import load_robot
from humanoid_sim.training.ppo.export import require_same_answers
from tools.samples import TrainWalkingConfig
from tools.samples.walking.aim import Aim, aim_from, measure_response
from tools.samples.walking.export import export_walking
from tools.samples.walking.gait import (
    COMMAND,
    MOST,
    OBSERVATIONS,
    awake,
    from_canonical,
    gait,
    network_input,
    to_canonical,
)
from tools.samples.walking.learning import learn, network_weights
from tools.samples.walking.learning_env import PRIVILEGED
from tools.samples.walking.stages import CONTRACT, QUICK, STAGES

__all__ = ["export_aimed", "train_walking", "walking_contract"]


def walking_contract() -> PolicyContract:
    """Return the contract that the policy is trained under."""
    return merge(read_contract_file(CONTRACT), str(CONTRACT), load_robot("lite_biped").joint_names)


def export_aimed(output: Path, weights: Mapping[str, npt.NDArray[np.float32]]) -> Aim:
    """Write the checkpoint, measure how it answers to commands, and write it again with what it has to be told."""
    contract = walking_contract()
    export_walking(output, weights, contract)
    scenario = make_scenario(load_checkpoint(output, CONTRACT), "lite_biped", task="velocity")
    assert contract.command_ranges is not None
    aim = aim_from(measure_response(scenario, output), contract.command_ranges)
    export_walking(output, weights, contract, aim)
    return aim


def train_walking(config: TrainWalkingConfig) -> int:
    """Run all stages and write the checkpoint, not yet stamped; returns the exit status.

    Raises `InputError` if an option is out of range, or an output cannot be written.
    """
    output, folder = Path(config.output), Path(config.folder)
    output_file(output, "--output", ".onnx")
    if config.seed < 0:
        raise InputError(f"--seed: is {config.seed}, expected at least 0")
    if config.threads < 1:
        raise InputError(f"--threads: is {config.threads}, expected at least 1")
    torch.set_num_threads(config.threads)
    stages = QUICK if config.quick else STAGES

    def show(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    model = learn(stages, folder, config.seed, show, resume=config.resume)
    aim = export_aimed(output, network_weights(model))
    observations = np.random.default_rng(0).normal(size=(16, OBSERVATIONS)).astype(np.float32)
    told = observations.copy()
    told[:, COMMAND : COMMAND + 3] = aim.told(observations[:, COMMAND : COMMAND + 3].astype(np.float64))
    seen, mirrored = to_canonical(awake(told))
    padded = np.concatenate([network_input(seen), np.zeros((len(seen), PRIVILEGED), dtype=np.float32)], axis=1)
    added, _ = model.predict(padded, deterministic=True)
    expected = from_canonical(gait(seen, np.clip(added, -MOST, MOST)), mirrored)
    require_same_answers(load_checkpoint(output, CONTRACT), observations, expected)
    print(f"{output}: {output.stat().st_size / 1e6:.2f} MB")
    return 0
