"""Run episodes: one policy, one case, a batch of seeds at once.

Every episode is a function of policy, case and seed alone: start, disturbances and noise are drawn from a key of the
case's name and the seed, inference and physics give each robot what it would get alone. So the episodes may be run in
any company, on any machine of a kind, and compared seed by seed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.policy_step import PolicyMemory
from humanoid_sim.evaluation.sample import StepSample
from humanoid_sim.mit import VELOCITY_COMMAND, Extern, FloatArray, MITCommand, MITState
from humanoid_sim.regress.arena import Arena
from humanoid_sim.regress.feet import find_feet
from humanoid_sim.regress.measures import Measures, TrackingMeasures, VelocityMeasures
from humanoid_sim.regress.metrics import METRICS, summarise
from humanoid_sim.regress.pushes import PushSchedule
from humanoid_sim.regress.results import Episode
from humanoid_sim.regress.suite import Pushes, Suite
from humanoid_sim.regress.traces import thinned
from humanoid_sim.simulation.batch import BatchSimulation, Randomisation

__all__ = ["Disturbance", "EpisodeBatch", "Step", "episode_keys", "run_episodes"]

Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What disturbs the robots, beside where they start."""

    randomisation: Randomisation
    pushes: Pushes | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """One policy step of a batch as the control stack saw it, for recordings."""

    state: MITState
    """That the policy was shown."""
    action: Float32Array | None
    """Shape (N, m), raw, whatever the policy answered; None: the episodes have ended in this state."""
    qpos: FloatArray
    """Shape (N, nq), MuJoCo's generalised position at that state."""
    qvel: FloatArray
    """Shape (N, nv), MuJoCo's generalised velocity."""


def episode_keys(case: str, seeds: Sequence[int]) -> npt.NDArray[np.uint64]:
    """The seeds of everything random in the episodes of a case, shape (N,): no two cases share their draws."""
    texts = (f"{case}\0{seed}".encode() for seed in seeds)
    return np.array([int.from_bytes(hashlib.sha256(text).digest()[:8], "little") for text in texts], dtype=np.uint64)


def run_episodes(
    suite: Suite,
    arena: Arena,
    seeds: Sequence[int],
    disturbance: Disturbance,
    *,
    threads: int | None = None,
    watch: list[Step] | None = None,
) -> list[Episode]:
    """Run one episode per seed.

    Args:
        suite: that the case is of.
        arena: policy and case.
        seeds: of the episodes.
        disturbance: of the robots.
        threads: that step physics; None for one per processor.
        watch: is filled with every policy step; None: nobody watches.

    Returns:
        The episodes in the order of their seeds.
    """
    batch = EpisodeBatch(suite, arena, seeds, disturbance, threads)
    try:
        batch.run(watch)
    finally:
        batch.close()
    return batch.episodes()


