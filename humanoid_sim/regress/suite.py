"""A suite: a task, its cases and seeds, what disturbs the robot, its metrics, and how much worse is still accepted.

A suite is one YAML file; `assets/suites/lite_tracking.yaml` is the example. The structs are its schema.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import msgspec

from humanoid_sim.assets import asset_path, shipped
from humanoid_sim.errors import InputError, blaming, known_names, require_known
from humanoid_sim.evaluation.step_metrics import METRICS
from humanoid_sim.robots.schema import NotNegative, Positive
from humanoid_sim.simulation.randomisation import Randomisation
from humanoid_sim.strict_yaml import converted, read_yaml, require_finite

TaskName = Literal["tracking", "velocity", "piano"]
REACHED = ("vx_reached", "vy_reached", "yaw_rate_reached")
FAILURES = ("losses", "falls", "hard_touches", "faults")
"""Shares of episodes that are always judged: errors are those of the episodes that did not fail."""


class Metric(NamedTuple):
    """A figure of an episode."""

    name: str
    summary: Literal["rms", "mean", "episode"]  # of the policy steps; `episode`: a figure of the episode as a whole
    task: TaskName | None = None
    better: Literal["lower", "higher"] = "lower"
    own_unit: str = ""  # where it is not a row of the table of step metrics

    @property
    def unit(self) -> str:
        return METRICS[self.name].unit if self.name in METRICS else self.own_unit


_ROWS = (
    Metric("body_position_error", "rms", "tracking"),
    Metric("body_orientation_error", "rms", "tracking"),
    Metric("joint_error", "rms", "tracking"),
    Metric("losses", "episode", "tracking", own_unit="share"),  # the robot strayed too far from the motion
    Metric("velocity_error", "mean", "velocity"),  # over the last second against the command
    Metric("yaw_rate_error", "mean", "velocity"),
    # mean speed over the commanded along each axis, at most 1; where it is to move
    *(Metric(name, "episode", "velocity", "higher", "×") for name in REACHED),
    Metric("tilt", "rms", "velocity"),
    Metric("slip", "mean", "velocity", own_unit="m/s"),  # of the feet's points that touch the ground
    Metric("power", "mean", "velocity"),
    Metric("falls", "episode", "velocity", own_unit="share"),
    Metric("f1", "mean", "piano", "higher"),
    Metric("precision", "mean", "piano", "higher"),
    Metric("recall", "mean", "piano", "higher"),
    Metric("key_force", "episode", "piano", own_unit="N"),  # hardest touch of a key, of every physics step
    Metric("hard_touches", "episode", "piano", own_unit="share"),  # a key was touched harder than the robot allows
    Metric("effort", "rms"),
    Metric("action_rate", "rms", own_unit="rad/s"),  # change of the commanded positions from step to step
    Metric("faults", "episode", own_unit="share"),  # an observation or action was refused, or physics diverged
    Metric("survival", "episode", None, "higher", "share"),  # part of the planned episode that was reached
)


def metrics_of(task: TaskName) -> Mapping[str, Metric]:
    """Return the metrics of a task by name."""
    return {metric.name: metric for metric in _ROWS if metric.task in (None, task)}


class _Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    pass


class Case(_Part, frozen=True, kw_only=True):
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

    @property
    def moves(self) -> tuple[bool, bool, bool]:
        """Return along which axes the robot is to move: a smaller command asks it to stand."""
        vx, vy, yaw_rate = (abs(value) >= 0.1 for value in self.command or (0.0, 0.0, 0.0))  # m/s, m/s, rad/s
        return vx, vy, yaw_rate


class Start(_Part, frozen=True, kw_only=True):
    """Spread around the policy's default pose, and around rest, in which episodes begin."""

    joint_position: NotNegative = 0.0
    """rad, uniform to both sides, joint by joint."""
    joint_velocity: NotNegative = 0.0
    """rad/s, likewise."""


class Tolerance(_Part, frozen=True, kw_only=True):
    """Worsening against the baseline that a metric may have: the larger of the two."""

    relative: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.0
    absolute: NotNegative = 0.0


class Suite(_Part, frozen=True, kw_only=True):
    """A suite. Everything that an episode depends on is in its digest, so that a baseline is known to fit."""

    name: str
    summary: str = ""
    task: TaskName
    robot: str = ""
    """A shipped robot, or the path of a description or an MJCF, relative to the suite; empty: `--robot` says."""
    cases: Annotated[tuple[Case, ...], msgspec.Meta(min_length=1)]
    seeds: Annotated[int, msgspec.Meta(ge=1)]
    tolerances: Mapping[str, Tolerance]
    """By metric, in the order of the report: these are judged. Failures always are, with tolerance 0 unless given."""
    start: Start = Start()
    randomisation: Randomisation = Randomisation()
    settle: NotNegative = 1.0
    """s at the start of a velocity episode that its errors do not count: the robot begins at rest."""
    implicit: bool = False
    """Integrate the motors' damping implicitly, in longer steps: faster, not exact."""

    @property
    def metrics(self) -> tuple[Metric, ...]:
        """The metrics that are judged, in their order: a speed is reached only along an axis that some case moves."""
        known = metrics_of(self.task)
        moved = {name for case in self.cases for name, moves in zip(REACHED, case.moves, strict=True) if moves}
        names = dict.fromkeys((*self.tolerances, *(name for name in FAILURES if name in known)))
        return tuple(known[name] for name in names if name not in REACHED or name in moved)

    def tolerance(self, metric: str, baseline: float) -> float:
        """Return the worsening that is let pass beside a baseline, in the metric's unit."""
        tolerance = self.tolerances.get(metric, Tolerance())
        return max(tolerance.absolute, tolerance.relative * abs(baseline))


def load_suite(name_or_path: str) -> tuple[Suite, Path]:
    """Return a shipped suite by its name, or the one in a YAML file; with the folder that its paths are relative to."""
    known = shipped("suites")
    if name_or_path not in known and not os.path.isfile(name_or_path):
        named = known_names("suite", name_or_path, known)
        raise InputError(f"--suite: {named}; or a suite's YAML file that exists")
    path = asset_path("suites", f"{name_or_path}.yaml") if name_or_path in known else Path(name_or_path)
    document = read_yaml(path)
    suite = converted(document, Suite, str(path))
    with blaming(path, InputError):
        require_finite(document)
        _check(suite)
    return suite, path.resolve().parent


def _check(suite: Suite) -> None:
    wanted = {"tracking": "motion", "velocity": "command", "piano": "song"}[suite.task]
    if len({case.name for case in suite.cases}) < len(suite.cases):
        raise InputError(f"cases: are named {', '.join(case.name for case in suite.cases)}, expected different names")
    for i, case in enumerate(suite.cases):
        given = [name for name in ("motion", "command", "song") if getattr(case, name)]
        if given != [wanted] and (given or suite.task != "tracking"):
            raise InputError(f"cases[{i}]: gives {', '.join(given) or 'nothing'}, expected a {wanted}")
        if suite.task == "velocity" and (case.duration or 0.0) <= suite.settle:
            raise InputError(f"cases[{i}].duration: expected more than settle ({suite.settle:g} s)")
    require_known("metric", suite.tolerances, metrics_of(suite.task), "tolerances: ")
    Randomisation.of(suite.randomisation)
