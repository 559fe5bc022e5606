"""Run episodes: one policy, one case, a batch of seeds at once.

Every episode is a function of policy, case and seed alone: start, disturbances and noise are drawn from a key of the
case's name and the seed, inference and physics give each robot what it would get alone. So the episodes may be run in
any company, on any machine of a kind, and compared seed by seed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from humanoid_sim.evaluation.feet import find_feet
from humanoid_sim.evaluation.rollout import ClosedLoop, sample_step
from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.regress.metrics import METRICS, Measures, PianoMeasures, TrackingMeasures, VelocityMeasures, summarise
from humanoid_sim.regress.preparation import PreparedCase
from humanoid_sim.regress.results import Episode
from humanoid_sim.regress.suite import Disturbance, Pushes
from humanoid_sim.simulation.batch import BatchSimulation

Float32Array = npt.NDArray[np.float32]
_PUSH_STREAM = 1
"""Stream of random numbers apart from the draws of the start, which have the same seed."""


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One policy step of a batch as the control stack saw it, for recordings."""

    state: MITState
    """State that the policy was shown."""
    action: Float32Array | None
    """Actions, shape (N, m), raw, whatever the policy answered; None: the episodes have ended in this state."""
    qpos: FloatArray
    """Shape (N, nq), MuJoCo's generalised position at that state."""
    qvel: FloatArray
    """Shape (N, nv), MuJoCo's generalised velocity."""


def episode_keys(case: str, seeds: Sequence[int]) -> npt.NDArray[np.uint64]:
    """Return the seeds of everything random in the episodes of a case, shape (N,): no two cases share their draws."""
    texts = (f"{case}\0{seed}".encode() for seed in seeds)
    return np.array([int.from_bytes(hashlib.sha256(text).digest()[:8], "little") for text in texts], dtype=np.uint64)


def run_episodes(
    case: PreparedCase,
    seeds: Sequence[int],
    disturbance: Disturbance,
    *,
    threads: int | None = None,
    watch: list[Step] | None = None,
) -> list[Episode]:
    """Run one episode per seed, and return them in the seeds' order.

    Args:
        threads: that step physics; None for one per processor.
        watch: is filled with every policy step; None: nobody watches.
    """
    batch = EpisodeBatch(case, seeds, disturbance, threads)
    with closing(batch.simulation):
        return batch.run(watch)


