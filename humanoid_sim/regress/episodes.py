"""Run episodes: one policy, one case, a batch of seeds at once.

Every episode is a function of policy, case and seed alone: start, disturbances and noise are drawn from a key of the
case's name and the seed, inference and physics give each robot what it would get alone. So the episodes may be run in
any company, on any machine of a kind, and compared seed by seed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.evaluation.feet import Feet
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.evaluation.step import StepSample
from humanoid_sim.evaluation.step_metrics import METRICS, describe_failure, length, rms
from humanoid_sim.mit import BoolArray, Float32Array, FloatArray, MITCommand
from humanoid_sim.regress.preparation import PreparedCase
from humanoid_sim.regress.results import Episode, Failure
from humanoid_sim.regress.suite import REACHED, metrics_of
from humanoid_sim.simulation.batch_sim import BatchSim

_WINDOW = 1.0  # s over which a walking robot's velocity is averaged: one or two strides, so that sway does not count


def episode_keys(case: str, seeds: Sequence[int]) -> npt.NDArray[np.uint64]:
    """Return the seeds of everything random in the episodes of a case, shape (N,): no two cases share their draws."""
    texts = (f"{case}\0{seed}".encode() for seed in seeds)
    return np.array([int.from_bytes(hashlib.sha256(text).digest()[:8], "little") for text in texts], dtype=np.uint64)


def run_episodes(case: PreparedCase, seeds: Sequence[int], *, threads: int | None = None) -> list[Episode]:
    """Run one episode per seed and return them in the seeds' order; `threads` step physics, None: one per processor."""
    batch = EpisodeBatch(case, seeds, threads)
    with closing(batch.simulation):
        return batch.run()


