"""`train`: check, learn, export, measure; and every so often a video of the policy as it is then."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from humanoid_sim.cli import ExitStatus
from humanoid_sim.controllers.base import RL_POLICY
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.files import exclusive_folder, is_file, output_file, whole_file
from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand
from humanoid_sim.regress.options import RegressConfig
from humanoid_sim.regress.run import regress
from humanoid_sim.regress.suite import SUITE_OF, load_suite
from humanoid_sim.rendering.video import VideoSink
from humanoid_sim.simulation.model import build_model
from humanoid_sim.strict_json import parse_json
from humanoid_sim.training.ppo.environment import Subject, subject_of
from humanoid_sim.training.ppo.export import export
from humanoid_sim.training.ppo.journal import PROGRESS, EpisodeMeter, Journal, read_progress
from humanoid_sim.training.ppo.learner import SETTINGS, Float32Array, Learner, first_spread, learner_class
from humanoid_sim.training.ppo.options import TrainConfig

_MAY_DIFFER = (
    *("steps", "minutes", "folder", "output", "resume", "checkpoint_seconds", "video_minutes", "tensorboard"),
    *("regress", "threads"),
)
"""Options that may change when a run is resumed."""
_KEPT = ("curriculum_steps",)
"""Options that a run goes on with as they were, unless others are given, which are refused."""
_PPO = "ppo"
_CTRL_C = b"Ctrl-C: ends after this update, with a checkpoint; once more ends at once\n"
_VIDEO_SECONDS = 8.0
"""s of an episode that a video shows, at most."""
_VIDEO_SHARE = 0.5
"""Share of the greatest forward command in it, for a policy that walks."""
_VIDEO_SIZE = 640, 360
_RUN = "run.json"


def train(config: TrainConfig) -> int:
    """Run the whole training; returns the exit status.

    Raises `InputError` if an option is out of range or does not fit the others, or an output cannot be written.
    """
    _check(config)
    subject = subject_of(config)
    kind = learner_class(config.algorithm)
    name = f"{subject.scenario.description.name}-{subject.task}-{config.algorithm}"
    path = Path(config.folder or f"runs/train/{name}")
    horizon = None if config.resume or config.curriculum is None else config.steps  # the run's that is resumed, if any
    told = {**subject.told, "curriculum_steps": config.curriculum_steps or horizon}
    if config.resume and not is_file(path / _RUN):
        raise InputError(f"--resume: '{path}' has no run to go on with, expected a folder of `train`")
    with exclusive_folder(path, "--folder"):
        return _train(config, subject, path, kind, told)


def _train(config: TrainConfig, subject: Subject, path: Path, kind: type[Learner], told: Mapping[str, Any]) -> int:
    folder = RunFolder(path, config, told, kind.SUFFIX)
    output = output_file(Path(config.output) if config.output else path / "policy.onnx", "--output", ".onnx")
    limit = float("inf") if config.minutes is None else 60.0 * config.minutes
    # A run that was killed before it wrote its policy still writes it.
    if folder.seconds >= limit and folder.rows[-1]["steps"] < config.steps and output.exists():
        raise InputError(
            f"--resume: the folder already has {folder.seconds / 60.0:.1f} of --minutes {config.minutes:g}; give a "
            "larger --minutes (earlier runs count)"
        )
    import torch  # noqa: PLC0415 - after the learner's class, which says what to install

    torch.set_num_threads(config.threads)
    learner, is_interrupted = _learn(config, subject, folder, kind, limit)
    try:
        if is_interrupted:
            _show(f"interrupted after {learner.steps} steps, saved in {path}; the same command with --resume goes on")
            return ExitStatus.INTERRUPTED
        export(learner.model, learner.envs, output)
        print(f"{output}: {output.stat().st_size / 1e6:.2f} MB, contract and golden vectors inside")
    finally:
        learner.envs.close()
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


def seed_of(seed: int, updates: int) -> int:
    """Seed networks, actions and environments: a training that goes on does not begin again alike."""
    return seed if updates == 0 else int(np.random.SeedSequence([seed, updates]).generate_state(1)[0])


def _show(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _learn(
    config: TrainConfig, subject: Subject, folder: RunFolder, kind: type[Learner], limit: float
) -> tuple[Learner, bool]:
    """Train to the end, for `limit` s, or until Ctrl-C. Returns the learner, and whether Ctrl-C ended it."""
    _show(f"making {config.robots} robots {subject.scenario.description.name} for the task {subject.task} …")
    envs = subject.environments(config.robots)
    meter = EpisodeMeter(envs, resumed=folder.start is not None)
    spread = first_spread(subject.contract, is_floating=subject.scenario.description.is_floating)
    learner = kind(meter, spread, seed_of(config.seed, len(folder.rows)), folder.start)
    if folder.start is not None:
        _show(f"goes on after {learner.steps} steps")
    journal = Journal(
        folder.path, config.steps, meter, _show, done=learner.steps, limit=limit, tensorboard=config.tensorboard
    )
    videos = Videos(subject, folder.path, config.video_minutes)
    has_more, saved = learner.steps < config.steps and folder.seconds < limit, time.monotonic()
    try:
        with interruptible() as interruption:
            while has_more:
                if folder.curriculum_steps is not None:  # for the episodes that begin from now on
                    envs.progress = min(learner.steps / folder.curriculum_steps, 1.0)
                update = learner.update()
                journal.record(update)
                if not np.isfinite(update.spread):
                    raise InputError(
                        f"the network is no longer finite after {update.steps} steps; the last checkpoint is sound"
                    )
                has_more = update.steps < config.steps and journal.seconds < limit and not interruption.is_set()
                if not has_more or time.monotonic() - saved >= config.checkpoint_seconds:
                    with whole_file(folder.checkpoint) as file:
                        learner.save(file)
                    saved = time.monotonic()
                if not interruption.is_set():
                    videos.show(learner.answer, update.steps)
    except BaseException:
        videos.close(abandon=True)
        learner.envs.close()
        raise
    finally:
        journal.close()
        videos.close()
    return learner, interruption.is_set()


def measure(subject: Subject, policy: Path, folder: Path) -> bool:
    """Run the suite for the task, and leave its figures in `regress.json`; False where Ctrl-C left that out."""
    name = SUITE_OF.get(subject.task)
    if name is None:
        _show(f"regress: no suite ships for the task {subject.task}")
        return True
    suite, _ = load_suite(name)
    episodes = len(suite.cases) * len(suite.seed_numbers)
    _show(f"measuring with the suite {name}: {episodes} episodes; Ctrl-C leaves it out")
    config = RegressConfig(
        policies=(str(policy),),
        suite=name,
        robot=str(subject.arguments["robot"]),
        json=folder / "regress.json",
        overwrite=True,
    )
    try:
        regress(config)
    except InputError as error:  # the policy is there; a suite of another robot does not undo it
        _show(f"regress: the suite {name} does not fit: {error}")
    except KeyboardInterrupt:
        _show(f"regress: left out; {policy} is whole")
        return False
    return True


class RunFolder:
    """Folder of a run: `run.json`, which says what it is a run of, and its checkpoint."""

    def __init__(self, path: Path, config: TrainConfig, subject: Mapping[str, Any], suffix: str) -> None:
        """Begin a run in a folder that is there, or find the checkpoint of the one to resume.

        `subject` has plain values of the options that name a file, a class or a default. Raises `InputError` if the
        folder cannot be written, or has a run that is not to be resumed, or another one.
        """
        self.path, self.checkpoint = path, path / f"checkpoint{suffix}"
        self._place = path / _RUN
        options = {name: value for name, value in asdict(config).items() if name not in _MAY_DIFFER}
        # as JSON has it
        self._run: dict[str, Any] = json.loads(json.dumps({**options, **subject, _PPO: asdict(SETTINGS)}))
        self.is_resumed = is_file(self._place)
        if self.is_resumed:
            self._check(config.resume)
        else:
            with whole_file(self._place) as file:
                file.write(json.dumps(self._run, indent=1).encode())
        self.curriculum_steps: int | None = self._run["curriculum_steps"]
        """Policy steps after which the curriculum's progress is 1; None without a curriculum."""

        self.start = self.checkpoint if self.is_resumed and is_file(self.checkpoint) else None
        """The checkpoint to go on from; None at the beginning, also of a run that ended before its first."""
        self.rows = [] if self.start is None else read_progress(path / PROGRESS)
        """Progress of the earlier runs."""
        self.seconds = self.rows[-1]["seconds"] if self.rows else 0.0
        """Training time of the earlier runs."""

    def _check(self, resume: bool) -> None:
        if not resume:
            raise InputError(f"--folder: '{self.path}' has a run; --resume goes on with it, another folder begins")
        try:
            known = parse_json(self._place.read_bytes())
            if not isinstance(known, dict):
                raise ValueError(f"is a {type(known).__name__}, expected an object")
        except (OSError, ValueError) as error:
            raise InputError(f"{self._place}: cannot be read: {error}") from None
        for name, value in self._run.items():
            before = known.get(name)
            if name in _KEPT and value is None:
                if not (before is None or (isinstance(before, int) and before > 0)):
                    raise InputError(f"{self._place}: {name} is {before!r}, expected a whole number > 0")
                self._run[name] = before
            elif before != value:
                option = "PPO's settings" if name == _PPO else f"--{name.replace('_', '-')}"
                raise InputError(
                    f"{option}: is {value!r}, but the run in '{self.path}' has {before!r}; --resume keeps it"
                )