class EpisodeBatch:
    """Episodes that are run together; they can be run again. Not thread-safe."""

    def __init__(
        self, case: PreparedCase, seeds: Sequence[int], disturbance: Disturbance, threads: int | None = None
    ) -> None:
        """Build the simulation, which has threads to be closed; arguments as of `run_episodes`."""
        scenario, contract = case.scenario, case.scenario.contract
        self.case, self.seeds = case, seeds
        self._keys = episode_keys(case.case.name, seeds)
        self._pushes = disturbance.pushes
        self._feet = find_feet(scenario.description) if case.suite.task == "velocity" else None
        bodies = scenario.bodies if case.suite.task == "piano" else contract.body_names
        if self._feet is not None:
            bodies = self._feet.bodies
        self.simulation = BatchSimulation(
            scenario.description,
            len(seeds),
            **{**scenario.robot_options(), "velocity_at": contract.velocity_points, "bodies": bodies},
            threads=threads,
            randomisation=disturbance.randomisation,
            seeds=self._keys,
        )

    def run(self, watch: list[Step] | None = None) -> list[Episode]:
        """All episodes from their start to their end; `watch` is filled with every policy step."""
        case, simulation, count = self.case, self.simulation, len(self.seeds)
        task = case.scenario.task
        measures = self._measures()
        numbers = np.stack([np.random.default_rng(int(key)).random(task.draws) for key in self._keys])
        start = task.start(numbers)
        simulation.reset(
            joint_position=start.joint_position, joint_velocity=start.joint_velocity, base_yaw=start.base_yaw
        )
        directions = [np.random.default_rng([_PUSH_STREAM, int(key)]) for key in self._keys]
        loop = ClosedLoop(simulation, case.scenario.wiring, np.tile(case.case.command or (0.0, 0.0, 0.0), (count, 1)))
        alive, steps = np.ones(count, dtype=np.bool_), np.zeros(count, dtype=np.int64)
        failures: dict[int, tuple[str, str]] = {}
        for step in range(case.steps):
            action, accepted = loop.infer(case.policy)
            if watch is not None:
                watch.append(Step(loop.state, action, simulation.qpos.copy(), simulation.qvel.copy()))
            failures |= {i: ("fault", loop.problem(action, i)) for i in np.flatnonzero(alive & ~accepted).tolist()}
            alive = alive & accepted
            if not alive.any():
                break
            held = np.where(alive[:, None], action, loop.memory.last_action)
            wrench = None if self._pushes is None else self._wrench(self._pushes, step, directions)
            command = loop.act(held, wrench=wrench, where=alive)
            for i in np.flatnonzero(alive & simulation.fault).tolist():
                failures[i] = "fault", "the simulation diverged: its state is no longer finite"
            alive = alive & ~simulation.fault
            sample = sample_step(loop, simulation, np.full(count, step + 1))
            measures.add(step, sample, command, simulation)
            steps += alive
            lost = alive & task.judge(sample).terminated
            failures |= {i: ("lost", task.describe_failure(sample, i)) for i in np.flatnonzero(lost).tolist()}
            alive = alive & ~lost
            if not alive.any():
                break
        if watch is not None and watch[-1].state is not loop.state:
            watch.append(Step(loop.state, None, simulation.qpos.copy(), simulation.qvel.copy()))
        rows = measures.step_values()
        return [
            self._episode(
                i,
                steps=int(steps[i]),
                failure=failures.get(i, ("", "")),
                rows={name: values[: steps[i], i] for name, values in rows.items()},
                whole=measures.of_episode(i, int(steps[i])),
            )
            for i in range(count)
        ]

    def _measures(self) -> Measures:
        case, count = self.case, len(self.seeds)
        task = case.scenario.task
        if self._feet is not None:
            return VelocityMeasures(task, self._feet, case.suite.settle, case.steps, count)
        if case.suite.task == "piano":
            piano = case.description.piano
            assert case.motion is not None and piano is not None  # noqa: PT018 - a piano suite has songs, for pianos
            return PianoMeasures(task, case.motion.frames, piano.key_force_limit, case.steps, count)
        return TrackingMeasures(task, case.joint_reference, case.steps, count)

    def _wrench(self, pushes: Pushes, step: int, directions: Sequence[np.random.Generator]) -> FloatArray | None:
        """Return the push of this policy step, shape (N, 6), N and N·m, world frame; None where none is pushed.

        The momentum for the robot's whole mass, spread over one policy step, in a direction that is drawn.
        """
        simulation, period = self.simulation, self.simulation.control_period
        interval = max(round(pushes.interval / period), 1)
        if (step + interval // 2) % interval:
            return None
        masses = np.array([simulation.model(i).body_subtreemass[0] for i in range(simulation.count)])
        force = masses * pushes.speed / period
        angle = np.array([generator.uniform(-np.pi, np.pi) for generator in directions])
        wrench = np.zeros((len(angle), 6))
        wrench[:, 0], wrench[:, 1] = force * np.cos(angle), force * np.sin(angle)
        return wrench

    def _episode(
        self, i: int, steps: int, failure: tuple[str, str], rows: Mapping[str, FloatArray], whole: Mapping[str, float]
    ) -> Episode:
        kind, reason = failure
        ends = {
            "faults": float(kind == "fault"),
            "losses": float(kind == "lost"),
            "falls": float(kind == "lost"),
            "survival": steps / self.case.steps,
        }
        metrics: dict[str, float | None] = {}
        for name, metric in METRICS[self.case.suite.task].items():
            if metric.summary == "episode":
                metrics[name] = ends.get(name, None if kind else whole.get(name))
            else:
                # An episode that was cut short has no errors to compare: what counts of it is that it failed.
                metrics[name] = None if kind else summarise(metric.summary, rows[name])
        return Episode(
            case=self.case.case.name,
            seed=self.seeds[i],
            steps=steps,
            duration=steps * self.case.scenario.contract.policy_dt,
            failure=reason,
            kind=kind,  # type: ignore[arg-type]  # one of the two above, or empty
            metrics=metrics,
        )
