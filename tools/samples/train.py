"""Train the sample policy from nothing: random motions and poses, statics, closed loop, export."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.training.ppo.export import require_same_answers
from tools.samples import TrainSampleConfig
from tools.samples.arm import ArmModel
from tools.samples.closed_loop import ClosedLoop, train_closed_loop
from tools.samples.export import export_policy, sample_contract
from tools.samples.random_motions import random_motions
from tools.samples.statics import PoseBatches, tensor, train_statics
from tools.samples.student import ArmNetwork, Student
from tools.samples.teacher import training_motions, training_poses

__all__ = ["train_sample"]


def train_sample(config: TrainSampleConfig) -> int:
    """Run the whole training; returns the exit status.

    Raises `InputError` if an option is out of range, or the output cannot be written.
    """
    path = Path(config.output)
    _check(config, path)
    if config.quick:
        config = replace(config, motions=8, poses=500, static_steps=20, loop_steps=4, arms=32)
    torch.manual_seed(config.seed)
    torch.set_num_threads(config.threads)
    description = load_robot("lite")
    console = Console()
    with _progress(console) as progress:
        network = _train(config, ArmModel(description), progress)
    _export(path, description, network)
    console.print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")
    return 0


def _check(config: TrainSampleConfig, path: Path) -> None:
    """Find out before the training what would stop it at its end."""
    for name in ("motions", "poses", "static_steps", "loop_steps", "arms", "threads"):
        if getattr(config, name) < 1:
            raise InputError(f"--{name.replace('_', '-')}: is {getattr(config, name)}, expected at least 1")
    if config.seed < 0:
        raise InputError(f"--seed: is {config.seed}, expected at least 0")
    output_file(path, "--output")


def _train(config: TrainSampleConfig, arm: ArmModel, progress: Progress) -> ArmNetwork:
    rng = np.random.default_rng(config.seed)
    generator = torch.Generator().manual_seed(config.seed)

    advance = _task(progress, "motions", config.motions)
    paths = []
    for path in islice(random_motions(arm, rng), config.motions):
        paths.append(path)
        advance(len(paths), float("nan"))
    motions = training_motions(arm, paths, rng)
    advance = _task(progress, "poses", 1)
    poses = training_poses(arm, config.poses, rng)
    advance(1, float("nan"))

    default = tensor(arm.home)
    network = ArmNetwork(arm.shoulder)
    batches = PoseBatches(poses, default, generator)
    train_statics(network, batches, config.static_steps, report=_task(progress, "statics", config.static_steps))
    loop = ClosedLoop(motions, default, config.arms, generator)
    report = _task(progress, "closed loop", config.loop_steps)
    train_closed_loop(network, loop, batches, config.loop_steps, report=report)
    return network


def _export(path: Path, description: RobotDescription, network: ArmNetwork) -> None:
    """Write the checkpoint and compare it, as ONNX Runtime runs it, with the network that was trained."""
    weights = {name: value.detach().numpy() for name, value in network.named_parameters()}
    export_policy(path, weights, network.origin.numpy(), sample_contract(description))
    observations = torch.randn(16, 78)
    with torch.no_grad():
        expected = Student(network)(observations).numpy()
    require_same_answers(load_checkpoint(path), observations.numpy(), expected)


def _progress(console: Console) -> Progress:
    columns = (
        TextColumn("{task.description:<12}"),
        BarColumn(),
        TextColumn("{task.completed:>6.0f}/{task.total:.0f}"),
        TextColumn("{task.fields[cost]:<12}"),
        TimeElapsedColumn(),
    )
    return Progress(*columns, console=console)


def _task(progress: Progress, name: str, total: int) -> Callable[[int, float], None]:
    """Return a report function that moves a new bar."""
    task = progress.add_task(name, total=total, cost="")

    def report(done: int, cost: float) -> None:
        progress.update(task, completed=done, cost="" if np.isnan(cost) else f"cost {cost:.4f}")

    return report
