"""A suite: a task, its cases and seeds, what disturbs the robot, and how much worse is still accepted.

A suite is one YAML file; `assets/suites/lite_tracking.yaml` is the example. The structs are its schema. Whatever is
wrong with a file is one line with the file, the field and what is accepted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec

from humanoid_sim.assets import asset_path, shipped
from humanoid_sim.errors import InputError, known_names, require_known
from humanoid_sim.files import is_file
from humanoid_sim.regress.metrics import ALWAYS, METRICS, TaskName, has_metric
from humanoid_sim.regress.options import RegressConfig
from humanoid_sim.regress.results import MetricInfo
from humanoid_sim.robots.schema import NotNegative, Positive
from humanoid_sim.simulation.batch.randomisation import LONGEST_DELAY, Randomisation
from humanoid_sim.simulation.plant import BatchActuation
from humanoid_sim.strict_yaml import read_yaml, schema_problem

SEEDS = 2**31
"""Least number that is not a seed any more."""


class Case(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One thing to do: follow a motion, walk at a velocity, or play a song."""

    name: str
    motion: str = ""
    """Tracking: a sample motion, or the path of a motion file, relative to the suite; empty: the one in the policy."""
    song: str = ""
    """Piano: a sample song, or the path of a MIDI file, relative to the suite."""
    command: tuple[float, float, float] | None = None
    """Velocity: vx, vy in m/s and the yaw rate in rad/s."""
    duration: float | None = None
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


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Disturbances of the robots, beside where they start."""

    randomisation: Randomisation
    pushes: Pushes | None = None


class Tolerance(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Worsening against the baseline that a metric may have: the larger of the two."""

    relative: float = 0.0
    """Share of the baseline."""
    absolute: float = 0.0
    """Worsening in the metric's unit."""


