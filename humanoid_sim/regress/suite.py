"""A suite: a task, its cases and seeds, what disturbs the robot, and how much worse is still accepted.

A suite is one YAML file; `assets/suites/lite_tracking.yaml` is the example. The structs are its schema.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

import msgspec

from humanoid_sim.assets import asset_path, shipped
from humanoid_sim.errors import InputError, known_names
from humanoid_sim.files import is_file
from humanoid_sim.regress import RegressConfig
from humanoid_sim.regress.metrics import Metric, TaskName, failures_of, has_metric, metrics_of
from humanoid_sim.robots.schema import NotNegative, Positive
from humanoid_sim.simulation.randomisation import Randomisation
from humanoid_sim.strict_yaml import read_yaml, schema_problem

FEWEST_SEEDS = 6
"""Seeds of each case that a comparison takes: with fewer their spread is hardly known."""


class Case(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One thing to do: follow a motion, walk at a velocity, or play a song."""

    name: str
    motion: str = ""
    """Tracking: a sample motion, or the path of a motion file, relative to the suite; empty: the one in the policy."""
    song: str = ""
    """Piano: a sample song, or the path of a MIDI file, relative to the suite."""
    command: tuple[float, float, float] | None = None
    """Velocity: vx, vy in m/s and the yaw rate in rad/s."""
    duration: Positive | None = None
    """s; tracking and piano: default the whole motion or song."""


class Start(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Spread around the policy's default pose, and around rest, in which episodes begin."""

    joint_position: NotNegative = 0.0
    """rad, uniform to both sides, joint by joint."""
    joint_velocity: NotNegative = 0.0
    """rad/s, likewise."""


class Pushes(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Sudden changes of a floating base's horizontal velocity, in a direction that is drawn."""

    speed: Positive
    """m/s"""
    interval: Positive = 4.0
    """s between two; the first comes after half of it."""


class Tolerance(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Worsening against the baseline that a metric may have: the larger of the two."""

    relative: float = 0.0
    absolute: float = 0.0


class Suite(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A suite. Everything that an episode depends on is in its digest, so that a baseline is known to fit."""

    name: str
    summary: str = ""
    task: TaskName
    robot: str = ""
    """A shipped robot, or the path of a description or an MJCF, relative to the suite; empty: `--robot` says."""
    cases: tuple[Case, ...]
    seeds: Annotated[int, msgspec.Meta(ge=1)]
    tolerances: Mapping[str, Tolerance]
    """By metric, in the order of the report: these are judged. Failures always are, with tolerance 0 unless given."""
    start: Start = Start()
    randomisation: Mapping[str, float | tuple[float, float]] = {}
    """Fields of `humanoid_sim.simulation.randomisation.Randomisation`."""
    pushes: Pushes | None = None
    settle: NotNegative = 1.0
    """s at the start of a velocity episode that its errors do not count: the robot begins at rest."""
    implicit: bool = False
    """Integrate the motors' damping implicitly, in longer steps: faster, not exact."""

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The metrics that are judged, in their order, of those that some case has."""
        names, known = dict.fromkeys((*self.tolerances, *failures_of(self.task))), metrics_of(self.task)
        return tuple(known[name] for name in names if any(has_metric(name, case.command) for case in self.cases))

    def tolerance(self, metric: str, baseline: float) -> float:
        """Return the worsening that is let pass beside a baseline, in the metric's unit."""
        tolerance = self.tolerances.get(metric, Tolerance())
        return max(tolerance.absolute, tolerance.relative * abs(baseline))


def load_suite(name_or_path: str) -> tuple[Suite, Path]:
    """Return a shipped suite by its name, or the one in a YAML file; with the folder that its paths are relative to."""
    known = shipped("suites")
    if name_or_path not in known and not is_file(name_or_path):
        named = known_names("suite", name_or_path, known)
        raise InputError(f"--suite: {named}; or a suite's YAML file that exists")
    path = asset_path("suites", f"{name_or_path}.yaml") if name_or_path in known else Path(name_or_path)
    document = read_yaml(path)
    try:
        suite = msgspec.convert(document, Suite)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {schema_problem(error)}") from None
    for problem in _problems(suite):
        raise InputError(f"{path}: {problem}")
    return suite, path.resolve().parent


def chosen_suite(suite: Suite, config: RegressConfig) -> Suite:
    """Return the suite with the options' cases and seeds. Raises `InputError`, naming the option."""
    names = ", ".join(case.name for case in suite.cases)
    cases = tuple(case for case in suite.cases if config.only is None or config.only in case.name)
    if not cases:
        raise InputError(f"--only: is '{config.only}', expected part of one of the suite's cases: {names}")
    seeds = suite.seeds if config.seeds is None else config.seeds
    if seeds < (1 if config.baseline is None else FEWEST_SEEDS):
        raise InputError(f"--seeds: is {seeds}, expected at least 1, and {FEWEST_SEEDS} with a --baseline")
    return msgspec.structs.replace(suite, cases=cases, seeds=seeds)


def _problems(suite: Suite) -> Iterator[str]:
    names = [case.name for case in suite.cases]
    if not names or len(set(names)) < len(names):
        yield f"cases: are named {', '.join(names) or 'nothing'}, expected one or more, each with a name of its own"
    wanted = {"tracking": "motion", "velocity": "command", "piano": "song"}[suite.task]
    for i, case in enumerate(suite.cases):
        given = [name for name in ("motion", "command", "song") if getattr(case, name)]
        if given != [wanted] and (given or suite.task != "tracking"):
            yield f"cases[{i}]: gives {', '.join(given) or 'nothing'}, expected a {wanted} for a {suite.task} task"
        if suite.task == "velocity" and (case.duration or 0.0) <= suite.settle:
            yield f"cases[{i}].duration: expected more than settle ({suite.settle:g} s)"
    for name, tolerance in suite.tolerances.items():
        if not min(tolerance.relative, tolerance.absolute) >= 0.0:
            yield f"tolerances.{name}: is {tolerance.relative:g}, {tolerance.absolute:g}, expected numbers >= 0"
        if name not in metrics_of(suite.task):
            yield f"tolerances: {known_names(f'{suite.task} metric', name, metrics_of(suite.task))}"
    try:
        Randomisation.of(suite.randomisation)
    except InputError as error:
        yield str(error)
