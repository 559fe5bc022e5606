"""A policy's view of one robot as a Gymnasium environment: what it is trained on, and what it is deployed on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from humanoid_sim.envs.config import PolicyEnvConfig, build_scenario, policy_config
from humanoid_sim.envs.display import RENDER_MODES, Display
from humanoid_sim.envs.spaces import action_space, observation_space, raw_action, reset_options, velocity_option
from humanoid_sim.envs.tasks import require_finite
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.randomisation import Randomisation
from humanoid_sim.simulation.sim_robot import SimRobot

Array = npt.NDArray[Any]
Step = tuple[Array, float, bool, bool, dict[str, Any]]


class PolicyEnv(gymnasium.Env[Array, Array]):
    """One step is one policy step: the action's command, held for the contract's `policy_dt`.

    The action is the policy's raw action and the observation what the policy observes, made by the functions of the
    deployed controller. Whatever is a fault there ends the episode here, with `terminated`, reward 0 and
    `info["fault"]`: an action that is not finite or beyond `action_limit`, a guard that trips, a simulation that is no
    longer sound, an observation that is not finite. Nothing holds a floating base.

    `info` has `frame`, the reference frame that the observation shows, and `terms`, each reward term's share.

    `reset` takes these options:

    - `command`: vx, vy in m/s and yaw rate in rad/s, held for the whole episode; or several such rows, each for 5 s.
    - `qpos`, `qvel`, `warmstart`: the simulation's state, to begin where a run is.
    """

    metadata = {"render_modes": RENDER_MODES, "render_fps": 50}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(self, config: PolicyEnvConfig | str, *, render_mode: str | None = None, **options: Any) -> None:
        """Build the robot of a configuration, or of a name in `CONFIGS`; `options` change some of its fields."""
        self.config = config = policy_config(config, options)
        if config.implicit:
            raise InputError("implicit: is for many robots at once, expected a vector environment (make_vec)")
        self.scenario = scenario = build_scenario(config)
        self._display = Display(scenario.description, scenario.contract.policy_dt, render_mode)
        self.metadata, self.render_mode = self._display.metadata, render_mode
        self.observation_space = observation_space(scenario.wiring)
        self.action_space = action_space(scenario.wiring, scenario.description)
        self.robot = SimRobot(scenario.description, scenario.sim_config)
        self.max_episode_steps = scenario.task.episode_steps
        """Steps after which every episode is truncated, if it is not over before."""
        self._randomisation = Randomisation.of(config.randomisation)
        self._loop: ClosedLoop | None = None
        self._observation: Array = np.zeros(scenario.wiring.layout.width, dtype=np.float32)
        self._commands: FloatArray = np.zeros((1, 3))
        self._steps = 0

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode; the same seed gives the same start. Raises `InputError` for an option that is not known."""
        super().reset(seed=seed)
        scenario, model = self.scenario, self.robot.model
        given = reset_options(options, {"command": 3, "qpos": model.nq, "qvel": model.nv, "warmstart": model.nv})
        if self._randomisation.differs:
            self.robot.vary(self._randomisation, self.np_random)
        start = scenario.starts(self.np_random.random(scenario.starts.draws))
        self._commands = velocity_option(given["command"]) if "command" in given else start.commands
        self.robot.reset(given.get("qpos", start.qpos), given.get("qvel", start.qvel), given.get("warmstart"))
        self._steps = 0
        velocity = scenario.task.command(self._commands, 0)
        self._loop = loop = ClosedLoop(self.robot, scenario.wiring, velocity, scenario.guards)
        self._observation = loop.observation
        self._display.show(self.robot.data.qpos)
        return self._observation.copy(), {"frame": int(loop.memory.frame)}

    def step(self, action: Array) -> Step:
        """One policy step. Raises `InputError` if the action has another shape, or a reward is not finite."""
        loop, task = self._loop, self.scenario.task
        if loop is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        raw, frame = raw_action(action, self.action_space), loop.memory.frame
        if not loop.wiring.accepts(raw):
            return self._fault(loop.wiring.action_problem(raw), frame)
        self._steps += 1
        with np.errstate(all="ignore"):  # the observation of a simulation that has diverged may be anything
            loop.act(raw, velocity=task.command(self._commands, self._steps))
        if loop.alarms:
            return self._fault(loop.alarms[0], frame)
        fault = self.robot.fault or loop.wiring.observation_problem(loop.observation)
        if fault:
            return self._fault(fault, frame)
        judgement = task.judge(loop.sample(self._steps))
        require_finite(judgement.reward, judgement.terms)
        self._observation = loop.observation
        self._display.show(self.robot.data.qpos)
        info = {"frame": loop.memory.frame, "terms": judgement.terms}
        ends = bool(judgement.terminated), bool(judgement.truncated)
        return loop.observation.copy(), float(judgement.reward), *ends, info

    def _fault(self, fault: str, frame: Any) -> Step:
        return self._observation.copy(), 0.0, True, False, {"frame": frame, "terms": {}, "fault": fault}

    def render(self) -> npt.NDArray[np.uint8] | None:
        return self._display.picture(self.robot.data.qpos)

    def close(self) -> None:
        self._display.close()
        self.robot.close()
