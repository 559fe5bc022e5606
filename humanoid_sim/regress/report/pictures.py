"""Pictures of the worst episodes, drawn by the software painter: they need neither a display nor OpenGL."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image

from humanoid_sim.regress.episodes import Step, run_episodes
from humanoid_sim.regress.preparation import PreparedSuite, TestedPolicy
from humanoid_sim.regress.report.pairs import pair_up, trace, worst
from humanoid_sim.regress.results import Episode, MetricInfo, PolicyRun, Results
from humanoid_sim.rendering.offscreen import PoseRenderer
from humanoid_sim.simulation.model import build_model

_SIZE = (480, 400)
"""Pixels."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A robot at one moment of an episode."""

    title: str
    png: bytes

    @property
    def address(self) -> str:
        """The picture itself, as what an `img` element takes for a file's address."""
        return f"data:image/png;base64,{base64.b64encode(self.png).decode()}"


def worst_pictures(
    prepared: PreparedSuite,
    policies: Sequence[TestedPolicy],
    baseline: TestedPolicy | PolicyRun | None,
    results: Results,
) -> list[list[Picture]]:
    """For each candidate its worst episode at its worst moment; and the baseline then, where it is a checkpoint.

    Args:
        baseline: a checkpoint, or a stored run, of which nothing is drawn.
    """
    model = build_model(prepared.description)
    painter = PoseRenderer(lambda: model, *_SIZE, fastest=True)
    found = []
    for policy, candidate in zip(policies, results.candidates, strict=True):
        (pair,) = worst(pair_up(candidate.run, results.baseline), results.metrics[0], 1)
        moment = worst_moment(pair.candidate, results.metrics[0], results.suite.policy_dt)
        pictures = []
        for shown in (baseline, policy):
            if isinstance(shown, TestedPolicy):
                case = next(case for case in shown.cases if case.case.name == pair.candidate.case)
                steps: list[Step] = []
                run_episodes(case, [pair.candidate.seed], prepared.suite.disturbance, threads=1, watch=steps)
                step = min(moment, len(steps) - 1)
                file = io.BytesIO()
                Image.fromarray(painter.draw(steps[step].qpos[0])).save(file, "PNG")
                time = step * case.scenario.contract.policy_dt
                pictures.append(Picture(f"{shown.name} at {time:.2f} s", file.getvalue()))
        found.append(pictures)
    painter.close()
    return found


def worst_moment(episode: Episode, metric: MetricInfo, policy_dt: float) -> int:
    """Return the policy step to look at: the last of an episode that failed, else where a metric's trace is worst."""
    if episode.failure or metric.name not in episode.traces:
        return episode.steps
    values = trace(episode, metric.name) * (1.0 if metric.better == "lower" else -1.0)
    known = np.where(np.isfinite(values), values, -np.inf)
    return round(episode.trace_times[int(known.argmax())] / policy_dt)
