"""Journal of a training: a line for people, `progress.csv`, and TensorBoard's logs; and `curves`, drawn from it."""

from __future__ import annotations

import csv
import io
import json
import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import VectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from humanoid_sim.envs.resets import term_means
from humanoid_sim.errors import InputError, blaming, needing
from humanoid_sim.files import is_file, output_file, whole_file
from humanoid_sim.training.ppo.options import CurvesConfig

PROGRESS = "progress.csv"
_LIBRARIES = {"ppo-sb3": "stable-baselines3", "ppo-rsl_rl": "rsl_rl"}
COLUMNS = ("steps", "seconds", "steps_per_second", "return", "episode_steps", "failed", "spread")
"""Columns of `progress.csv`: policy steps, s of training, 1/s, mean return and length of the
latest episodes that ended, the share of them that failed, and the standard deviation of the raw actions."""
_SHOWN_EVERY = 10.0
"""s of wall time between two lines."""


@dataclass(frozen=True, slots=True)
class Update:
    """Report of a library that has updated the network."""

    steps: int
    """Policy steps of all robots since the beginning of the training."""
    spread: float
    """Standard deviation of the raw actions, mean over them."""
    losses: Mapping[str, float] = field(default_factory=dict)


class EpisodeMeter(RecordEpisodeStatistics):
    """Gymnasium's statistics of the latest N episodes of N robots, and how many of them failed."""

    def __init__(self, env: VectorEnv[Any, Any, Any], *, resumed: bool = False) -> None:
        """Watch `env`, which starts episodes in the step that ends the last ones."""
        super().__init__(env, buffer_length=env.num_envs)
        self._missing = np.full(env.num_envs, resumed)
        self._failures: deque[bool] = deque(maxlen=env.num_envs)
        self._info: dict[str, Any] = {}

    def step(self, actions: Any) -> Any:
        """See `VectorEnv.step`."""
        result = super().step(actions)
        _, _, terminated, truncated, self._info = result
        self._failures.extend(terminated[terminated | truncated])
        self._missing &= ~(terminated | truncated)
        return result

    def means(self) -> tuple[float, float, float]:
        """Return mean return and length, and the share that failed; NaN before any episode has ended.

        Once resumed, NaN until every robot has ended one: until then only the short ones are known.
        """
        if self._missing.any():
            return math.nan, math.nan, math.nan
        queues = self.return_queue, self.length_queue, self._failures
        mean_return, mean_length, failed = (float(np.mean(queue)) if queue else math.nan for queue in queues)
        return mean_return, mean_length, failed

    def terms(self) -> dict[str, float]:
        """Return each reward term's mean over the robots that had one in the latest step."""
        return term_means(self._info)


class Journal:
    """Writes one row and one set of scalars per update, and now and then a line."""

    def __init__(
        self,
        folder: Path,
        steps: int,
        meter: EpisodeMeter,
        show: Callable[[str], None],
        *,
        done: int = 0,
        limit: float = math.inf,
        tensorboard: bool = True,
    ) -> None:
        """Begin, or go on. Raises `InputError` if a file cannot be read or written, or TensorBoard is not installed.

        Args:
            steps: at which the training will end.
            limit: s of training, earlier runs of the folder counted in, after which it will end sooner.
            done: steps of the checkpoint that the training goes on from; rows beyond it are dropped.
        """
        self._total, self._limit, self._meter, self._show = steps, limit, meter, show
        self._path = folder / PROGRESS
        rows = [row for row in read_progress(self._path) if row["steps"] <= done] if done else []
        self._before = rows[-1]["seconds"] if rows else 0.0
        with whole_file(self._path) as file:
            file.write((",".join(COLUMNS) + "\n").encode())
            for row in rows:
                file.write(_line(row))
        self._writer: Any = None
        if tensorboard:
            with needing("tensorboard", "rl", "training train (or give --no-tensorboard)"):
                from torch.utils.tensorboard import SummaryWriter  # noqa: PLC0415 - heavy, and can be done without
            self._writer = SummaryWriter(str(folder / "tensorboard"), purge_step=done + 1 if done else None)
        self._begin = self._shown = self._noted = time.monotonic()
        self._steps = done

    @property
    def seconds(self) -> float:
        """Training time in s, including earlier runs in this folder."""
        return self._before + time.monotonic() - self._begin

    def record(self, update: Update) -> None:
        """Write down an update. Raises `InputError` if it cannot be written."""
        now, meter = time.monotonic(), self._meter
        speed = (update.steps - self._steps) / max(now - self._noted, 1e-9)
        self._steps, self._noted = update.steps, now
        row = dict(zip(COLUMNS, (update.steps, self.seconds, speed, *meter.means(), update.spread), strict=True))
        with blaming(f"{self._path}: cannot be written", OSError), self._path.open("ab") as file:
            file.write(_line(row))
        if self._writer is not None:
            scalars = {f"train/{name}": row[name] for name in COLUMNS[2:]}
            scalars |= {f"reward/{name}": value for name, value in meter.terms().items()}
            scalars |= {f"loss/{name}": value for name, value in update.losses.items()}
            for name, value in scalars.items():
                if math.isfinite(value):
                    self._writer.add_scalar(name, value, update.steps)
        if now - self._shown >= _SHOWN_EVERY or update.steps >= self._total:
            self._shown = now
            self._show(self.line(row))

    def line(self, row: Mapping[str, float]) -> str:
        """Return a row in words."""
        left = max(self._total - row["steps"], 0) / max(row["steps_per_second"], 1e-9)
        minutes = max(min(left, self._limit - row["seconds"]), 0.0) / 60.0
        remaining = f"{minutes:.0f} min" if minutes < 120.0 else f"{minutes / 60.0:.1f} h"
        return (
            f"{_millions(row['steps'])} of {_millions(self._total)} M steps, {row['steps_per_second']:.0f}/s, "
            f"return {row['return']:.2f}, episodes of {row['episode_steps']:.0f} steps, {100 * row['failed']:.0f} % "
            f"failed, {remaining} left"
        )

    def close(self) -> None:
        """End TensorBoard's logs."""
        if self._writer is not None:
            self._writer.close()