@contextlib.contextmanager
def interruptible() -> Iterator[threading.Event]:
    """Note the first SIGINT in the event only, and give way to the handler before; for the main thread."""
    asked, before = threading.Event(), signal.getsignal(signal.SIGINT)

    def note(_: int, __: FrameType | None) -> None:
        signal.signal(signal.SIGINT, before)  # first: a second one may come at once, and finds no lock taken
        asked.set()
        with contextlib.suppress(OSError):
            os.write(2, _CTRL_C)  # not print, which may be in the middle of another line

    if before is not signal.SIG_IGN:  # as it is in a shell's background
        signal.signal(signal.SIGINT, note)
    try:
        yield asked
    finally:
        signal.signal(signal.SIGINT, before)


class Videos:
    """A video now and then, when it is time for one."""

    def __init__(self, subject: Subject, folder: Path, minutes: float | None) -> None:
        """Make none before so many minutes; None: none at all. Raises `InputError` if their folder cannot be made."""
        self._subject, self._folder = subject, folder / "videos"
        self._period = float("inf") if minutes is None else 60.0 * minutes
        self._due = time.monotonic() + self._period
        self._latest: VideoSink | None = None
        if minutes is not None:
            with blaming(f"{self._folder}: cannot be made a folder", OSError):
                self._folder.mkdir(exist_ok=True)

    def show(self, answer: Callable[[Float32Array], Float32Array], steps: int) -> None:
        """Run an episode and have it drawn, if it is time; waits for the last video, which is long ready as a rule.

        Raises `InputError` if the last one could not be written.
        """
        if time.monotonic() < self._due:
            return
        self.close()
        robot, terrain = self._subject.scenario.description, self._subject.scenario.terrain
        path = self._folder / f"{steps:010d}.mp4"
        self._latest = VideoSink(path, lambda: build_model(robot, terrain=terrain), size=_VIDEO_SIZE)
        try:
            self._run(answer, self._latest, f"{steps} steps of training")
        except BaseException:
            self.close(abandon=True)
            raise
        self._due = time.monotonic() + self._period

    def close(self, *, abandon: bool = False) -> None:
        """Wait for the one that is being drawn, or give it up. Raises `InputError` if it could not be written."""
        latest, self._latest = self._latest, None
        if latest is not None and abandon:
            latest.abandon()
        elif latest is not None:
            latest.finish()

    def _run(self, answer: Callable[[Float32Array], Float32Array], sink: VideoSink, caption: str) -> None:
        contract = self._subject.contract
        ranges = contract.command_ranges
        options = {}
        if self._subject.scenario.wiring.takes_velocity_command and ranges is not None:
            options["command"] = (_VIDEO_SHARE * ranges[0, 1], 0.0, 0.0)
        with contextlib.closing(self._subject.environment()) as env:
            observation, _ = env.reset(seed=0, options=options)
            mode = ControlMode(Mode.LOCOMOTION, RL_POLICY, caption)
            command = MITCommand.zeros(len(env.robot.joints))
            for step in range(round(_VIDEO_SECONDS / contract.policy_dt)):
                tick = TickInput(env.robot.truth())
                sink.tick(TickRecord(step, tick, TickOutput(command, mode), 0.0, False, env.robot.qpos))
                observation, _, terminated, truncated, _ = env.step(answer(observation[None])[0])
                if terminated or truncated:
                    return
