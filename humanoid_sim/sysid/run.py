"""One run of `sysid`, from recordings to files."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import chain

from rich.console import Console
from rich.table import Column, Table

from humanoid_sim.cli import ExitStatus
from humanoid_sim.errors import InputError
from humanoid_sim.robots.description import load_robot
from humanoid_sim.sysid import SysidConfig
from humanoid_sim.sysid.data import Run, read_run, windows
from humanoid_sim.sysid.fit import Fit, fit
from humanoid_sim.sysid.judgement import QUANTITIES, Judgement, check_runs, judge
from humanoid_sim.sysid.model import KINDS, UNITS
from humanoid_sim.sysid.outputs import refuse_existing, results_document, write_files

_FITTED = 2.0 / 3.0
"""Share of the data that is fitted where no other recording judges the fit."""


def identify(config: SysidConfig) -> int:
    """Run, and return the exit status. Raises `InputError` before any file is written."""
    from humanoid_sim.sysid.page import page  # noqa: PLC0415 - the pages need an extra

    if not config.recordings:
        raise InputError("recordings: are missing, expected at least one (.mcap)")
    refuse_existing(config.output, config.calibration, overwrite=config.overwrite)
    description = load_robot(config.robot)
    console = Console(highlight=False, soft_wrap=not sys.stdout.isatty())
    names = description.joint_names
    runs, notes = _different([read_run(path, names) for path in config.recordings])
    fitted = list(chain.from_iterable(windows(run, (0.0, _FITTED if config.judge is None else 1.0)) for run in runs))
    others = [read_run(config.judge, names)] if config.judge is not None else []
    if any(run.digest == other.digest for run in runs for other in others):
        raise InputError(f"--judge: '{config.judge}' holds data that are fitted, expected another run")
    held = list(chain.from_iterable(windows(run, (0.0 if others else _FITTED, 1.0)) for run in others or runs))
    if not held:
        raise InputError("recordings: leave no stretch of 2 s to judge the fit by, expected longer ones or --judge")
    notes += check_runs([*runs, *others], description)
    for line in notes:
        console.print(f"note: {line}", markup=False)
    seconds = sum(window.duration for window in fitted), sum(window.duration for window in held)
    console.print(f"{description.name}: {seconds[0]:.0f} s are fitted, {seconds[1]:.0f} s judge the fit", markup=False)
    found = fit(
        description,
        fitted,
        kinds=config.only or KINDS,
        sharing=config.share,
        say=lambda line: console.print(line, markup=False),
    )
    judgement = judge(found, held)
    _print(console, found, judgement, names)
    results = results_document(description, found, judgement, notes)
    text = page(results, judgement, names)
    for path in write_files(config.output, config.robot, description, found, results, text, config.calibration):
        console.print(f"wrote {path}", markup=False)
    return ExitStatus.of(judgement.is_better)


def _different(runs: Sequence[Run]) -> tuple[list[Run], list[str]]:
    """Return the runs without those whose data another one holds already, and a note on each of these."""
    known: dict[str, Run] = {}
    notes = []
    for run in runs:
        first = known.setdefault(run.digest, run)
        if first is not run:
            notes.append(f"{run.source} holds the same data as {first.source}; it counts once")
    return list(known.values()), notes


def _print(console: Console, found: Fit, judgement: Judgement, names: Sequence[str]) -> None:
    numbers = (Column(heading, justify="right") for heading in ("old", "new", "± 95 %"))
    table = Table(Column("parameter", no_wrap=True), *numbers, "unit", "")
    for item in found.parameters:
        told = f"undecided: {item.reason}" if item.reason else ""
        value = "" if item.reason else f"{item.value:.4g}"
        row = (item.parameter.name, f"{item.parameter.old:.4g}", value, f"{item.half_width:.2g}")
        table.add_row(*row, UNITS[item.parameter.kind], told, style="dim" if item.reason else None)
    console.print(table)
    headings = (Column(f"{name} {age}", justify="right") for name in QUANTITIES for age in ("old", "new"))
    errors = Table(Column("error of the prediction", no_wrap=True), *headings)
    for j, name in enumerate(names):
        errors.add_row(
            name, *(f"{e[i, j]:.2g}" for i in range(len(QUANTITIES)) for e in (judgement.old, judgement.new))
        )
    console.print(errors)
    for line in judgement.unexplained(names):
        console.print(f"warning: {line}", markup=False)
    shares = ", ".join(f"{name} {100.0 * r:.0f} %" for name, r in zip(QUANTITIES, judgement.ratio, strict=True))
    verdict = "better" if judgement.is_better else "not better"
    console.print(f"{verdict}: errors on data that were not fitted, of the old ones: {shares}", markup=False)