class EpisodeBatch:
    """Episodes that are run together; they can be run again. Not thread-safe."""

    def __init__(self, case: PreparedCase, seeds: Sequence[int], threads: int | None = None) -> None:
        """Build the simulation, which has threads to be closed; arguments as of `run_episodes`."""
        scenario, suite = case.scenario, case.suite
        self.case, self.seeds = case, seeds
        self._keys = episode_keys(case.case.name, seeds)
        self._feet = Feet(scenario.description) if suite.task == "velocity" else None
        bodies = scenario.sim_config.bodies if self._feet is None else self._feet.bodies
        self.simulation = BatchSim(
            scenario.description,
            len(seeds),
            replace(scenario.sim_config, bodies=bodies),
            implicit=suite.implicit,
            threads=threads,
            randomisation=suite.randomisation,
            seeds=self._keys,
        )

    def run(self) -> list[Episode]:
        case, simulation, count = self.case, self.simulation, len(self.seeds)
        task, starts, measured = case.scenario.task, case.scenario.starts, []
        simulation.reseed(self._keys)
        start = starts(np.stack([generator.random(starts.draws) for generator in simulation.generators]))
        simulation.reset(qpos=start.qpos, qvel=start.qvel)
        commands = np.tile(case.case.command or (0.0, 0.0, 0.0), (count, 1))
        loop = ClosedLoop(simulation, case.scenario.wiring, commands)
        alive, steps = np.ones(count, dtype=np.bool_), np.zeros(count, dtype=np.int64)
        failures: dict[int, tuple[Failure, str]] = {}

        for step in range(case.steps):
            action = self._infer(loop, alive)
            accepted = loop.wiring.accepts(action) & np.isfinite(loop.observation).all(axis=-1)
            for i in np.flatnonzero(alive & ~accepted).tolist():
                seen = loop.wiring.observation_problem(loop.observation[i])
                failures[i] = "fault", seen or loop.wiring.action_problem(action[i])
            alive = alive & accepted
            if not alive.any():
                break
            held = np.where(alive[:, None], action, loop.memory.last_action)
            command = loop.act(held, where=alive)
            for i in np.flatnonzero(alive & simulation.fault).tolist():
                failures[i] = "fault", "the simulation diverged: its state is no longer finite"
            alive = alive & ~simulation.fault
            sample = loop.sample(np.full(count, step + 1))
            measured.append(self._step_rows(sample, command))
            steps += alive
            lost = alive & task.failed(sample)
            for i in np.flatnonzero(lost).tolist():
                failures[i] = "lost", describe_failure(task.context, sample, i)
            alive = alive & ~lost
        found = self._figures(measured) if alive.any() else [{}] * count
        return [self._episode(i, int(steps[i]), *failures.get(i, ("", "")), found[i]) for i in range(count)]

    def _infer(self, loop: ClosedLoop, alive: BoolArray) -> Float32Array:
        """One inference each, as on the robot: a model may answer otherwise in a batch. NaN where it raises."""
        actions = np.full(loop.memory.last_action.shape, np.nan, dtype=np.float32)
        for i in np.flatnonzero(alive):
            with suppress(Exception):  # of ONNX Runtime: NaN ends this episode, and no other
                actions[i] = self.case.scenario.policy(loop.observation[i], int(np.asarray(loop.memory.frame)[i]))
        return actions

    def _step_rows(self, sample: StepSample, command: MITCommand) -> dict[str, npt.NDArray[Any]]:
        """Measure one policy step, shape (N, ...) by name; the sample is without the sensors' noise."""
        context, task = self.case.scenario.task.context, self.case.suite.task
        names = [name for name in metrics_of(task) if name in METRICS and METRICS[name].needs in context.parts]
        rows: dict[str, npt.NDArray[Any]] = {name: METRICS[name].values(context, sample) for name in names}
        rows["position"] = command.position
        if self._feet is not None and sample.base is not None:
            rows["velocity"] = sample.base.planar_velocity
            rows["soles"] = self._feet.place(*self.simulation.body_poses())
        elif task == "piano":
            rows["touch"] = self.simulation.key_force
        return rows

    def _figures(self, measured: Sequence[Mapping[str, npt.NDArray[Any]]]) -> list[dict[str, float]]:
        """Return the metrics of each of N whole episodes by name, without those that are not there."""
        suite, case, period = self.case.suite, self.case.case, self.simulation.control_period
        command, piano = np.array(case.command or (0.0, 0.0, 0.0)), self.case.scenario.description.piano
        rows = {name: np.stack([step[name] for step in measured]) for name in measured[0]}  # shape (steps, N, ...)
        rows["action_rate"] = rms(np.diff(rows["position"], axis=0) / period)
        if self._feet is not None:
            rows["slip"] = self._feet.slip(rows["soles"][:-1], rows["soles"][1:], period)
            skip, window = round(suite.settle / period), round(_WINDOW / period)
            off = _averaged(rows["velocity"], window)[skip:] - command
            rows["velocity"] = rows["velocity"][skip:]
            rows["velocity_error"], rows["yaw_rate_error"] = length(off[..., :2]), np.abs(off[..., 2])
        found = []
        for i in range(len(self.seeds)):
            episode: dict[str, float] = {}
            for metric in metrics_of(suite.task).values():
                if metric.summary != "episode" and metric.name in rows:
                    values = rows[metric.name][:, i]
                    values = values[~np.isnan(values)]  # in one piece: sums in one order, whatever N is
                    if values.size:
                        episode[metric.name] = float(rms(values) if metric.summary == "rms" else values.mean())
            for axis, name in enumerate(REACHED):
                if case.moves[axis]:
                    episode[name] = min(float(rows["velocity"][:, i, axis].mean() / command[axis]), 1.0)
            if suite.task == "piano" and piano is not None:
                episode["key_force"] = float(rows["touch"][:, i].max())
                episode["hard_touches"] = float(episode["key_force"] > piano.key_force_limit)
            found.append(episode)
        return found

    def _episode(self, i: int, steps: int, kind: Failure, failure: str, found: Mapping[str, float]) -> Episode:
        """Return episode `i`; one that failed has no errors to compare: what counts is that it failed."""
        known = {**({} if kind else found), "faults": float(kind == "fault"), "survival": steps / self.case.steps}
        known |= dict.fromkeys(("losses", "falls"), float(kind == "lost"))
        return Episode(
            case=self.case.case.name,
            seed=self.seeds[i],
            steps=steps,
            duration=steps * self.simulation.control_period,
            failure=failure,
            kind=kind,
            metrics={name: known.get(name) for name in metrics_of(self.case.suite.task)},
        )


def _averaged(velocity: FloatArray, window: int) -> FloatArray:
    """Return the mean of each step and those before it, of at most `window`; shape (steps, N, 3)."""
    total = np.cumsum(velocity, axis=0)
    total[window:] -= total[:-window].copy()
    averaged: FloatArray = total / np.minimum(np.arange(1, len(total) + 1), window).reshape(-1, 1, 1)
    return averaged
