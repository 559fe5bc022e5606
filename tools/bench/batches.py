"""Batches of robots: the native vector environment and a regression run, against the bare physics they contain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import gymnasium
import mujoco
import numpy as np
import numpy.typing as npt
from msgspec.structs import replace as changed
from mujoco import rollout

from humanoid_sim.assets import SAMPLE_POLICY
from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.controllers.policy_step import action_command
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.mit import Float32Array, FloatArray, MITCommand
from humanoid_sim.regress.episodes import EpisodeBatch
from humanoid_sim.regress.preparation import prepare_policy, prepare_suite
from humanoid_sim.regress.suite import load_suite
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch import BatchSimulation
from humanoid_sim.simulation.model import build_model
from tools.bench.timing import Row, paired_ratio

__all__ = ["height_scans", "piano_scene", "regress_speed", "vector_step"]

_NAME, _PIANO = "humanoid_sim/LiteTracking-v0", "humanoid_sim/LitePiano-v0"
_MANY, _PIANO_MANY = 1024, 256
_SCANNING = 256
_PHYSICS_STEPS = 400
_SOME = 64
"""Environments that Gymnasium's own steps one by one; how many makes no difference to the ratio."""
_VECTOR_STEPS = 2
"""Vector steps that are timed together."""
_SPREAD = 0.1
"""Noise of the actions, as a share of the action space."""
_EPISODES = 1024
_EPISODE_STEPS = 5
"""Policy steps of each: 0.1 s, 200 physics steps."""


