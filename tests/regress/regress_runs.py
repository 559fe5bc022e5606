"""Suites, policies that are worse on purpose, and runs with given figures."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
from onnx import helper, numpy_helper

from humanoid_sim.assets import asset_path
from humanoid_sim.policy.readers.own import GOLDEN_KEY
from humanoid_sim.regress.preparation import PreparedCase, prepare_policy, prepare_suite
from humanoid_sim.regress.results import Episode, PolicyRun
from humanoid_sim.regress.suite import Case, Suite, Tolerance, load_suite

SAMPLE, WALKER = (asset_path("policies", f"{name}.onnx") for name in ("lite_tracking", "lite_biped_velocity"))
SHORT = """\
name: short
task: tracking
robot: lite
seeds: 6
cases:
  - {name: wave, motion: wave, duration: 0.2}
  - {name: drum, motion: drum, duration: 0.1}
start: {joint_position: 0.05, joint_velocity: 0.1}
randomisation: {mass: [0.9, 1.1], delay: [0.0, 0.004]}
tolerances:
  body_position_error: {relative: 0.05}
  effort: {relative: 0.05}
  losses: {absolute: 0.01}
"""


def yaml_suite(folder: Path, text: str = SHORT) -> Path:
    """A suite on disk."""
    path = folder / "suite.yaml"
    path.write_text(text)
    return path


def prepared(suite: Suite | Path, policy: Path = SAMPLE, robot: str | None = None) -> PreparedCase:
    """The first case of a suite with a policy."""
    loaded, folder = (suite, Path()) if isinstance(suite, Suite) else load_suite(str(suite))
    return prepare_policy(prepare_suite(loaded, folder, robot), policy)[0]


def changed_copy(output: Path, operator: str, value: np.ndarray, **attributes: int) -> Path:
    """The sample policy, whose action goes through one more operator with a constant, such as `Add` or `Gather`."""
    model = onnx.load(str(SAMPLE))
    kept = {entry.key: entry.value for entry in model.metadata_props if entry.key != GOLDEN_KEY}
    helper.set_model_props(model, kept)
    name = model.graph.output[0].name
    for node in model.graph.node:
        node.output[:] = ["before_the_change" if given == name else given for given in node.output]
    model.graph.initializer.append(numpy_helper.from_array(value, "of_the_change"))
    model.graph.node.append(helper.make_node(operator, ["before_the_change", "of_the_change"], [name], **attributes))
    onnx.save(model, str(output))
    return output


def tiny_suite(**tolerances: Tolerance) -> Suite:
    """A tracking suite of two cases that is judged, not run."""
    return Suite(
        name="tiny",
        task="tracking",
        cases=tuple(Case(name=name, motion="wave") for name in "ab"),
        seeds=12,
        tolerances=tolerances or {"effort": Tolerance(relative=0.05)},
    )


def given(figure: Callable[[str, int], float | None], cases: str = "ab", seeds: int = 12) -> PolicyRun:
    """A run whose efforts a function of case and seed gives; None: a fault."""
    episodes = []
    for case in cases:
        for seed in range(seeds):
            value = figure(case, seed)
            metrics = {"effort": value, "losses": 0.0, "faults": float(value is None)}
            failure, kind = ("action is nan", "fault") if value is None else ("", "")
            episodes.append(
                Episode(case=case, seed=seed, steps=50, duration=1.0, failure=failure, kind=kind, metrics=metrics)
            )
    return PolicyRun(name="new", source="new.onnx", sha256="0", case_digests={}, episodes=tuple(episodes))
