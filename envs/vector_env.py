"""A policy's view of many robots as one Gymnasium vector environment, stepped natively on several threads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from humanoid_sim.envs.config import PolicyEnvConfig, build_scenario, policy_config
from humanoid_sim.envs.spaces import action_space, observation_space, raw_action, reset_options, velocity_option
from humanoid_sim.envs.tasks import require_finite
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.mit import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.randomisation import Randomisation

Step = tuple[Float32Array, FloatArray, BoolArray, BoolArray, dict[str, Any]]
_MODES = (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)


class PolicyVectorEnv(VectorEnv[Float32Array, Float32Array, Any]):
    """N `PolicyEnv`s in one: `BatchSim` steps them, arrays do the rest.

    Seeded with the same numbers, and given the same actions, every environment does what a `PolicyEnv` does: the same
    starts, states equal to 1e-9 per step, the same faults. A fault ends the episode of its environment and touches no
    other. `info` is that of `PolicyEnv`, each key with a mask `_key`.

    `reset` takes a seed (environment i gets `seed + i`), or one per environment, and the option `command`: vx, vy in
    m/s and yaw rate in rad/s, or one such row per environment, held for the whole episode.
    """

    def __init__(
        self,
        num_envs: int,
        config: PolicyEnvConfig | str,
        *,
        threads: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        """Build N robots of a configuration, or of a name in `CONFIGS`; `options` change some of its fields.

        `threads` step physics, None for one per processor. Raises `InputError` for what cannot be read, or does not
        fit.
        """
        if not isinstance(num_envs, int) or num_envs < 1:
            raise InputError(f"num_envs: is {num_envs!r}, expected a whole number >= 1")
        if autoreset_mode not in (*_MODES, *(mode.value for mode in _MODES)):
            raise InputError(f"autoreset_mode: is {autoreset_mode!r}, expected NextStep or SameStep")
        self.config = config = policy_config(config, options)
        self.scenario = scenario = build_scenario(config)
        self.simulation = BatchSim(
            scenario.description,
            num_envs,
            scenario.sim_config,
            implicit=config.implicit,
            threads=threads,
            randomisation=Randomisation.of(config.randomisation),
        )
        self.num_envs, self.autoreset_mode = num_envs, AutoresetMode(autoreset_mode)
        self.single_observation_space = observation_space(scenario.wiring)
        self.single_action_space = action_space(scenario.wiring, scenario.description)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.metadata = {"autoreset_mode": self.autoreset_mode}
        self.max_episode_steps = scenario.task.episode_steps
        """Steps after which every episode is truncated, if it is not over before."""
        self.episode_steps: IntArray = np.zeros(num_envs, dtype=np.int64)
        """Shape (N,), policy steps since each episode began. Greater ones let episodes of a set length end earlier."""
        self._observation = np.zeros(self.observation_space.shape or (), dtype=np.float32)
        self._commands: FloatArray = np.zeros((num_envs, max(scenario.task.command_draws // 4, 1), 3))
        self._is_over = np.zeros(num_envs, dtype=np.bool_)
        self._loop: ClosedLoop | None = None

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Float32Array, dict[str, Any]]:
        """Start episodes; the same seeds give the same starts. Raises `InputError` for a seed or option that is not."""
        given = reset_options(options, {"command": 3})
        command = velocity_option(given["command"], self.num_envs) if "command" in given else None
        if seed is None and self._loop is None:
            seed = int(self.np_random.integers(2**32))
        if seed is None:
            self.simulation.redraw()
        else:
            seeds = seed + np.arange(self.num_envs) if isinstance(seed, int | np.integer) else np.asarray(seed)
            if seeds.shape != (self.num_envs,) or seeds.dtype.kind not in "iu" or (seeds < 0).any():
                raise InputError(f"reset: seed is {seed!r}, expected a whole number >= 0, or {self.num_envs} of them")
            super().reset(seed=int(seeds[0]))
            self.simulation.reseed(seeds)
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        loop = self._begin(np.arange(self.num_envs), command)
        return self._observation.copy(), {"frame": np.asarray(loop.memory.frame), "_frame": everyone}

    def _begin(self, chosen: IndexArray, command: FloatArray | None = None) -> ClosedLoop:
        """Put environments with indices (k,), whose robots are drawn, at the start of an episode, and observe it.

        `command`, (N, 3), is for the whole episode; None: what the task draws.
        """
        scenario, generators = self.scenario, self.simulation.generators
        start = scenario.starts(np.stack([generators[i].random(scenario.starts.draws) for i in chosen.tolist()]))
        self.simulation.reset(chosen, qpos=start.qpos, qvel=start.qvel)
        self._commands[chosen] = start.commands if command is None else command[chosen, None]
        self.episode_steps[chosen] = 0
        self._is_over[chosen] = False
        velocity = scenario.task.command(self._commands, self.episode_steps)
        if self._loop is None or len(chosen) == self.num_envs:
            self._loop = ClosedLoop(self.simulation, scenario.wiring, velocity, scenario.guards)
        else:
            self._loop.restart(chosen, velocity)
        self._observation[chosen] = self._loop.observation[chosen]
        return self._loop

    def step(self, actions: Float32Array) -> Step:
        """One policy step of every environment.

        In the mode `NEXT_STEP` an environment whose episode has ended ignores its action and starts the next one.

        Raises `InputError` if the actions have another shape than the space's, or a reward is not finite.
        """
        loop, task = self._loop, self.scenario.task
        if loop is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        raw = raw_action(actions, self.action_space)
        starting, before = self._is_over.copy(), loop.memory.frame
        moving = loop.wiring.accepts(raw) & ~starting
        action = raw if moving.all() else np.where(moving[:, None], raw, np.float32(0.0))
        self.episode_steps = self.episode_steps + moving
        velocity = task.command(self._commands, self.episode_steps)
        loop.act(action, velocity=velocity, where=None if moving.all() else moving)
        faults = self._faults(loop, raw, starting, moving)
        sound = moving.copy()
        sound[list(faults)] = False

        judgement = task.judge(loop.sample(np.maximum(self.episode_steps, 1)))
        reward = np.where(sound, judgement.reward, 0.0)
        require_finite(reward, judgement.terms)
        terminated = np.where(sound, judgement.terminated, ~starting)
        truncated = sound & judgement.truncated
        frame = np.where(sound, loop.memory.frame, before)
        info = _step_info(frame, judgement.terms, sound, ~starting, faults)
        self._observation = np.where(sound[:, None], loop.observation, self._observation)
        self._is_over = terminated | truncated
        over = starting if self.autoreset_mode == AutoresetMode.NEXT_STEP else self._is_over.copy()
        if over.any():
            if self.autoreset_mode == AutoresetMode.SAME_STEP:
                info = _with_final(info, over, self._observation)
            chosen = np.flatnonzero(over)
            self.simulation.redraw(chosen)
            info["frame"] = np.where(over, self._begin(chosen).memory.frame, frame)
            info["_frame"] = np.ones(self.num_envs, dtype=np.bool_)
        return self._observation.copy(), reward, terminated, truncated, info

    def _faults(self, loop: ClosedLoop, raw: Float32Array, starting: BoolArray, moving: BoolArray) -> dict[int, str]:
        """Return what went wrong in this step by environment; `moving` had an action that was accepted."""
        wiring, found = loop.wiring, {}
        for i in np.flatnonzero(~moving & ~starting).tolist():
            found[i] = wiring.action_problem(raw[i])
        found |= {i: alarm for i, alarm in loop.alarms.items() if moving[i]}
        blind = ~np.isfinite(loop.observation).all(axis=1)
        for i in np.flatnonzero(moving & (self.simulation.fault | blind)).tolist():
            unstable = "simulation unstable" if self.simulation.fault[i] else ""
            found.setdefault(i, unstable or wiring.observation_problem(loop.observation[i]))
        return found

    def close_extras(self, **kwargs: Any) -> None:
        self.simulation.close()


def require_same_step(envs: VectorEnv[Any, Any, Any], library: str) -> PolicyVectorEnv:
    """Return the environment inside of wrappers.

    Raises `InputError` unless an episode starts in the step that ends the last one, as a library expects.
    """
    whole = envs.unwrapped
    assert isinstance(whole, PolicyVectorEnv)
    if whole.autoreset_mode != AutoresetMode.SAME_STEP:
        raise InputError(f"autoreset_mode: is '{whole.autoreset_mode.value}', expected 'SameStep' for {library}")
    return whole


def _step_info(
    frame: npt.NDArray[Any],
    terms: Mapping[str, FloatArray],
    sound: BoolArray,
    owners: BoolArray,
    faults: Mapping[int, str],
) -> dict[str, Any]:
    """Return the info of a step, each key with a mask `_key`; the environments without a sound step have no terms."""
    info: dict[str, Any] = {}
    if owners.any():
        rewards: dict[str, Any] = dict(terms) if sound.any() else {}
        rewards |= {f"_{name}": sound.copy() for name in rewards}
        info = {"frame": frame, "_frame": owners.copy(), "terms": rewards, "_terms": owners.copy()}
    if faults:
        texts, mask = np.full(len(frame), None, dtype=object), np.zeros(len(frame), dtype=np.bool_)
        for i, text in faults.items():
            texts[i], mask[i] = text, True
        info |= {"fault": texts, "_fault": mask}
    return info


def _with_final(info: Mapping[str, Any], over: BoolArray, observation: Float32Array) -> dict[str, Any]:
    """Return the info of a step that starts the next episodes of the environments in the mask `over`, shape (N,).

    It has `final_obs` and `final_info` of the episodes that have ended, and everything else of the others.
    """
    final = np.full(len(over), None, dtype=object)
    for i in np.flatnonzero(over):
        final[i] = observation[i].copy()
    ended = {"final_obs": final, "_final_obs": over, "final_info": _part(info, over), "_final_info": over}
    return _part(info, ~over) | ended


def _part(info: Mapping[str, Any], kept: BoolArray) -> dict[str, Any]:
    """Return the entries of some of the environments: those whose masks they are in."""
    part: dict[str, Any] = {}
    for key, value in info.items():
        mask = info.get(f"_{key}")
        if mask is not None and (mask & kept).any():
            part[key] = _part(value, kept) if isinstance(value, dict) else value
            part[f"_{key}"] = mask & kept
    return part