class _BareRollout:
    """The same models, states, controls and threads as a batch simulation's, and nothing around them."""

    def __init__(
        self,
        simulation: BatchSimulation,
        qpos: FloatArray,
        qvel: FloatArray,
        targets: Sequence[FloatArray],
        reached: FloatArray,
    ) -> None:
        """Work out the controls, run once, and see that it is the same physics.

        Args:
            simulation: that has taken a command already, so that the gains are in its models.
            qpos: shape (N, nq), where it starts.
            qvel: shape (N, nv).
            targets: shape (N, n) each, rad, the positions that are commanded one control period after the other.
            reached: shape (N, nq), where the simulation ended.
        """
        self._models = [simulation.model(i) for i in range(simulation.count)]
        model = self._models[0]
        stiffness = np.array([-each.actuator_biasprm[:, 1] for each in self._models])
        steps = simulation.physics_steps
        self._controls = [np.repeat((stiffness * target)[:, None], steps, axis=1) for target in targets]
        self._initial = np.zeros((simulation.count, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
        self._initial[:, 1:] = np.concatenate([qpos, qvel], axis=1)
        self._path = np.zeros((simulation.count, steps, self._initial.shape[1]))
        self._data = [mujoco.MjData(model) for _ in range(simulation.threads)]
        self._rollout = rollout.Rollout(nthread=simulation.threads if simulation.threads > 1 else 0)
        self.run()
        if not np.allclose(self._path[:, -1, 1 : 1 + model.nq], reached, rtol=0.0, atol=1e-9):
            raise AssertionError("the bare physics does not match the batch")

    def run(self) -> None:
        """From the start through all control periods, one call each, as whoever answers to the state needs it."""
        state, velocity = self._initial, slice(1 + self._models[0].nq, None)
        acceleration = np.zeros_like(state[:, velocity])
        for control in self._controls:
            self._rollout.rollout(
                self._models,
                self._data,
                state,
                control,
                nstep=control.shape[1],
                skip_checks=True,
                initial_warmstart=acceleration,
                state=self._path,
            )
            state = self._path[:, -1].copy()
            acceleration = (state - self._path[:, -2])[:, velocity] / self._models[0].opt.timestep

    def close(self) -> None:
        """Stop the threads."""
        self._rollout.close()


def vector_step(repetitions: int) -> list[Row]:
    """Vector steps over bare `mujoco.rollout`s of the same states and controls, and over `SyncVectorEnv`."""
    return [_over_rollout("vector", _NAME, _MANY, 0.85, repetitions), _over_sync(repetitions)]


def piano_scene(repetitions: int) -> list[Row]:
    """Return a physics step of the Lite at a piano over one without; and its vector environment over bare rollouts."""
    with_keys, without = _Physics("lite_piano"), _Physics("lite")

    def describe(ours: float, bare: float) -> str:
        return f"{1e6 * ours / _PHYSICS_STEPS:.0f} µs, {1e6 * bare / _PHYSICS_STEPS:.0f} µs without a piano"

    scene = paired_ratio("piano, physics step", with_keys.run, without.run, repetitions, None, describe)
    return [scene, _over_rollout("piano vector", _PIANO, _PIANO_MANY, 0.80, repetitions)]


class _Physics:
    """A robot whose arms fall: onto the keys, where there are any."""

    def __init__(self, name: str) -> None:
        robot = load_robot(name)
        self._model = build_model(robot, scene=False)
        self._data = mujoco.MjData(self._model)
        self._ready = load_robot("lite_piano").standby_controller_a.pose_segments[-1]

    def run(self) -> None:
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[: len(self._ready)] = self._ready
        mujoco.mj_step(self._model, self._data, _PHYSICS_STEPS)


def _over_rollout(name: str, environment: str, many: int, target: float, repetitions: int) -> Row:
    envs = _Stepped("vector_entry_point", many, environment)
    native = envs.envs.unwrapped
    assert isinstance(native, PolicyVectorEnv)
    simulation = native.simulation
    envs.step()
    reached = simulation.qpos.copy()
    envs.begin()
    targets = [action_command(native.scenario.wiring.action_map, action).position for action in envs.actions]
    physics = _BareRollout(simulation, simulation.qpos, simulation.qvel, targets, reached)

    def describe(ours: float, bare: float) -> str:
        count = many * _VECTOR_STEPS
        return f"{count / ours:.0f} environment steps per s, {count / bare:.0f} bare, {simulation.threads} threads"

    title = f"{name}, {many} environments, over bare rollout"
    try:
        return paired_ratio(
            title, envs.step, physics.run, repetitions, target, describe, speed=True, prepare=envs.begin
        )
    finally:
        physics.close()
        envs.envs.close()


def _over_sync(repetitions: int) -> Row:
    native, sync = _Stepped("vector_entry_point", _SOME), _Stepped("sync", _SOME)

    def begin() -> None:
        native.begin()
        sync.begin()

    def describe(ours: float, theirs: float) -> str:
        count = _SOME * _VECTOR_STEPS
        return f"{count / ours:.0f} environment steps per s, {count / theirs:.0f} one by one"

    name = "vector, over SyncVectorEnv"
    try:
        return paired_ratio(name, native.step, sync.step, repetitions, 1.9, describe, speed=True, prepare=begin)
    finally:
        native.envs.close()
        sync.envs.close()


class _Stepped:
    """Environments that are given the same actions from the same starts again and again."""

    def __init__(self, mode: str, count: int, environment: str = _NAME) -> None:
        self.envs: Any = gymnasium.make_vec(environment, num_envs=count, vectorization_mode=mode)
        self.envs.action_space.seed(0)
        self.actions = [np.float32(_SPREAD) * self.envs.action_space.sample() for _ in range(_VECTOR_STEPS)]
        self.begin()

    def begin(self) -> None:
        self.envs.reset(seed=0)

    def step(self) -> None:
        for action in self.actions:
            *_, terminated, truncated, _ = self.envs.step(action)
            if terminated.any() or truncated.any():  # the next step would do less than a step
                raise AssertionError("an episode ended before the last of the steps")


def height_scans(repetitions: int) -> list[Row]:
    """Compare control periods of robots that scan the ground with those of robots that do not."""
    scanning, blind = _OnGround(HeightScan()), _OnGround(None)

    def describe(ours: float, without: float) -> str:
        count = _SCANNING * _VECTOR_STEPS
        each = f"{1e6 * ours / count:.0f} µs, {1e6 * without / count:.0f} µs without"
        return f"{HeightScan().count} rays; {each}; {scanning.simulation.threads} threads"

    def begin() -> None:
        scanning.simulation.reset()
        blind.simulation.reset()

    name = f"height scan, {_SCANNING} robots, over none"
    try:
        return [paired_ratio(name, scanning.run, blind.run, repetitions, None, describe, prepare=begin)]
    finally:
        scanning.simulation.close()
        blind.simulation.close()


class _OnGround:
    """Robots that hold their initial position, at the rate of a policy that walks."""

    def __init__(self, scan: HeightScan | None) -> None:
        robot = load_robot("lite_biped")
        self.simulation = BatchSimulation(robot, _SCANNING, control_period=0.02, height_scan=scan)
        zeros = np.zeros((_SCANNING, len(robot.joints)))
        position = zeros + np.array(robot.initial_position)
        self._command = MITCommand(position, zeros, zeros, zeros + 40.0, zeros + 2.0)

    def run(self) -> None:
        for _ in range(_VECTOR_STEPS):
            self.simulation.step(self._command)
            self.simulation.state()


def regress_speed(repetitions: int) -> list[Row]:
    """Return the sample policy over a suite: inference, disturbances, measures and judging included.

    The robots differ as the suite has it, except for the delay of their commands, which the bare physics
    lacks. What is built once per case is left out on both sides.
    """
    batch = _episodes()
    case, scenario = batch.case, batch.case.scenario
    starts: list[tuple[FloatArray, FloatArray]] = []
    actions: list[npt.ArrayLike] = []

    def watched(observation: Float32Array, frame: int) -> npt.ArrayLike:
        if not starts:
            starts.append((batch.simulation.qpos.copy(), batch.simulation.qvel.copy()))
        actions.append(scenario.policy(observation, frame))
        return actions[-1]

    batch.case = replace(case, scenario=replace(scenario, policy=watched))
    batch.run()
    batch.case = case
    raw = np.array(actions).reshape(_EPISODE_STEPS, _EPISODES, -1)
    targets = [action_command(scenario.wiring.action_map, action).position for action in raw]
    physics = _BareRollout(batch.simulation, *starts[0], targets, batch.simulation.qpos.copy())

    def describe(ours: float, bare: float) -> str:
        count = _EPISODES * _EPISODE_STEPS
        return f"{count / ours:.0f} policy steps per s, {count / bare:.0f} bare, {batch.simulation.threads} threads"

    name = f"regress, {_EPISODES} episodes, over bare rollout"
    try:
        return [paired_ratio(name, batch.run, physics.run, repetitions, 0.70, describe, speed=True)]
    finally:
        batch.simulation.close()
        physics.close()


def _episodes() -> EpisodeBatch:
    suite, folder = load_suite("lite_tracking")
    drawn = {name: value for name, value in suite.randomisation.items() if name != "command_delay"}
    prepared = prepare_suite(changed(suite, cases=suite.cases[:1], randomisation=drawn), folder)
    (case,) = prepare_policy(prepared, SAMPLE_POLICY).cases
    return EpisodeBatch(replace(case, steps=_EPISODE_STEPS), range(_EPISODES))
