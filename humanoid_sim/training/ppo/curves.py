"""`curves`: learning curves of runs of `train`, drawn from their `progress.csv`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from humanoid_sim.errors import InputError, MissingPackageError
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.training.ppo.journal import PROGRESS, read_progress
from humanoid_sim.training.ppo.options import CurvesConfig

_LIBRARIES = {"ppo-sb3": "stable-baselines3", "ppo-rsl_rl": "rsl_rl"}


class Run(NamedTuple):
    """One curve."""

    subject: str
    """Robot and task: the diagram that it belongs to."""
    label: str
    rows: Sequence[Mapping[str, float]]
    """Rows of `progress.csv` with a return."""


def read_run(folder: Path) -> Run:
    """Read the folder of a run.

    Raises:
        InputError: it is not one, or no episode has ended in it yet.
    """
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
    return Run(subject, f"{library}, {robots} robots", rows)


def curves(config: CurvesConfig) -> int:
    """Draw them; returns the exit status.

    Raises:
        InputError: a folder is not one of `train`, or the picture cannot be written.
    """
    output = output_file(Path(config.output), "--output", ".png")
    runs = [read_run(Path(name)) for name in config.runs]
    if not runs:
        raise InputError("RUNS: is empty, expected one or more folders of `train`")
    try:
        from matplotlib.figure import Figure  # noqa: PLC0415 - an extra
    except ImportError:
        raise MissingPackageError("matplotlib", "report", "training curves") from None
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
