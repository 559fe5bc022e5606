"""What each policy step of a batch of N robots is measured by, and how the steps of an episode make one number."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.envs.tasks.tracking import MotionTask, TrackingTask
from humanoid_sim.evaluation.errors import length, rms
from humanoid_sim.evaluation.feet import Feet
from humanoid_sim.evaluation.piano_score import score, step_ratios
from humanoid_sim.evaluation.rollout import StepSample
from humanoid_sim.mit import KEY_PRESSED, FloatArray, MITCommand
from humanoid_sim.regress.metrics import METRICS, REACHED, has_metric
from humanoid_sim.regress.preparation import PreparedCase
from humanoid_sim.simulation.batch import BatchSimulation

Rows = Mapping[str, npt.NDArray[Any]]
"""Values of a policy step by name, shape (N, ...)."""

_WINDOW = 1.0
"""s over which a walking robot's velocity is averaged: one or two strides, so that their sway does not count."""


def step_rows(
    case: PreparedCase, feet: Feet | None, sample: StepSample, command: MITCommand, robots: BatchSimulation
) -> Rows:
    """Measure one policy step; the sample is what came of the command, without the sensors' noise."""
    task = case.scenario.task
    rows: dict[str, npt.NDArray[Any]] = {"effort": rms(sample.torque), "position": command.position}
    if feet is not None and sample.base is not None:
        rows["tilt"], rows["velocity"] = sample.base.tilt, sample.base.planar_velocity
        rows["power"] = np.abs(sample.torque * sample.state.joint_velocity).sum(axis=-1)
        rows["soles"] = feet.place(*robots.body_poses())
    elif case.suite.task == "piano" and case.target is not None:
        rows["down"] = down = sample.state.extern[KEY_PRESSED].value > 0.5
        rows["wanted"] = wanted = case.target[np.minimum(sample.frame, len(case.target) - 1)] > 0.5
        rows["precision"], rows["recall"], rows["f1"] = step_ratios(down, wanted)
        rows["touch"] = robots.key_force
        return rows
    elif isinstance(task, TrackingTask):
        rows["body_position_error"] = rms(task.position_error(sample.body_position, sample.frame))
        rows["body_orientation_error"] = rms(task.orientation_error(sample.body_quaternion, sample.frame))
    elif isinstance(task, MotionTask) and task.has_anchor:
        error = task.anchor_error(sample)
        rows["body_position_error"], rows["body_orientation_error"] = error.distance, error.angle
    if case.target is not None:
        target = case.target[task.reference.clamp(sample.frame)]
        rows["joint_error"] = rms(sample.state.joint_position - target)
    return rows


def figures(case: PreparedCase, feet: Feet | None, steps: Sequence[Rows]) -> list[dict[str, float]]:
    """Return the metrics of each of N whole episodes by name, without those that are not there."""
    rows = {name: np.stack([step[name] for step in steps]) for name in steps[0]}  # shape (steps, N, ...)
    period, skip = case.scenario.contract.policy_dt, 0
    piano = case.scenario.description.piano if case.suite.task == "piano" else None
    values = {**rows, "action_rate": rms(np.diff(rows["position"], axis=0) / period)}
    if feet is not None:
        values["slip"] = feet.slip(rows["soles"][:-1], rows["soles"][1:], period)
        skip = round(case.suite.settle / period)
        off = _averaged(rows["velocity"], round(_WINDOW / period))[skip:] - np.array(case.case.command)
        values["velocity_error"], values["yaw_rate_error"] = length(off[..., :2]), np.abs(off[..., 2])
    found = []
    for i in range(rows["effort"].shape[1]):
        episode = {}
        for metric in METRICS[case.suite.task].values():
            if metric.summary != "episode" and metric.name in values:
                of_steps = values[metric.name][:, i]
                known = of_steps[~np.isnan(of_steps)]
                if known.size:
                    episode[metric.name] = float(rms(known) if metric.summary == "rms" else known.mean())
        if feet is not None:
            mean = rows["velocity"][skip:, i].mean(axis=0)
            for axis, name in enumerate(REACHED):
                if case.case.command is not None and has_metric(name, case.case.command):
                    episode[name] = min(float(mean[axis] / case.case.command[axis]), 1.0)
        elif piano is not None:
            episode["note_f1"] = score(rows["down"][:, i], rows["wanted"][:, i], period).notes.f1
            episode["key_force"] = float(rows["touch"][:, i].max())
            episode["hard_touches"] = float(episode["key_force"] > piano.key_force_limit)
        found.append(episode)
    return found


def _averaged(velocity: FloatArray, window: int) -> FloatArray:
    """Return the mean of each step and those before it, of at most `window`; shape (steps, N, 3)."""
    total = np.cumsum(velocity, axis=0)
    total[window:] -= total[:-window].copy()
    averaged: FloatArray = total / np.minimum(np.arange(1, len(total) + 1), window).reshape(-1, 1, 1)
    return averaged
