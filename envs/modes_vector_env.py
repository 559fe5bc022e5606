"""The whole control stack for many robots at once, whose physics `BatchSim` steps on several threads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Discrete
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from humanoid_sim.controllers.supervisor import SupervisorMemory
from humanoid_sim.envs.config import changed
from humanoid_sim.envs.modes_env import LITE_MODES, ModesEnvConfig, first_info, step_info, tick_input
from humanoid_sim.envs.spaces import (
    INTENTS,
    modes_observation,
    modes_observation_space,
    reset_options,
    velocity_option,
)
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import state_rows
from humanoid_sim.messages import SafetyLevel, SafetyStatus, TickOutput
from humanoid_sim.mit import COMMAND_FIELDS, VELOCITY_COMMAND, BoolArray, FloatArray, MITCommand
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.stack import build_supervisor

_OK = (SafetyStatus(source="mujoco"),)
_BROKEN = (SafetyStatus(level=SafetyLevel.CRITICAL, source="mujoco", message="simulation unstable"),)
Step = tuple[dict[str, Any], FloatArray, BoolArray, BoolArray, dict[str, Any]]


class ModesVectorEnv(VectorEnv[dict[str, Any], npt.NDArray[Any], Any]):
    """N `ModesEnv`s in one, states equal to 1e-9, for robots with a fixed base: a batch has no support.

    An episode that has ended begins again in the next step, whose action is ignored.
    """

    def __init__(
        self, num_envs: int, config: ModesEnvConfig = LITE_MODES, *, threads: int | None = None, **options: Any
    ) -> None:
        """Build the robots and their stack; `threads` and `options` are as of `PolicyVectorEnv`."""
        self.config = config = changed(config, options)
        description, loaded, sim = config.read()
        if description.is_floating:
            raise InputError(f"robot: '{description.name}' floats, expected a fixed base, or vectorization_mode sync")
        self.simulation = BatchSim(description, num_envs, sim, threads=threads)
        self.num_envs, self.render_mode = num_envs, None
        live = {**self.simulation.extern, VELOCITY_COMMAND: 3}
        self.supervisor = build_supervisor(description, self.simulation.control_period, loaded, live=live)
        self.single_action_space = Discrete(len(INTENTS))
        self.single_observation_space = modes_observation_space(description)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
        self._memories: list[SupervisorMemory] = []
        self._velocity: FloatArray = np.zeros((num_envs, 3))
        self._steps, self._is_over = np.zeros(num_envs, dtype=np.int64), np.zeros(num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Relaunch all; `options` has one `command`, or one for each environment. Nothing is random."""
        super().reset(seed=seed if isinstance(seed, int) else None)
        given = reset_options(options, ("command",))
        self._velocity = velocity_option(given.get("command", np.zeros(3)), self.num_envs)
        self._memories = [self.supervisor.initial()] * self.num_envs
        self._begin(np.ones(self.num_envs, dtype=np.bool_))
        return self._report([None] * self.num_envs)

    def _begin(self, over: BoolArray) -> None:
        self.simulation.reset(np.flatnonzero(over))
        self._memories = [self.supervisor.initial() if over[i] else each for i, each in enumerate(self._memories)]
        self._steps[over] = 0
        self._is_over = np.zeros(self.num_envs, dtype=np.bool_)

    def step(self, actions: npt.NDArray[Any]) -> Step:
        """One control tick of every stack. Raises `InputError` for actions that are none of the space."""
        if not self._memories:
            raise gymnasium.error.ResetNeeded("call reset before step")
        if not self.action_space.contains(np.asarray(actions)):
            raise InputError(f"actions: are {actions!r}, expected {self.num_envs} from 0 to {len(INTENTS) - 1}")
        starting = self._is_over
        if starting.any():
            self._begin(starting)
        outputs: list[TickOutput | None] = [None] * self.num_envs
        commands = [MITCommand.zeros(len(self.simulation.joints))] * self.num_envs
        reward, quits = np.zeros(self.num_envs), np.zeros(self.num_envs, dtype=np.bool_)
        state, fault = self.simulation.state(), self.simulation.fault
        for i in np.flatnonzero(~starting).tolist():
            safety = _BROKEN if fault[i] else _OK
            tick = tick_input(state_rows(state, i), safety, self._velocity[i], int(actions[i]))
            self._memories[i], output = self.supervisor.step(self._memories[i], tick)
            outputs[i], commands[i], quits[i] = output, output.command, output.quit
            reward[i] = self.simulation.control_period if output.control_mode.mode.is_free else 0.0
        arrays = [np.stack([getattr(command, name) for command in commands]) for name in COMMAND_FIELDS]
        self.simulation.step(MITCommand(*arrays), where=~starting)
        self._steps += ~starting
        is_late = self._steps >= self.config.max_episode_steps
        self._is_over = quits | is_late
        observation, infos = self._report(outputs)
        return observation, reward, quits, is_late, infos

    def _report(self, outputs: list[TickOutput | None]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return observation and info after a tick; None where an episode begins."""
        state, fault = self.simulation.state(), self.simulation.fault
        rows, infos = [], dict[str, Any]()
        for i, output in enumerate(outputs):
            rows.append(modes_observation(state_rows(state, i), output, _BROKEN if fault[i] else _OK))
            time = float(self._steps[i]) * self.simulation.control_period
            info = first_info(self._memories[i]) if output is None else step_info(output, time)
            infos = self._add_info(infos, info, i)
        return {name: np.stack([row[name] for row in rows]) for name in rows[0]}, infos

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the threads."""
        self.simulation.close()
