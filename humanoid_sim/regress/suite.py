"""Schema of a suite: a task, its cases and seeds, what disturbs the robot, and how much worse is still accepted.

A suite is one YAML file; `assets/suites/lite_tracking.yaml` is the example. These structs are its schema,
`humanoid_sim.regress.suite_file.load_suite` reads it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec

from humanoid_sim.regress.metrics import ALWAYS, METRICS, TaskName, has_metric
from humanoid_sim.regress.results import MetricInfo
from humanoid_sim.robots.schema import Accepted, NotNegative, Positive
from humanoid_sim.simulation.batch.randomisation import Randomisation
from humanoid_sim.simulation.plant import BatchActuation

SEEDS = 2**31
"""Least number that is not a seed any more."""
Share = Annotated[float, Accepted(0.0, below=1.0)]

Axis = Literal["delay", "jitter", "gains", "friction", "joint_friction", "mass", "push", "noise"]
AXES: Mapping[str, tuple[str, float]] = {
    "delay": ("s", 0.0),
    "jitter": ("s", 0.0),
    "gains": ("×", 1.0),
    "friction": ("×", 1.0),
    "joint_friction": ("×", 1.0),
    "mass": ("×", 1.0),
    "push": ("m/s", 0.0),
    "noise": ("rad", 0.0),
}
"""Axes of margins: unit, and the value that disturbs nothing."""


class Case(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One thing to do: follow a motion, walk at a velocity, or play a song."""

    name: str
    motion: str = ""
    """Tracking: a sample motion, or the path of a motion file, relative to the suite; empty: the one in the policy."""
    song: str = ""
    """Piano: a sample song, or the path of a MIDI file, relative to the suite; `random:N` is a song of its own for
    each N, that no training has seen."""
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

    relative: NotNegative = 0.0
    """Share of the baseline."""
    absolute: NotNegative = 0.0
    """Worsening in the metric's unit."""


class Sweep(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One disturbance, raised level by level until the policy fails, and then narrowed down by bisection."""

    axis: Axis
    levels: tuple[float, ...]
    """Levels in the axis' unit, away from the value that disturbs nothing."""

    @property
    def name(self) -> str:
        """The axis, and for those with two sides which one."""
        _, nominal = AXES[self.axis]
        if nominal == 0.0:
            return self.axis
        return f"{self.axis} {'up' if self.levels[0] > nominal else 'down'}"


class Margins(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Measurement of robustness margins."""

    sweeps: tuple[Sweep, ...]
    seeds: Annotated[int, Accepted(1)] = 4
    """Number of seeds of each case at each level."""
    cases: tuple[str, ...] = ()
    """Names; empty: all."""
    allowed_failures: Share = 0.0
    """Share of the episodes that may fail at a level that is passed."""
    bisections: Annotated[int, Accepted(0)] = 3
    """Number of halvings of the stretch between the last level passed and the first one failed."""
    tolerance: NotNegative = 0.15
    """Share of the baseline's by which a margin may be smaller."""
    limits: Mapping[str, NotNegative] = {}
    """By metric: an episode beyond this counts as failed too."""


class Suite(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A suite. Everything that an episode depends on is in its digest, so that a baseline is known to fit."""

    name: str
    summary: str = ""
    task: TaskName
    robot: str = ""
    """A shipped robot, or the path of a description or an MJCF, relative to the suite; empty: `--robot` says."""
    cases: tuple[Case, ...]
    seeds: Annotated[int, Accepted(2)]
    """Number of seeds of each case."""
    first_seed: Annotated[int, Accepted(0, below=SEEDS)] = 0
    tolerances: Mapping[str, Tolerance]
    """By metric, in the order of the report: these are judged. Failures always are, with tolerance 0 unless given."""
    confidence: Annotated[float, Accepted(0.5, below=1.0)] = 0.95
    """Probability that none of a candidate's intervals misses its change."""
    case_tolerance: NotNegative = 2.0
    """Tolerance for a single case, in multiples of that for the mean over all of them."""
    resamples: Annotated[int, Accepted(2)] = 10_000
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
    margins: Margins | None = None

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
        """Return the disturbance of each episode.

        Raises:
            InputError: naming the field that is wrong.
        """
        return Disturbance(Randomisation.of(self.randomisation), self.pushes)
