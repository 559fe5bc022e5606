"""`train`: check, learn, export, measure."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from humanoid_sim.cli import ExitStatus
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file
from humanoid_sim.training.ppo.export import export
from humanoid_sim.training.ppo.finish import measure
from humanoid_sim.training.ppo.folder import RunFolder
from humanoid_sim.training.ppo.interruption import Interruption
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
    folder = RunFolder(path, config, {**subject.told, "curriculum_steps": _horizon(config)}, SETTINGS, kind.SUFFIX)
    output = output_file(Path(config.output) if config.output else path / "policy.onnx", "--output", ".onnx")
    _require_time(config, folder, output)
    _use_threads(config.threads)
    learner, is_interrupted = _learn(config, subject, folder, kind)
    try:
        if is_interrupted:
            _show(f"interrupted after {learner.steps} steps, saved in {path}; the same command with --resume goes on")
            return ExitStatus.INTERRUPTED
        export(learner.model, learner.envs, output)
        print(f"{output}: {output.stat().st_size / 1e6:.2f} MB, contract and golden vectors inside")
    finally:
        learner.close()
    if config.regress and not measure(subject, output, path):
        return ExitStatus.INTERRUPTED
    return 0


def _check(config: TrainConfig) -> None:
    for name in ("steps", "robots", "threads", "curriculum_steps"):
        count = getattr(config, name)
        if count is not None and count < 1:
            raise InputError(f"--{name.replace('_', '-')}: is {count}, expected at least 1")
    if config.curriculum_steps is not None and config.curriculum is None:
        raise InputError(f"--curriculum-steps: is {config.curriculum_steps} without --curriculum, expected both")
    if config.seed < 0:
        raise InputError(f"--seed: is {config.seed}, expected at least 0")
    for name in ("minutes", "checkpoint_seconds", "video_minutes"):
        value = getattr(config, name)
        if value is not None and not 0.0 < value < float("inf"):
            raise InputError(f"--{name.replace('_', '-')}: is {value:g}, expected a number > 0")
    if config.output is not None:
        output_file(Path(config.output), "--output", ".onnx")


def _require_time(config: TrainConfig, folder: RunFolder, output: Path) -> None:
    """Refuse to go on with a run whose time is up; one that was killed before it wrote its policy still writes it."""
    used, steps = _used(folder)
    if used >= _limit(config) and steps < config.steps and output.exists():
        raise InputError(
            f"--resume: the folder already has {used / 60.0:.1f} of --minutes {config.minutes:g}; give a larger "
            "--minutes (earlier runs count)"
        )


def _used(folder: RunFolder) -> tuple[float, float]:
    """S of training, and policy steps, of a folder's earlier runs."""
    rows = read_progress(folder.path / PROGRESS) if folder.start is not None else []
    return (rows[-1]["seconds"], rows[-1]["steps"]) if rows else (0.0, 0.0)


def _limit(config: TrainConfig) -> float:
    """S of training after which it ends."""
    return float("inf") if config.minutes is None else 60.0 * config.minutes


def _horizon(config: TrainConfig) -> int | None:
    """Policy steps at which a new run's curriculum has come to its end; None: what the run has that is resumed."""
    usual = None if config.resume or config.curriculum is None else config.steps
    return config.curriculum_steps or usual


def _use_threads(count: int) -> None:
    import torch  # noqa: PLC0415 - after the learner's class, which says what to install

    torch.set_num_threads(count)


def seed_of(seed: int, updates: int) -> int:
    """Of networks, actions and environments: a training that goes on after some updates does not begin again alike."""
    return seed if updates == 0 else int(np.random.SeedSequence([seed, updates]).generate_state(1)[0])


def _show(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _learn(config: TrainConfig, subject: Subject, folder: RunFolder, kind: type[Learner]) -> tuple[Learner, bool]:
    """Train to the end, until the time is up, or until Ctrl-C, which is told."""
    _show(f"making {config.robots} robots {subject.scenario.description.name} for the task {subject.task} …")
    envs = subject.environments(config.robots)
    meter = EpisodeMeter(envs)
    start = folder.start
    spread = first_spread(subject.contract, is_floating=subject.scenario.description.is_floating)
    updates = len(read_progress(folder.path / PROGRESS)) if start is not None else 0
    learner = kind(meter, SETTINGS, spread, seed_of(config.seed, updates), start)
    done = learner.steps
    if start is not None:
        _show(f"goes on after {done} steps")
    limit, tensorboard = _limit(config), config.tensorboard
    journal = Journal(folder.path, config.steps, meter, _show, done=done, limit=limit, tensorboard=tensorboard)
    videos = Videos(subject, folder.path, config.video_minutes)
    interruption = Interruption()
    after_update = _AfterUpdate(config, folder, learner, envs, journal, videos, interruption)
    try:
        if done < config.steps and _used(folder)[0] < _limit(config):
            after_update.set_progress(done)
            with interruption:
                learner.learn(config.steps, after_update)
                folder.save(learner.save)
    except BaseException:
        videos.abandon()
        learner.close()
        raise
    finally:
        journal.close()
        videos.close()
    return learner, interruption.is_asked_for


class _AfterUpdate:
    """Writes down, saves and shows, and says whether to go on."""

    def __init__(
        self,
        config: TrainConfig,
        folder: RunFolder,
        learner: Learner,
        envs: PolicyVectorEnv,
        journal: Journal,
        videos: Videos,
        interruption: Interruption,
    ) -> None:
        self._config, self._folder, self._learner, self._envs = config, folder, learner, envs
        self._journal, self._videos, self._interruption = journal, videos, interruption
        self._saved = time.monotonic()

    def set_progress(self, steps: int) -> None:
        """Tell the environments how far the curriculum has come, for the episodes that begin from then on."""
        horizon = self._folder.curriculum_steps
        if horizon is not None:
            self._envs.progress = min(steps / horizon, 1.0)

    def __call__(self, update: Update) -> bool:
        self._journal.record(update)
        self.set_progress(update.steps)
        if not np.isfinite(update.spread):
            raise InputError(
                f"the network is no longer finite after {update.steps} steps; the checkpoint before still is"
            )
        if self._interruption.is_asked_for:
            return False
        if time.monotonic() - self._saved >= self._config.checkpoint_seconds:
            self._folder.save(self._learner.save)
            self._saved = time.monotonic()
        self._videos.show(self._learner, update.steps)
        return self._journal.seconds < _limit(self._config)