class EpisodeBatch:
    """Episodes that are run together; they can be run again. Not thread-safe."""

    def __init__(
        self, suite: Suite, arena: Arena, seeds: Sequence[int], disturbance: Disturbance, threads: int | None = None
    ) -> None:
        """Build the simulation; arguments as of `run_episodes`."""
        setting, contract = arena.setting, arena.setting.contract
        self.suite, self.arena, self.seeds = suite, arena, seeds
        self._keys = episode_keys(arena.case.name, seeds)
        self._disturbance = disturbance
        self._feet = find_feet(setting.description) if suite.task == "velocity" else None
        self.simulation = BatchSimulation(
            setting.description,
            len(seeds),
            control_period=contract.policy_dt,
            physics_timestep=setting.physics_timestep,
            threads=threads,
            anchor_body=contract.anchor_body,
            bodies=contract.body_names if self._feet is None else self._feet.bodies,
            randomisation=disturbance.randomisation,
            seeds=self._keys,
        )
        self._prepare()

    def _prepare(self) -> None:
        """Nothing measured, nobody failed."""
        count, pushes = len(self.seeds), self._disturbance.pushes
        self._measures: Measures = (
            TrackingMeasures(self.arena, count)
            if self._feet is None
            else VelocityMeasures(self.arena, count, self._feet, self.suite.settle)
        )
        self._pushes = None if pushes is None else PushSchedule(pushes, self.simulation, self._keys)
        self._alive = np.ones(count, dtype=np.bool_)
        self._steps = np.zeros(count, dtype=np.int64)
        self._failures: dict[int, tuple[str, str]] = {}

    def run(self, watch: list[Step] | None = None) -> None:
        """All episodes from their start to their end; `watch` is filled with every policy step."""
        arena, simulation = self.arena, self.simulation
        wiring, policy = arena.setting.wiring, arena.subject.policy
        command = np.array(arena.case.command or (0.0, 0.0, 0.0))
        commands = np.broadcast_to(command, (len(self.seeds), 3))
        self._prepare()
        self._place()
        state = self._commanded(commands)
        memory = wiring.activate(state)
        for step in range(arena.steps):
            observation, memory = wiring.observe(memory, state)
            action = policy(observation, np.asarray(memory.frame))
            if watch is not None:
                watch.append(Step(state, action, simulation.qpos.copy(), simulation.qvel.copy()))
            self._refuse(observation, action)
            if not self._alive.any():
                return
            previous = memory.last_action
            memory, order = wiring.act(memory, np.where(self._alive[:, None], action, previous))
            wrench = None if self._pushes is None else self._pushes.wrench(step)
            simulation.step(order, wrench=wrench, where=self._alive)
            for i in np.flatnonzero(self._alive & simulation.fault).tolist():
                self._fail(i, "fault", "the simulation diverged: its state is no longer finite")
            self._judge(step, self._sample(step, memory, previous, commands), order)
            state = self._commanded(commands)
            if not self._alive.any():
                break
        if watch is not None:
            watch.append(Step(state, None, simulation.qpos.copy(), simulation.qvel.copy()))

    def _refuse(self, observation: Float32Array, action: Float32Array) -> None:
        """End the episodes whose observation or action the controller would not take."""
        wiring = self.arena.setting.wiring
        refused = self._alive & ~(wiring.accepts(action) & np.isfinite(observation).all(axis=-1))
        for i in np.flatnonzero(refused).tolist():
            self._fail(i, "fault", wiring.observation_problem(observation[i]) or wiring.action_problem(action[i]))

    def _place(self) -> None:
        """Start every episode where its seed has it."""
        task = self.arena.task
        numbers = np.stack([np.random.default_rng(int(key)).random(task.draws) for key in self._keys])
        qpos, qvel = self.arena.setting.generalised(task.start(numbers))
        self.simulation.reset(qpos=qpos, qvel=qvel)

    def _commanded(self, commands: FloatArray) -> MITState:
        """The robots' state with the velocity command, which is never too old."""
        state = self.simulation.state()
        return replace(state, extern={**state.extern, VELOCITY_COMMAND: Extern(commands, 0.0)})

    def _sample(self, step: int, memory: PolicyMemory, previous: Float32Array, commands: FloatArray) -> StepSample:
        """The step as it truly was, whatever the sensors made of it."""
        simulation, count = self.simulation, len(self.seeds)
        tracked = simulation.body_poses(in_base=True) if self._feet is None else _no_bodies(count)
        return StepSample(
            state=simulation.truth(),
            action=memory.last_action,
            previous_action=previous,
            torque=simulation.effort,
            frame=memory.frame,
            step=np.full(count, step + 1),
            body_position=tracked[0],
            body_quaternion=tracked[1],
            command=commands,
            base=simulation.base,
            alignment=memory.alignment,
        )

    def _judge(self, step: int, sample: StepSample, order: MITCommand) -> None:
        """Measure the step of those that are still under way, and end those that are lost."""
        poses = _no_bodies(len(self.seeds)) if self._feet is None else self.simulation.body_poses()
        self._measures.add(step, sample, order, poses)
        self._steps += self._alive
        lost = self._alive & self.arena.task.judge(sample).terminated
        for i in np.flatnonzero(lost).tolist():
            self._fail(i, "lost", self.arena.task.describe_failure(sample, i))

    def _fail(self, i: int, kind: str, reason: str) -> None:
        self._alive[i] = False
        self._failures[i] = (kind, reason)

    def close(self) -> None:
        """Stop the simulation's threads. May be called twice."""
        self.simulation.close()

    def episodes(self) -> list[Episode]:
        """What came of them, in the order of their seeds."""
        traces = self._measures.traces()
        return [
            self._episode(i, {name: values[: self._steps[i], i] for name, values in traces.items()})
            for i in range(len(self.seeds))
        ]

    def _episode(self, i: int, traces: dict[str, FloatArray]) -> Episode:
        kind, reason = self._failures.get(i, ("", ""))
        steps = int(self._steps[i])
        period = self.arena.policy_dt
        ends = {
            "faults": float(kind == "fault"),
            "losses": float(kind == "lost"),
            "falls": float(kind == "lost"),
            "survival": steps / self.arena.steps,
        }
        metrics: dict[str, float | None] = {}
        for name, metric in METRICS[self.suite.task].items():
            if metric.summary == "episode":
                metrics[name] = ends[name]
            else:
                # An episode that was cut short has no errors to compare: what counts of it is that it failed.
                metrics[name] = None if kind else summarise(metric.summary, traces[name])
        times, thin = thinned(traces, period)
        return Episode(
            case=self.arena.case.name,
            seed=self.seeds[i],
            steps=steps,
            duration=steps * period,
            failure=reason,
            kind=kind,  # type: ignore[arg-type]  # set by `_fail` only
            metrics=metrics,
            trace_times=times,
            traces=thin,
        )


def _no_bodies(count: int) -> tuple[FloatArray, FloatArray]:
    return np.empty((count, 0, 3)), np.empty((count, 0, 4))