def read_progress(path: Path) -> list[dict[str, float]]:
    """Return the rows of a `progress.csv`; an unfinished last line is left out.

    Raises `InputError` if the file is missing or is not one of these.
    """
    if not is_file(path):
        raise InputError(f"{path}: no such file, expected {PROGRESS} of a training")
    try:
        text = path.read_text(encoding="utf-8")
        rows = list(csv.reader(io.StringIO(text[: text.rfind("\n") + 1])))
        if not rows or tuple(rows[0]) != COLUMNS:
            raise ValueError
        return [dict(zip(COLUMNS, map(float, row), strict=True)) for row in rows[1:]]
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, csv.Error):
        raise InputError(f"{path}: is not a training's progress, expected the columns {', '.join(COLUMNS)}") from None


def _line(row: Mapping[str, float]) -> bytes:
    return (",".join(f"{row[name]:.6g}" if name != "steps" else f"{row[name]:.0f}" for name in COLUMNS) + "\n").encode()


def _millions(steps: float) -> str:
    return f"{steps / 1e6:.2f}" if steps >= 1e4 else f"{steps / 1e6:.4f}"


class Curve(NamedTuple):
    """One curve."""

    subject: str
    """Robot and task: the diagram that it belongs to."""
    label: str
    rows: Sequence[Mapping[str, float]]
    """Rows of `progress.csv` with a return."""


def read_curve(folder: Path) -> Curve:
    """Read the folder of a run. Raises `InputError` if it is not one, or no episode has ended in it yet."""
    place = folder / "run.json"
    try:
        known = json.loads(place.read_text(encoding="utf-8"))
        subject, library = f"{known['robot']}, {known['task']}", _LIBRARIES[known["algorithm"]]
        robots = int(known["robots"])
    except (OSError, ValueError, LookupError, TypeError):
        raise InputError(f"{folder}: is not a folder of `train`: {place.name} cannot be read") from None
    rows = [row for row in read_progress(folder / PROGRESS) if row["return"] == row["return"]]
    if not rows:
        raise InputError(f"{folder / PROGRESS}: no episode has ended yet, expected a longer run")
    return Curve(subject, f"{library}, {robots} robots", rows)


def curves(config: CurvesConfig) -> int:
    """Draw them; returns the exit status.

    Raises `InputError` if a folder is not one of `train`, or the picture cannot be written.
    """
    output = output_file(Path(config.output), "--output", ".png")
    runs = [read_curve(Path(name)) for name in config.runs]
    if not runs:
        raise InputError("RUNS: is empty, expected one or more folders of `train`")
    with needing("matplotlib", "report", "training curves"):
        from matplotlib.figure import Figure  # noqa: PLC0415 - an extra
    subjects = list(dict.fromkeys(run.subject for run in runs))
    figure: Any = Figure(figsize=(9.0, 3.2 * len(subjects)), layout="constrained")
    grid = figure.subplots(len(subjects), 2, squeeze=False, sharey="row")
    for (by_steps, by_time), subject in zip(grid, subjects, strict=True):
        for run in (run for run in runs if run.subject == subject):
            returns = [row["return"] for row in run.rows]
            minutes = run.rows[-1]["seconds"] / 60.0
            by_steps.plot([row["steps"] / 1e6 for row in run.rows], returns, label=run.label, linewidth=1.2)
            label = f"{run.label}, {minutes:.0f} min"
            by_time.plot([row["seconds"] / 60.0 for row in run.rows], returns, label=label, linewidth=1.2)
        by_steps.set(title=subject, xlabel="policy steps, millions", ylabel="return of an episode")
        by_time.set(title="the same over wall time", xlabel="minutes of training")
        for axes in (by_steps, by_time):
            axes.grid(alpha=0.3)
            axes.legend(fontsize="small")
    with whole_file(output) as file:
        figure.savefig(file, format="png", dpi=110)
    for run in runs:
        last = run.rows[-1]
        print(
            f"{run.subject}, {run.label}: return {run.rows[0]['return']:.2f} to {last['return']:.2f} "
            f"in {last['steps'] / 1e6:.2f} M steps, {last['seconds'] / 60.0:.1f} min"
        )
    return 0
