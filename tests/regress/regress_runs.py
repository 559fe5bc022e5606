"""Suites, episodes and policies for tests."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from models import contract_of, linear_model, saved

from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.regress.results import Episode, PolicyRun
from humanoid_sim.regress.suite import Case, Suite, Tolerance
from humanoid_sim.robots.description import load_robot

__all__ = ["episode", "run", "standing_policy", "tiny_suite", "values", "yaml_suite"]

SHORT = """\
name: short
summary: two short cases
task: tracking
robot: lite
seeds: 3
cases:
  - {name: wave, motion: wave, duration: 0.4}
  - {name: drum, motion: drum, duration: 0.3}
start: {joint_position: 0.05, joint_velocity: 0.1}
randomisation: {mass: [0.9, 1.1], command_delay: [0.0, 0.004], joint_position_noise: 0.002}
tolerances:
  body_position_error: {relative: 0.05}
  joint_error: {relative: 0.05}
  losses: {absolute: 0.01}
  faults: {absolute: 0.01}
"""


def yaml_suite(folder: Path, text: str = SHORT) -> Path:
    """A suite on disk."""
    path = folder / "suite.yaml"
    path.write_text(text)
    return path


def tiny_suite(cases: Sequence[str] = ("a", "b"), seeds: int = 10, **tolerances: Tolerance) -> Suite:
    """A tracking suite that is judged, not run."""
    return Suite(
        name="tiny",
        task="tracking",
        robot="lite",
        cases=tuple(Case(name=name, motion="wave") for name in cases),
        seeds=seeds,
        tolerances=tolerances or {"joint_error": Tolerance(relative=0.05)},
        resamples=2000,
    )


def episode(case: str, seed: int, metrics: Mapping[str, float | None], failure: str = "") -> Episode:
    """One that lasted a second."""
    return Episode(
        case=case, seed=seed, steps=50, duration=1.0, failure=failure, kind="lost" if failure else "", metrics=metrics
    )


def run(episodes: Iterable[Episode], name: str = "policy") -> PolicyRun:
    """Of any policy."""
    found = tuple(episodes)
    cases = {entry.case: f"digest of {entry.case}" for entry in found}
    return PolicyRun(name=name, source=f"{name}.onnx", sha256="0", suite="tiny", case_digests=cases, episodes=found)


def values(
    metric: str, of: Callable[[str, int], float | None], cases: Sequence[str], seeds: Iterable[int]
) -> PolicyRun:
    """A run with one metric, whose values a function gives."""
    seeds = list(seeds)
    return run(episode(case, seed, {metric: of(case, seed)}) for case in cases for seed in seeds)


def standing_policy(path: Path) -> Path:
    """A policy for the Lite's legs that always answers zeros: they hold their pose, which stands."""
    robot = load_robot("lite_biped")
    n = len(robot.joint_names)
    contract = contract_of(
        robot.joint_names,
        joint_stiffness=robot.stiffness,
        joint_damping=robot.damping,
        default_joint_pos=np.array(robot.initial_position),
        observation=("joint_pos", "joint_vel", "velocity_command"),
        command_names=("twist",),
        action_scale=0.25,
    )
    return saved(path, linear_model({STAMP_KEY: encode(contract)}, matrix=np.zeros((2 * n + 3, n))))
