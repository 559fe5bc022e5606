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
from humanoid_sim.envs.display import PICTURE
from humanoid_sim.envs.spaces import action_space, observation_space, raw_action, reset_options, velocity_option
from humanoid_sim.envs.tasks import require_finite
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import ClosedLoop, sample_step
from humanoid_sim.mit import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from humanoid_sim.rendering.pictures import PoseRenderer
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.randomisation import Randomisation

Step = tuple[Float32Array, FloatArray, BoolArray, BoolArray, dict[str, Any]]


class PolicyVectorEnv(VectorEnv[Float32Array, Float32Array, Any]):
    """N `PolicyEnv`s in one: `BatchSim` steps them, arrays do the rest.

    Seeded with the same numbers, and given the same actions, every environment does what a `PolicyEnv` does: the same
    starts, states equal to 1e-9 per step, the same faults. A fault ends the episode of its environment and touches no
    other. `info` is that of `PolicyEnv`, each key with a mask `_key`.

    `reset` takes a seed (environment i gets `seed + i`), or one per environment, and these options:

    - `command`: vx, vy in m/s and yaw rate in rad/s, or one such row per environment, held for the whole episode.
    - `reset_mask`: shape (N,), the environments to reset.
    """

    def __init__(
        self,
        num_envs: int,
        config: PolicyEnvConfig | str,
        *,
        threads: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """Build N robots of a configuration, or of a name in `CONFIGS`; `options` change some of its fields.

        `threads` step physics, None for one per processor that this process may use. Raises `InputError` for what
        cannot be read, or does not fit.
        """
        if render_mode not in (None, "rgb_array"):
            raise InputError(f"render_mode: is {render_mode!r}, expected rgb_array or None for a vector environment")
        for name, value in (("num_envs", num_envs), ("threads", threads)):
            if value is not None and value < 1:
                raise InputError(f"{name}: is {value!r}, expected a whole number >= 1")
        modes = [mode.value for mode in AutoresetMode]
        if autoreset_mode not in (*AutoresetMode, *modes):
            raise InputError(f"autoreset_mode: is {autoreset_mode!r}, expected {', '.join(modes)}")
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
        self.num_envs, self.render_mode, self.autoreset_mode = num_envs, render_mode, AutoresetMode(autoreset_mode)
        self.single_observation_space = observation_space(scenario.wiring)
        self.single_action_space = action_space(scenario.wiring, scenario.description)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        rate = round(1.0 / scenario.contract.policy_dt)
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": rate, "autoreset_mode": self.autoreset_mode}
        self.max_episode_steps = scenario.task.episode_steps
        """Steps after which every episode is truncated, if it is not over before."""
        self.wrench: FloatArray | None = None
        """Shape (N, 6), N and N·m, on the base in all following steps, as `BatchSim.step` takes it."""
        self.episode_steps: IntArray = np.zeros(num_envs, dtype=np.int64)
        """Shape (N,), policy steps since each episode began. Greater ones let episodes of a set length end earlier."""
        self._pictures = PoseRenderer(lambda: build_model(scenario.description), *PICTURE)
        self._observation = np.zeros(self.observation_space.shape or (), dtype=np.float32)
        self._commands: FloatArray = np.zeros((num_envs, max(scenario.task.command_draws // 4, 1), 3))
        self._is_over = np.zeros(num_envs, dtype=np.bool_)
        self._loop: ClosedLoop | None = None

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Float32Array, dict[str, Any]]:
        """Start episodes; the same seeds give the same starts. Raises `InputError` for a seed or option that is not."""
        given = reset_options(options, ("command", "reset_mask"))
        mask = np.asarray(given.get("reset_mask", np.ones(self.num_envs, dtype=np.bool_)))
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
            raise InputError(f"reset: reset_mask is {mask!r}, expected {self.num_envs} booleans, one of them true")
        command = velocity_option(given["command"], self.num_envs) if "command" in given else None
        if self._loop is None and not mask.all():
            raise gymnasium.error.ResetNeeded("reset_mask: the first reset is of all environments")
        seeds = self._seeds(seed)
        super().reset(seed=seeds[0])
        if self._loop is None:  # environments without a seed of their own get any
            seeds = [int(self.np_random.integers(2**32)) if one is None else one for one in seeds]
        chosen = np.flatnonzero(mask)
        fresh = {i: one for i, one in enumerate(seeds) if mask[i] and one is not None}
        if fresh:
            self.simulation.reseed(list(fresh.values()), list(fresh))
        self.simulation.redraw([i for i in chosen.tolist() if i not in fresh])
        loop = self._begin(chosen, command)
        return self._observation.copy(), {"frame": np.asarray(loop.memory.frame), "_frame": mask}

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        """Return one seed per environment; None leaves its random numbers as they are."""
        if seed is None:
            return [None] * self.num_envs
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int | np.integer) else list(seed)
        if len(seeds) != self.num_envs or any(one is not None and one < 0 for one in seeds):
            raise InputError(f"reset: seed is {seed!r}, expected a whole number >= 0, or {self.num_envs} of them")
        return [None if one is None else int(one) for one in seeds]

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
            self._loop = ClosedLoop(
                self.simulation, scenario.wiring, velocity, scenario.live, scenario.guards, start.frame
            )
        else:
            self._loop.restart(chosen, velocity, start.frame)
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
        if self.autoreset_mode == AutoresetMode.DISABLED and self._is_over.any():
            raise gymnasium.error.ResetNeeded("an episode has ended: call reset with a reset_mask before step")
        raw = raw_action(actions, self.action_space)
        starting, before = self._is_over.copy(), loop.memory.frame
        moving = loop.wiring.accepts(raw) & ~starting
        action = raw if moving.all() else np.where(moving[:, None], raw, np.float32(0.0))
        self.episode_steps = self.episode_steps + moving
        velocity = task.command(self._commands, self.episode_steps)
        loop.act(action, velocity=velocity, wrench=self.wrench, where=None if moving.all() else moving)
        faults = self._faults(loop, raw, starting, moving)
        sound = moving.copy()
        sound[list(faults)] = False

        judgement = task.judge(sample_step(loop, self.simulation, np.maximum(self.episode_steps, 1)))
        reward = np.where(sound, judgement.reward, 0.0)
        require_finite(reward, judgement.terms)
        terminated = np.where(sound, judgement.terminated, ~starting)
        truncated = sound & judgement.truncated
        frame = np.where(sound, loop.memory.frame, before)
        info = _step_info(frame, judgement.terms, sound, ~starting, faults)
        self._observation = np.where(sound[:, None], loop.observation, self._observation)
        self._is_over = terminated | truncated
        over = starting if self.autoreset_mode == AutoresetMode.NEXT_STEP else self._is_over.copy()
        if over.any() and self.autoreset_mode != AutoresetMode.DISABLED:
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
        blind = ~np.isfinite(loop.observation).all(axis=1)
        for i in np.flatnonzero(moving & (loop.tripped | self.simulation.fault | blind)).tolist():
            if loop.tripped.ndim and loop.tripped[i]:
                found[i] = loop.alarms[i]
            elif self.simulation.fault[i]:
                found[i] = "simulation unstable"
            else:
                found[i] = wiring.observation_problem(loop.observation[i])
        return found

    def render(self) -> tuple[npt.NDArray[np.uint8], ...] | None:
        """Return a picture of each environment, shape (height, width, 3); None unless the mode is `rgb_array`."""
        if self.render_mode is None:
            return None
        return tuple(self._pictures.draw(qpos) for qpos in self.simulation.qpos)

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads, close the rendering context."""
        self._pictures.close()
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
