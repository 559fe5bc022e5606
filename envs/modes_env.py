"""The whole control stack as a Gymnasium environment: an operator's view, for rollouts of the five-mode FSM."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Discrete
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from humanoid_sim.controllers.supervisor import SupervisorMemory
from humanoid_sim.envs.config import Named, changed, checkpoint_of, motion_of, observed_by
from humanoid_sim.envs.display import RENDER_MODES, Display
from humanoid_sim.envs.spaces import (
    INTENTS,
    modes_observation,
    modes_observation_space,
    reset_options,
    velocity_option,
)
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import state_rows
from humanoid_sim.messages import SafetyLevel, SafetyStatus, TickInput, TickOutput
from humanoid_sim.mit import COMMAND_FIELDS, VELOCITY_COMMAND, BoolArray, Extern, FloatArray, MITCommand, MITState
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract_physics
from humanoid_sim.simulation import DROP
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.floating_base import support_in_mode
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.sim_robot import SimRobot
from humanoid_sim.stack import build_supervisor

_OK = (SafetyStatus(source="mujoco"),)
_BROKEN = (SafetyStatus(level=SafetyLevel.CRITICAL, source="mujoco", message="simulation unstable"),)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModesEnvConfig:
    """The stack of an environment."""

    robot: Named | RobotDescription
    policy: Named | None = None  # of LOCOMOTION, a checkpoint (.onnx); None for a stack without LOCOMOTION
    motion: Named | Motion | None = None  # that it follows
    max_episode_steps: int = 12_000  # control ticks after which an episode is truncated

    def read(self) -> tuple[RobotDescription, LoadedPolicy | None, SimConfig]:
        """Return the robot, its policy, and a simulation that reports what this observes."""
        description = self.robot if isinstance(self.robot, RobotDescription) else load_robot(self.robot)
        if self.policy is None:
            return description, None, SimConfig()
        checkpoint = checkpoint_of(self.policy, description.joint_names)
        loaded = checkpoint.with_motion(motion_of(self.motion, checkpoint, description))
        return with_contract_physics(description, loaded.contract), loaded, observed_by(loaded.contract)


LITE_MODES = ModesEnvConfig(robot="lite", policy="lite_tracking", motion="wave")


class ModesEnv(gymnasium.Env[dict[str, Any], Any]):
    """One step is one control tick of the whole stack, as `play` runs it: read, supervisor, write.

    The action is an index into `INTENTS`, 0 for none. The reward is the time in s that the robot spends in LOCOMOTION.
    A granted QUIT terminates an episode. A fault does not: the stack falls back, and the operator starts it up again.
    Every episode begins as a run of `play` does: joints at rest in the robot's initial position, ZERO_TORQUE.

    `info` has `controller`, `status` (the latest message to the operator), `refusals` (of this tick, with reasons),
    `faults` (what failed in this tick) and `time`, s.
    """

    metadata = {"render_modes": RENDER_MODES, "render_fps": 200}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(self, config: ModesEnvConfig = LITE_MODES, *, render_mode: str | None = None, **options: Any) -> None:
        """Build robot and stack; `options` change fields. Raises `InputError` for what does not fit."""
        self.config = config = changed(config, options)
        description, loaded, sim = config.read()
        self.robot = SimRobot(description, replace(sim, drop=DROP))
        period, live = self.robot.control_period, {**self.robot.extern, VELOCITY_COMMAND: 3}
        self.supervisor = build_supervisor(description, period, loaded, live=live)
        self._display = Display(description, period, render_mode)
        self.metadata, self.render_mode = self._display.metadata, render_mode
        self.action_space = Discrete(len(INTENTS))
        self.observation_space = modes_observation_space(description)
        self._memory: SupervisorMemory | None = None
        self._velocity: FloatArray = np.zeros(3)
        self._steps = 0

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Relaunch: the robot as it starts, in ZERO_TORQUE; nothing is random.

        `options` takes a `command`: vx, vy in m/s and yaw rate in rad/s for a policy that walks.
        """
        super().reset(seed=seed)
        given = reset_options(options, {"command": 3})
        self._velocity = velocity_option(given.get("command", np.zeros(3)))[0]
        self.robot.relaunch()
        self._memory, self._steps = self.supervisor.initial(), 0
        self._display.show(self.robot.data.qpos)
        return self._observe(None), first_info(self._memory)

    def step(self, action: Any) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """One control tick. Raises `InputError` for an action that is none of the space."""
        if self._memory is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        if not self.action_space.contains(action):
            raise InputError(f"action: is {action!r}, expected a whole number from 0 to {len(INTENTS) - 1}")
        tick = tick_input(*self.robot.read(), self._velocity, int(action))
        self._memory, output = self.supervisor.step(self._memory, tick)
        mode = output.control_mode.mode
        if self.robot.base is not None:
            support_in_mode(self.robot, mode)
        self.robot.write(output.command)
        self._steps += 1
        self._display.show(self.robot.data.qpos)
        reward = self.robot.control_period if mode.is_free else 0.0
        is_late = self._steps >= self.config.max_episode_steps
        return self._observe(output), reward, output.quit, is_late, step_info(output, self.robot.time)

    def _observe(self, output: TickOutput | None) -> dict[str, Any]:
        state, safety = self.robot.read()
        return modes_observation(state, output, safety)

    def render(self) -> npt.NDArray[np.uint8] | None:
        return self._display.picture(self.robot.data.qpos)

    def close(self) -> None:
        self._display.close()
        self.robot.close()


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
        given = reset_options(options, {"command": 3})
        self._velocity = velocity_option(given.get("command", np.zeros(3)), self.num_envs)
        self._memories = [self.supervisor.initial()] * self.num_envs
        self._begin(np.ones(self.num_envs, dtype=np.bool_))
        return self._report([None] * self.num_envs)

    def _begin(self, over: BoolArray) -> None:
        self.simulation.reset(np.flatnonzero(over))
        self._memories = [self.supervisor.initial() if over[i] else each for i, each in enumerate(self._memories)]
        self._steps[over] = 0
        self._is_over = np.zeros(self.num_envs, dtype=np.bool_)

    def step(
        self, actions: npt.NDArray[Any]
    ) -> tuple[dict[str, Any], FloatArray, BoolArray, BoolArray, dict[str, Any]]:
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
        self.simulation.close()


def tick_input(state: MITState, safety: tuple[SafetyStatus, ...], velocity: FloatArray, action: int) -> TickInput:
    """Return the input of a tick: what a robot reports, the velocity command (3,), and an action's intent."""
    state = replace(state, extern={**state.extern, VELOCITY_COMMAND: Extern(velocity, 0.0)})
    intent = INTENTS[action]
    return TickInput(state, safety, () if intent is None else (intent,))


def first_info(memory: SupervisorMemory) -> dict[str, Any]:
    """Return the info of a reset."""
    info = {"controller": memory.controller, "status": memory.status_message}
    return {**info, "refusals": (), "faults": (), "time": 0.0}


def step_info(output: TickOutput, time: float) -> dict[str, Any]:
    """Return the info of a tick at the end of which it is `time`, s."""
    return {
        "controller": output.control_mode.controller_name,
        "status": output.control_mode.status_message,
        "refusals": output.refusals,
        "faults": tuple(f"{fault.controller}: {fault.message}" for fault in output.faults),
        "time": time,
    }
