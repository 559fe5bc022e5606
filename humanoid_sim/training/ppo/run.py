"""`train`: check, learn, export, measure."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file
from humanoid_sim.training.ppo.finish import export, measure
from humanoid_sim.training.ppo.folder import RunFolder
from humanoid_sim.training.ppo.journal import PROGRESS, Journal, Update, read_progress
from humanoid_sim.training.ppo.learner import Learner, learner_class
from humanoid_sim.training.ppo.meter import EpisodeMeter
from humanoid_sim.training.ppo.options import TrainConfig
from humanoid_sim.training.ppo.settings import SETTINGS, first_spread
from humanoid_sim.training.ppo.subject import Subject, subject_of
from humanoid_sim.training.ppo.videos import Videos

__all__ = ["seed_of", "train"]


def train(config: TrainConfig) -> int:
    """Run the whole training; returns the exit status.

    Raises:
        InputError: an option is out of range or does not fit the others, or an output cannot be written.
    """
    _check(config)
    subject = subject_of(config)
    kind = learner_class(config.algorithm)
    name = f"{subject.scenario.description.name}-{subject.task}-{config.algorithm}"
    path = Path(config.folder or f"runs/train/{name}")
    told = {"task": subject.task, "contract": subject.source, "motion": subject.motion}
    folder = RunFolder(path, config, told, SETTINGS, kind.SUFFIX)
    output = output_file(Path(config.output) if config.output else path / "policy.onnx", "--output", ".onnx")
    _use_threads(config.threads)
    learner = _learn(config, subject, folder, kind)
    try:
        export(subject, learner, output)
        print(f"{output}: {output.stat().st_size / 1e6:.2f} MB, contract and golden vectors inside")
    finally:
        learner.close()
    if config.regress:
        measure(subject, output, path)
    return 0


def _check(config: TrainConfig) -> None:
    for name in ("steps", "robots", "threads"):
        if getattr(config, name) < 1:
            raise InputError(f"--{name}: is {getattr(config, name)}, expected at least 1")
    if config.seed < 0:
        raise InputError(f"--seed: is {config.seed}, expected at least 0")
    for name in ("minutes", "checkpoint_seconds", "video_minutes"):
        value = getattr(config, name)
        if value is not None and not 0.0 < value < float("inf"):
            raise InputError(f"--{name.replace('_', '-')}: is {value:g}, expected a number > 0")
    if config.output is not None:
        output_file(Path(config.output), "--output", ".onnx")


def _use_threads(count: int) -> None:
    import torch  # noqa: PLC0415 - after the learner's class, which says what to install

    torch.set_num_threads(count)


def seed_of(seed: int, updates: int) -> int:
    """Of networks, actions and environments: a training that goes on after some updates does not begin again alike."""
    return seed if updates == 0 else int(np.random.SeedSequence([seed, updates]).generate_state(1)[0])


def _show(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _learn(config: TrainConfig, subject: Subject, folder: RunFolder, kind: type[Learner]) -> Learner:
    """Train to the end, or until the time is up."""
    meter = EpisodeMeter(subject.environments(config.robots))
    start = folder.start
    spread = first_spread(subject.contract, is_floating=subject.scenario.description.is_floating)
    updates = len(read_progress(folder.path / PROGRESS)) if start is not None else 0
    learner = kind(meter, SETTINGS, spread, seed_of(config.seed, updates), start)
    done = learner.steps
    if start is not None:
        _show(f"goes on after {done} steps")
    journal = Journal(folder.path, config.steps, meter, _show, done=done, tensorboard=config.tensorboard)
    videos = Videos(subject, folder.path, config.video_minutes)
    after_update = _AfterUpdate(config, folder, learner, journal, videos)
    try:
        if done < config.steps:
            learner.learn(config.steps, after_update)
            folder.save(learner.save)
    except BaseException:
        learner.close()
        raise
    finally:
        journal.close()
        videos.close()
    return learner


class _AfterUpdate:
    """Writes down, saves and shows, and says whether to go on."""

    def __init__(
        self, config: TrainConfig, folder: RunFolder, learner: Learner, journal: Journal, videos: Videos
    ) -> None:
        self._config, self._folder, self._learner = config, folder, learner
        self._journal, self._videos = journal, videos
        self._saved = time.monotonic()

    def __call__(self, update: Update) -> bool:
        self._journal.record(update)
        if not np.isfinite(update.spread):
            raise InputError(
                f"the network is no longer finite after {update.steps} steps; the checkpoint before still is"
            )
        if time.monotonic() - self._saved >= self._config.checkpoint_seconds:
            self._folder.save(self._learner.save)
            self._saved = time.monotonic()
        self._videos.show(self._learner, update.steps)
        limit: float = float("inf") if self._config.minutes is None else 60.0 * self._config.minutes
        return self._journal.seconds < limit