class Suite(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A suite. Everything that an episode depends on is in its digest, so that a baseline is known to fit."""

    name: str
    summary: str = ""
    task: TaskName
    robot: str = ""
    """A shipped robot, or the path of a description or an MJCF, relative to the suite; empty: `--robot` says."""
    cases: tuple[Case, ...]
    seeds: int
    """Number of seeds of each case."""
    first_seed: int = 0
    tolerances: Mapping[str, Tolerance]
    """By metric, in the order of the report: these are judged. Failures always are, with tolerance 0 unless given."""
    confidence: Annotated[float, msgspec.Meta(ge=0.5, lt=1.0)] = 0.95
    """Probability that none of a candidate's intervals misses its change."""
    resamples: Annotated[int, msgspec.Meta(ge=2)] = 10_000
    """Resamples of the bootstrap."""
    start: Start = Start()
    randomisation: Mapping[str, float | tuple[float, float]] = {}
    """Fields of `humanoid_sim.simulation.batch.Randomisation`."""
    pushes: Pushes | None = None
    settle: NotNegative = 1.0
    """s at the start of a velocity episode that its errors do not count: the robot begins at rest."""
    action_limit: Positive | None = None
    """Largest magnitude of a raw action, as of the controller; default: each policy's own, or else 100."""
    physics_timestep: Positive | None = None
    """s; default: the robot's."""
    actuation: BatchActuation = "affine"
    """Simulation of the motors; see `humanoid_sim.simulation.plant`."""
    base_height: Positive | None = None
    """m, where a free base starts; default: the robot's."""

    @property
    def seed_numbers(self) -> tuple[int, ...]:
        """The seeds that every case is run with."""
        return tuple(range(self.first_seed, self.first_seed + self.seeds))

    @property
    def metrics(self) -> tuple[MetricInfo, ...]:
        """The metrics that are judged, in their order, of those that some case has."""
        always = (name for name in ALWAYS[self.task] if name not in self.tolerances)
        names = (
            name for name in (*self.tolerances, *always) if any(has_metric(name, case.command) for case in self.cases)
        )
        return tuple(METRICS[self.task][name].info for name in names)

    def tolerance(self, metric: str, baseline: float) -> float:
        """Return the worsening that is let pass beside a baseline, in the metric's unit."""
        tolerance = self.tolerances.get(metric, Tolerance())
        return max(tolerance.absolute, tolerance.relative * abs(baseline))

    @property
    def disturbance(self) -> Disturbance:
        """Return the disturbance of each episode. Raises `InputError`, naming the field that is wrong."""
        return Disturbance(Randomisation.of(self.randomisation), self.pushes)


SUITE_OF = {"tracking": "lite_tracking", "velocity": "velocity", "walking": "velocity", "piano": "lite_piano"}
"""The shipped suite for a task of the environments."""


def load_suite(name_or_path: str) -> tuple[Suite, Path]:
    """Return a shipped suite by its name, or the one in a YAML file; with the folder that its paths are relative to.

    Raises `InputError`: one line, such as `mine.yaml: seeds: is 1, expected at least 2`.
    """
    known = shipped("suites")
    if name_or_path not in known and not is_file(name_or_path):
        meant = SUITE_OF.get(name_or_path)
        named = known_names("suite", name_or_path, known)
        if meant is not None:
            named = f"unknown suite '{name_or_path}' (did you mean '{meant}'?); known: {', '.join(known)}"
        raise InputError(f"--suite: {named}; or a suite's YAML file that exists")
    path = asset_path("suites", f"{name_or_path}.yaml") if name_or_path in known else Path(name_or_path)
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise InputError(f"{path}: is not a suite, expected a mapping with name, task, cases, seeds and tolerances")
    try:
        suite = msgspec.convert(document, Suite)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {schema_problem(error, document, Suite)}") from None
    for problem in suite_problems(suite):
        raise InputError(f"{path}: {problem}")
    return suite, path.resolve().parent


def chosen_suite(suite: Suite, config: RegressConfig) -> Suite:
    """Return the suite with the options' cases and seeds. Raises `InputError`, naming the option."""
    names = [case.name for case in suite.cases]
    cases = tuple(case for case in suite.cases if config.only is None or config.only in case.name)
    if not cases:
        raise InputError(f"--only: is '{config.only}', expected part of one of the suite's cases: {', '.join(names)}")
    given = {"seeds": config.seeds, "first_seed": config.first_seed, "actuation": config.actuation}
    given = {name: value for name, value in given.items() if value is not None}
    chosen = msgspec.structs.replace(suite, cases=cases, **given)
    for problem in suite_problems(chosen):
        place, _, text = problem.partition(": ")
        raise InputError(f"--{place.replace('_', '-')}: {text}")
    if config.episode is not None:
        name, _, seed = config.episode.rpartition(":")
        require_known("case", (name,), names, "--episode: ")
        if int(seed) >= SEEDS:
            raise InputError(f"--episode: the seed is {seed}, expected 0 to {SEEDS - 1}")
        only = tuple(case for case in cases if case.name == name)
        chosen = msgspec.structs.replace(chosen, cases=only, first_seed=int(seed), seeds=1)
    return chosen


def suite_problems(suite: Suite) -> Iterator[str]:
    """Yield what types cannot say, each as `place: what is wrong`."""
    yield from _case_problems(suite)
    yield from _name_problems(suite)
    if suite.seeds < 2:
        yield f"seeds: is {suite.seeds}, expected at least 2"
    if not 0 <= suite.first_seed < SEEDS:
        yield f"first_seed: is {suite.first_seed}, expected at least 0, less than {SEEDS}"
    for name, tolerance in suite.tolerances.items():
        for field in ("relative", "absolute"):
            if not 0.0 <= getattr(tolerance, field) < math.inf:
                yield f"tolerances.{name}.{field}: is {getattr(tolerance, field)}, expected a finite number >= 0"
    try:
        drawn = suite.disturbance.randomisation
    except InputError as error:
        yield str(error)
        return
    if drawn.mass[0] <= 0.0:
        yield f"randomisation: mass is {drawn.mass}, expected more than 0: there is no body without mass"
    if drawn.command_jitter > LONGEST_DELAY:
        yield f"randomisation: command_jitter is {drawn.command_jitter:g}, expected at most {LONGEST_DELAY:g} s"


def _case_problems(suite: Suite) -> Iterator[str]:
    if not suite.cases:
        yield "cases: is empty, expected at least one"
    seen: set[str] = set()
    for i, case in enumerate(suite.cases):
        place = f"cases[{i}]"
        if not case.name.strip() or not case.name.isprintable():
            yield f"{place}.name: is {case.name!r}, expected a printable name"
        if case.name in seen:
            yield f"{place}.name: '{case.name}' is given twice"
        seen.add(case.name)
        if case.duration is not None and not 0.0 < case.duration <= 3600.0:
            yield f"{place}.duration: is {case.duration:g}, expected more than 0 and at most 3600 s"
        wanted = {"tracking": "motion", "velocity": "command", "piano": "song"}[suite.task]
        for name in ("motion", "command", "song"):
            if name != wanted and getattr(case, name):
                yield f"{place}.{name}: is of no use to a {suite.task} task, expected a {wanted}"
        if suite.task == "piano" and not case.song:
            yield f"{place}.song: is missing, expected a song"
        if suite.task == "velocity":
            if case.command is None or not all(math.isfinite(value) for value in case.command):
                yield f"{place}.command: expected vx, vy in m/s and a yaw rate in rad/s"
            if case.duration is None or case.duration <= suite.settle:
                yield f"{place}.duration: expected more than settle ({suite.settle:g} s)"


def _name_problems(suite: Suite) -> Iterator[str]:
    """Yield metrics that do not exist."""
    metrics = METRICS[suite.task]
    if not suite.tolerances:
        yield f"tolerances: is empty, expected some of {', '.join(metrics)}"
    for name in suite.tolerances:
        if name not in metrics:
            yield f"tolerances: {known_names(f'{suite.task} metric', name, metrics)}"
