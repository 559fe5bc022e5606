"""Run episodes: one policy, one case, a batch of seeds at once.

Every episode is a function of policy, case and seed alone: start, disturbances and noise are drawn from a key of the
case's name and the seed, inference and physics give each robot what it would get alone. So the episodes may be run in
any company, on any machine of a kind, and compared seed by seed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import closing, suppress

import numpy as np
import numpy.typing as npt

from humanoid_sim.evaluation.feet import find_feet
from humanoid_sim.evaluation.rollout import ClosedLoop, sample_step
from humanoid_sim.mit import Float32Array, FloatArray
from humanoid_sim.regress.measures import figures, step_rows
from humanoid_sim.regress.metrics import METRICS
from humanoid_sim.regress.preparation import PreparedCase
from humanoid_sim.regress.results import Episode
from humanoid_sim.simulation.batch import BatchSimulation, Randomisation

_PUSH_STREAM = 1
"""Stream of random numbers apart from the draws of the start, which have the same seed."""


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
        self._feet = find_feet(scenario.description) if suite.task == "velocity" else None
        bodies = scenario.bodies if suite.task == "piano" else scenario.contract.body_names
        options = {
            **scenario.robot_options(),
            "velocity_at": scenario.contract.velocity_points,
            "bodies": bodies if self._feet is None else self._feet.bodies,
        }
        self.simulation = BatchSimulation(
            scenario.description,
            len(seeds),
            **options,
            threads=threads,
            randomisation=Randomisation.of(suite.randomisation),
            seeds=self._keys,
        )

    def run(self) -> list[Episode]:
        """All episodes from their start to their end."""
        case, simulation, count = self.case, self.simulation, len(self.seeds)
        task, measured = case.scenario.task, []
        numbers = np.stack([np.random.default_rng(int(key)).random(task.draws) for key in self._keys])
        start = task.start(numbers)
        simulation.reset(
            joint_position=start.joint_position, joint_velocity=start.joint_velocity, base_yaw=start.base_yaw
        )
        directions = [np.random.default_rng([_PUSH_STREAM, int(key)]) for key in self._keys]
        loop = ClosedLoop(simulation, case.scenario.wiring, np.tile(case.case.command or (0.0, 0.0, 0.0), (count, 1)))
        alive, steps = np.ones(count, dtype=np.bool_), np.zeros(count, dtype=np.int64)
        failures: dict[int, tuple[str, str]] = {}

        def infer(observation: Float32Array, frame: npt.NDArray[np.integer]) -> Float32Array:
            """One inference each, as on the robot: a model may answer otherwise in a batch."""
            actions = np.full((count, len(loop.action[0])), np.nan, dtype=np.float32)
            for i in np.flatnonzero(alive):
                with suppress(Exception):  # of ONNX Runtime: NaN ends this episode, and no other
                    actions[i] = case.scenario.policy(observation[i], int(frame[i]))
            return actions

        for step in range(case.steps):
            action, accepted = loop.infer(infer)
            failures |= {i: ("fault", loop.problem(action, i)) for i in np.flatnonzero(alive & ~accepted).tolist()}
            alive = alive & accepted
            if not alive.any():
                break
            held = np.where(alive[:, None], action, loop.memory.last_action)
            command = loop.act(held, wrench=self._wrench(step, directions), where=alive)
            for i in np.flatnonzero(alive & simulation.fault).tolist():
                failures[i] = "fault", "the simulation diverged: its state is no longer finite"
            alive = alive & ~simulation.fault
            sample = sample_step(loop, simulation, np.full(count, step + 1))
            measured.append(step_rows(case, self._feet, sample, command, simulation))
            steps += alive
            lost = alive & task.judge(sample).terminated
            failures |= {i: ("lost", task.describe_failure(sample, i)) for i in np.flatnonzero(lost).tolist()}
            alive = alive & ~lost
            if not alive.any():
                break
        found = figures(case, self._feet, measured) if alive.any() else [{}] * count
        return [self._episode(i, int(steps[i]), *failures.get(i, ("", "")), found[i]) for i in range(count)]

    def _episode(self, i: int, steps: int, kind: str, failure: str, found: Mapping[str, float]) -> Episode:
        """Return what came of episode `i`; one that failed has no errors to compare: what counts is that it failed."""
        ends = {
            "faults": float(kind == "fault"),
            "losses": float(kind == "lost"),
            "falls": float(kind == "lost"),
            "survival": steps / self.case.steps,
        }
        known = {**({} if kind else found), **ends}
        return Episode(
            case=self.case.case.name,
            seed=self.seeds[i],
            steps=steps,
            duration=steps * self.case.scenario.contract.policy_dt,
            failure=failure,
            kind=kind,  # type: ignore[arg-type]  # one of the two above, or empty
            metrics={name: known.get(name) for name in METRICS[self.case.suite.task]},
        )

    def _wrench(self, step: int, directions: Sequence[np.random.Generator]) -> FloatArray | None:
        """Return the push of this policy step, shape (N, 6), N and N·m, world frame; None where none is pushed.

        The momentum for the robot's whole mass, spread over one policy step, in a direction that is drawn.
        """
        pushes, simulation = self.case.suite.pushes, self.simulation
        if pushes is None:
            return None
        period = simulation.control_period
        interval = max(round(pushes.interval / period), 1)
        if (step + interval // 2) % interval:
            return None
        masses = np.array([simulation.model(i).body_subtreemass[0] for i in range(simulation.count)])
        force = masses * pushes.speed / period
        angle = np.array([generator.uniform(-np.pi, np.pi) for generator in directions])
        wrench = np.zeros((len(angle), 6))
        wrench[:, 0], wrench[:, 1] = force * np.cos(angle), force * np.sin(angle)
        return wrench
