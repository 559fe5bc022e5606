"""A policy's view of many robots as one Gymnasium vector environment, stepped natively on several threads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_args

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.envs import resets
from humanoid_sim.envs.base import PolicyEnvironment, make_pictures
from humanoid_sim.envs.scenario import Motions, Named
from humanoid_sim.envs.spaces import action_space
from humanoid_sim.envs.tasks.task import require_finite
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import ClosedLoop, sample_step
from humanoid_sim.evaluation.step import StepSample
from humanoid_sim.mit import BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.batch import BatchSimulation, Randomisation
from humanoid_sim.simulation.plant import BatchActuation, check_actuation

Step = tuple[Float32Array, FloatArray, BoolArray, BoolArray, dict[str, Any]]


class PolicyVectorEnv(PolicyEnvironment, VectorEnv[Float32Array, Float32Array, Any]):
    """N `PolicyEnv`s with a native plant in one: `humanoid_sim.simulation.batch` steps them, arrays do the rest.

    Seeded with the same numbers, and given the same actions, every environment does what a `PolicyEnv` does: the same
    starts, states equal to 1e-9 per step, the same faults. A fault ends the episode of its environment and touches no
    other. `info` is that of `PolicyEnv` as Gymnasium's vector environments merge it, each key with a mask `_key`.

    What may differ between environments is a `Randomisation`, drawn again for every episode. Observations are then late
    and noisy as it says, rewards and terminations are those of the true state.

    `reset` takes a seed (environment i gets `seed + i`), or one per environment, and these options:

    - `command`: vx, vy in m/s and yaw rate in rad/s, or one such row per environment, held for the whole episode.
    - `reset_mask`: shape (N,), the environments to reset, as `SyncVectorEnv` takes it.
    """

    KEPT = ("_observation", "_commands", "_steps", "_is_over", "_numbers", "single_action_space", "closed")

    def __init__(
        self,
        num_envs: int,
        contract: Named | PolicyContract,
        robot: Named | RobotDescription,
        motion: Motions | None = None,
        *,
        randomisation: Randomisation | Mapping[str, Any] | None = None,
        threads: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: str | None = None,
        **options: Any,
    ) -> None:
        """Build the robots; what is not listed is as `PolicyEnv` takes it, of one environment.

        Raises `InputError` for what cannot be read, or does not fit.

        Args:
            num_envs: N.
            threads: that step physics; None for one per processor that this process may use.
            autoreset_mode: what happens after an episode's end, as Gymnasium defines it.
            max_episode_steps: policy steps after which an episode is truncated, whatever the task says; None: any.
            render_mode: `rgb_array` or None.
            options: as `make_scenario` takes them; `actuation` is `affine`, which agrees with the reference, or
                `implicit`, the faster approximation for training.
        """
        if render_mode not in (None, "rgb_array"):
            raise InputError(f"render_mode: is {render_mode!r}, expected rgb_array or None for a vector environment")
        num_envs = resets.count_option("num_envs", num_envs)
        self.single_observation_space = bounds = self._prepare(contract, robot, motion, options)
        scenario = self.scenario
        check_actuation(scenario.actuation, get_args(BatchActuation))
        self.simulation = self._robots = BatchSimulation(
            scenario.description,
            num_envs,
            **scenario.robot_options(),
            threads=threads,
            randomisation=Randomisation.of(randomisation),
        )
        self.num_envs = num_envs
        self.single_action_space = action_space(scenario.wiring, scenario.description)
        self.observation_space = batch_space(bounds, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.autoreset_mode = resets.autoreset(autoreset_mode)
        self.render_mode = render_mode
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": round(1.0 / scenario.contract.policy_dt),
            "autoreset_mode": self.autoreset_mode,
        }
        self.wrench: FloatArray | None = None
        """Shape (N, 6), N and N·m, on the base in all following steps, as `BatchSimulation.step` takes it."""
        self._pictures = make_pictures(scenario.description, width, height, camera)
        unlimited = np.iinfo(np.int64).max if max_episode_steps is None else max_episode_steps
        self._longest = resets.count_option("max_episode_steps", unlimited)
        self.max_episode_steps = min(self._longest, scenario.task.episode_steps)
        self._numbers = resets.StartNumbers(num_envs, scenario.starts.draws)
        self._observation = np.zeros((num_envs, *bounds.shape), dtype=np.float32)
        self._commands: FloatArray = scenario.task.start(np.zeros((num_envs, scenario.task.draws))).commands
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._is_over = np.zeros(num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Float32Array, dict[str, Any]]:
        """Start episodes; the same seeds give the same starts.

        Raises `InputError` if a seed or an option is not what it should be.
        """
        options = {} if options is None else dict(options)
        mask = resets.reset_mask(options.pop("reset_mask", None), self.num_envs)
        command = resets.velocity_option(options.pop("command"), self.num_envs) if "command" in options else None
        resets.refuse_others(options, "command", "reset_mask")
        seeds = resets.reset_seeds(seed, self.num_envs)
        if self._loop is None and not mask.all():
            raise gymnasium.error.ResetNeeded("reset_mask: the first reset is of all environments")
        super().reset(seed=seeds[0])
        chosen = np.flatnonzero(mask)
        is_new = self._seed(chosen, [seeds[i] for i in chosen.tolist()])
        loop = self._begin(chosen, command, is_new)
        info = _VectorInfo(self.num_envs)
        info.add("frame", np.asarray(loop.memory.frame), mask)
        return self._observation.copy(), info.entries

    @property
    def episode_steps(self) -> IntArray:
        """Shape (N,), policy steps since each episode began.

        Setting it puts environments out of step with each other: an episode of a set length ends the earlier, and
        commands change at other times. A motion is where it is.
        """
        return self._steps

    @episode_steps.setter
    def episode_steps(self, steps: npt.NDArray[np.integer]) -> None:
        values = np.asarray(steps)
        if values.shape != (self.num_envs,) or values.min(initial=0) < 0:
            raise InputError(f"episode_steps: has shape {values.shape}, expected ({self.num_envs},) numbers >= 0")
        self._steps = values.astype(np.int64)

    def _seed(self, chosen: IndexArray, seeds: Sequence[int | None]) -> BoolArray:
        """Seed some environments; which of all have new seeds, shape (N,)."""
        before = self._numbers.seeds.copy()
        self._numbers.seed(chosen, seeds)
        is_new: BoolArray = self._numbers.seeds != before
        is_new[chosen] |= [seed is not None for seed in seeds]
        return is_new

    def _begin(
        self, chosen: IndexArray, command: FloatArray | None = None, is_new: BoolArray | None = None
    ) -> ClosedLoop:
        """Put some environments at the start of an episode, and observe it.

        Args:
            chosen: shape (k,), indices.
            command: shape (N, 3), for the whole episode; None: what the task draws.
            is_new: shape (N,), which have new seeds; None: none.
        """
        scenario = self.scenario
        first = np.zeros(self.num_envs, dtype=np.bool_) if is_new is None else is_new
        if first.any():
            self.simulation.reseed(self._numbers.seeds[first], np.flatnonzero(first))
        self.simulation.redraw(chosen[~first[chosen]])
        start = scenario.starts(self._numbers.take(chosen))
        self.simulation.reset(chosen, **start.pose)
        self._commands[chosen] = start.commands if command is None else command[chosen, None]
        self._steps[chosen] = 0
        self._is_over[chosen] = False
        velocity = scenario.task.command(self._commands, self._steps).copy()
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

        Raises:
            InputError: the actions have another shape than the space's, or a reward is not finite.
            gymnasium.error.ResetNeeded: there was no reset yet, or, without autoreset, none since an episode's end.
        """
        loop = self._loop
        if loop is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        if self.autoreset_mode == AutoresetMode.DISABLED and self._is_over.any():
            raise gymnasium.error.ResetNeeded("an episode has ended: call reset with a reset_mask before step")
        with np.errstate(over="ignore"):  # becomes infinite, and is refused
            raw = np.array(actions, dtype=np.float32)
        if raw.shape != self.action_space.shape:
            raise InputError(f"actions: have shape {raw.shape}, expected {self.action_space.shape}")
        starting = self._is_over.copy()
        refused = ~self.scenario.wiring.accepts(raw) & ~starting
        before = loop.memory.frame
        sound, sample, faults = self._advance(loop, raw, ~refused & ~starting)
        judgement = self.scenario.task.judge(sample)
        faults |= {int(i): self.scenario.wiring.action_problem(raw[i]) for i in np.flatnonzero(refused)}
        self.fault_count += len(faults)

        reward = np.where(sound, judgement.reward, 0.0)
        require_finite(reward, judgement.terms)
        terminated = np.where(sound, judgement.terminated, ~starting)
        truncated = (sound & judgement.truncated) | (~starting & (self._steps + refused >= self._longest))
        info = _VectorInfo(self.num_envs)
        info.add("frame", np.where(sound, loop.memory.frame, before), ~starting)
        info.add_terms("terms", judgement.terms, sound, ~starting)
        info.add_texts("fault", faults)
        self._is_over = terminated | truncated
        if starting.any():
            loop = self._begin(np.flatnonzero(starting))
            info.merge("frame", np.asarray(loop.memory.frame), starting)
        elif self.autoreset_mode == AutoresetMode.SAME_STEP and self._is_over.any():
            info = self._begin_again(info)
        return self._observation.copy(), reward, terminated, truncated, info.entries

    def _begin_again(self, info: _VectorInfo) -> _VectorInfo:
        """Start the next episodes in the step that ended the last ones, whose info and observation go along."""
        over = self._is_over.copy()
        following = info.with_final(over, self._observation)
        loop = self._begin(np.flatnonzero(over))
        following.merge("frame", np.asarray(loop.memory.frame), over)
        return following

    def _advance(
        self, loop: ClosedLoop, raw: Float32Array, moving: BoolArray
    ) -> tuple[BoolArray, StepSample, dict[int, str]]:
        """Let the actions of the moving environments act.

        Returns:
            Shape (N,), which of them are sound afterwards; the step of all; and the others' faults.
        """
        task, simulation = self.scenario.task, self.simulation
        action = raw if moving.all() else np.where(moving[:, None], raw, 0.0).astype(np.float32)
        self._steps = self._steps + moving
        velocity = task.command(self._commands, self._steps).copy()
        loop.act(action, velocity=velocity, wrench=self.wrench, where=None if moving.all() else moving)
        observation = loop.observation
        finite = np.isfinite(observation).all(axis=1)
        tripped = moving & loop.tripped
        broken = moving & ~tripped & simulation.fault
        sound = moving & ~tripped & ~broken & finite
        faults = {int(i): "simulation unstable" for i in np.flatnonzero(broken)}
        faults |= {
            int(i): loop.wiring.observation_problem(observation[i])
            for i in np.flatnonzero(moving & ~tripped & ~broken & ~sound)
        }
        faults |= {int(i): loop.alarms[int(i)] for i in np.flatnonzero(tripped)}
        self._observation = np.where(sound[:, None], observation, self._observation)
        return sound, sample_step(loop, simulation, np.maximum(self._steps, 1)), faults

    def render(self) -> tuple[npt.NDArray[np.uint8], ...] | None:
        """Return a picture of each environment, shape (height, width, 3); None unless the mode is `rgb_array`."""
        if self.render_mode is None:
            return None
        return tuple(self._pictures.draw(qpos) for qpos in self.simulation.qpos)

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads, close the rendering context."""
        self._pictures.close()
        self.simulation.close()


Array = npt.NDArray[np.generic]


class _VectorInfo:
    """Arrays over N environments by key, each with a mask `_key` of those that have it; zero where one has not."""

    def __init__(self, count: int) -> None:
        self._count = count
        self.entries: dict[str, Any] = {}
        """Info that `step` and `reset` return."""

    def add(self, key: str, values: Array, mask: BoolArray) -> None:
        """Add an entry of the environments in the mask, unless there are none; `values` is shape (N, …)."""
        if mask.any():
            self.entries[key], self.entries[f"_{key}"] = _chosen(mask, values), mask.copy()

    def merge(self, key: str, values: Array, mask: BoolArray) -> None:
        """Add to an entry those of further environments."""
        if key in self.entries:
            values, mask = _chosen(mask, values, self.entries[key]), mask | self.entries[f"_{key}"]
        self.add(key, values, mask)

    def add_terms(self, key: str, terms: Mapping[str, Array], mask: BoolArray, owners: BoolArray) -> None:
        """Add a dictionary of values: all `owners` have one, it is empty outside of `mask`."""
        if owners.any():
            inner = _VectorInfo(self._count)
            for name, values in terms.items():
                inner.add(name, values, mask)
            self.entries[key], self.entries[f"_{key}"] = inner.entries, owners.copy()

    def add_texts(self, key: str, texts: Mapping[int, str]) -> None:
        """Add texts by environment, unless there are none."""
        if texts:
            values, mask = np.full(self._count, None, dtype=object), np.zeros(self._count, dtype=np.bool_)
            for i, text in texts.items():
                values[i], mask[i] = text, True
            self.entries[key], self.entries[f"_{key}"] = values, mask

    def with_final(self, over: BoolArray, observation: Array) -> _VectorInfo:
        """Return the info of a step that starts the next episodes of some environments.

        Args:
            over: shape (N,), whose entries here belong to the episodes that have ended.
            observation: shape (N, …), the last of those episodes.

        Returns:
            With `final_obs` and `final_info` of the episodes that have ended, and everything else of the others.
        """
        following = _VectorInfo(self._count)
        following.entries = _part(self.entries, ~over)
        final = np.full(self._count, None, dtype=object)
        for i in np.flatnonzero(over):
            final[i] = observation[i].copy()
        following.entries |= {
            "final_obs": final,
            "_final_obs": over,
            "final_info": _part(self.entries, over),
            "_final_info": over,
        }
        return following


def _chosen(mask: BoolArray, values: Array, others: Array | None = None) -> Array:
    """Return the values, shape (N, …), where the mask is, and else the others; without any 0, or None of objects."""
    nothing: Any = None if values.dtype == object else np.zeros((), dtype=values.dtype)
    return np.where(mask.reshape(-1, *[1] * (values.ndim - 1)), values, nothing if others is None else others)


def _part(entries: Mapping[str, Any], kept: BoolArray) -> dict[str, Any]:
    """Return the entries of some of the environments."""
    part: dict[str, Any] = {}
    for key, value in entries.items():
        mask = entries.get(f"_{key}")
        if mask is None or not (mask & kept).any():
            continue
        remaining = mask & kept
        if isinstance(value, dict):
            part[key] = _part(value, kept)
        else:
            part[key] = _chosen(remaining, value)
        part[f"_{key}"] = remaining
    return part
