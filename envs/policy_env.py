"""A policy's view of one robot as a Gymnasium environment: what it is trained on, and what it is deployed on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

import gymnasium
import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.base import RL_POLICY
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import PolicyMemory
from humanoid_sim.controllers.reference import Frame
from humanoid_sim.controllers.rl_policy import RLPolicyMemory
from humanoid_sim.envs.base import RENDER_MODES, PolicyEnvironment, ShownEnv
from humanoid_sim.envs.episode_robot import EpisodeRobot, PlantState, RandomisedRobot
from humanoid_sim.envs.resets import refuse_others, velocity_option
from humanoid_sim.envs.scenario import Motions, Named
from humanoid_sim.envs.spaces import action_space
from humanoid_sim.envs.tasks.task import require_finite
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.rollout import ClosedLoop, sample_step
from humanoid_sim.messages import ControlMode, Mode, TickInput, TickOutput
from humanoid_sim.mit import FloatArray, MITCommand, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.batch import Randomisation
from humanoid_sim.simulation.mujoco_robot import StateSampling
from humanoid_sim.simulation.plant import BatchActuation, check_actuation

Array = npt.NDArray[Any]
Step = tuple[Array, float, bool, bool, dict[str, Any]]


class PolicyEnv(PolicyEnvironment, ShownEnv, gymnasium.Env[Array, Array]):
    """One step is one policy step: the action's command, held for the contract's `policy_dt`.

    The action is the policy's raw action and the observation what the policy observes, made by the functions of the
    deployed controller, so a checkpoint that runs here runs in `play` and on the robot, and the other way round. An
    action that is not finite, or beyond `action_limit`, is a fault there; here it ends the episode: `terminated`, no
    reward, and `info["fault"]` says what was wrong. So do a guard that trips, a simulation that is no longer sound and
    an observation beyond its bounds. Nothing holds a floating base: a fall is a fall.

    `info` has `frame`, the reference frame that the observation shows, `terms`, what each term adds to the reward,
    `fault` where there was one.

    `reset` takes these options:

    - `command`: vx, vy in m/s and yaw rate in rad/s, held for the whole episode in place of those that the task draws.
    - `state`, `memory`: a `PlantState`, and the policy controller's memory that belongs to it.
    """

    KEPT = ("_observation", "_commands", "_steps", "_drawn_from")
    metadata = {"render_modes": RENDER_MODES, "render_fps": 50}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self,
        contract: Named | PolicyContract,
        robot: Named | RobotDescription,
        motion: Motions | None = None,
        *,
        command_delay: float = 0.0,
        state_delay: float = 0.0,
        state_sampling: StateSampling = "now",
        randomisation: Randomisation | Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: str | None = None,
        **options: Any,
    ) -> None:
        """Build the robot. Delays are between robot and policy: rewards and terminations are those of the true state.

        Raises `InputError` for what cannot be read, or does not fit.

        Args:
            contract: of the policy; or the name or path of a checkpoint (.onnx) or a contract file (.yaml).
            robot: a description, or what `load_robot` takes.
            motion: a sample motion by name, a file by path, or the motion itself, or several of these, of which each
                episode has one; None for the one that a checkpoint carries in its graph, and for policies that follow
                none.
            command_delay: s from a step's beginning to its command's arrival.
            state_delay: s from a state to its being observed.
            state_sampling: `now` or `on_command`; see `MujocoRobot`.
            randomisation: how the episodes' robots differ, or its fields by name, as `PolicyVectorEnv` takes it; None:
                not at all. The delays are then part of it, and the plant is one that a batch can have.
            render_mode: `rgb_array`, `human` or None.
            width: pixels of a picture, like the height.
            camera: of the model; None looks at the robot from the front.
            options: as `make_scenario` takes them.
        """
        self.observation_space = self._prepare(contract, robot, motion, options)
        scenario = self.scenario
        self._prepare_pictures(scenario.description, scenario.contract.policy_dt, render_mode, (width, height, camera))
        self.action_space = action_space(scenario.wiring, scenario.description)
        self.robot = self._robots = self._make_robot(randomisation, command_delay, state_delay, state_sampling)
        self._drawn_from: int | None = None
        self.max_episode_steps = scenario.task.episode_steps
        self._observation = np.zeros(scenario.wiring.layout.width, dtype=np.float32)
        self._commands: FloatArray = np.zeros((1, 3))
        self._steps = 0

    def _make_robot(
        self,
        randomisation: Randomisation | Mapping[str, Any] | None,
        command_delay: float,
        state_delay: float,
        state_sampling: StateSampling,
    ) -> EpisodeRobot | RandomisedRobot:
        scenario = self.scenario
        if randomisation is None:
            return EpisodeRobot(
                scenario.description,
                **scenario.robot_options(),
                support=False,
                command_delay=command_delay,
                state_delay=state_delay,
                state_sampling=state_sampling,
            )
        for name, value in (("command_delay", command_delay), ("state_delay", state_delay)):
            if value:
                raise InputError(f"{name}: is {value:g} s beside a randomisation, expected it as a field of that")
        if state_sampling != "now":
            raise InputError(f"state_sampling: is {state_sampling!r} beside a randomisation, expected now")
        check_actuation(scenario.actuation, get_args(BatchActuation))
        drawn = Randomisation.of(randomisation)
        return RandomisedRobot(scenario.description, randomisation=drawn, **scenario.robot_options())

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode; the same seed gives the same start.

        Raises `InputError` if an option is unknown, or does not hold what it should.
        """
        super().reset(seed=seed)
        plant, memory, frame = self._begin({} if options is None else dict(options), is_seeded=seed is not None)
        self.robot.place(plant)
        self._steps = 0
        velocity = self.scenario.task.command(self._commands, 0)
        self._loop = loop = ClosedLoop(
            self.robot, self.scenario.wiring, velocity, self.scenario.live, self.scenario.guards, frame
        )
        if memory is not None:
            loop.observation, loop.memory = loop.wiring.observe(memory, loop.state)
        self._observation = loop.observation
        self._show_step(loop.state, MITCommand.zeros(len(self.robot.joints)))
        return self._observation.copy(), {"frame": int(loop.memory.frame)}

    def _begin(self, options: dict[str, Any], *, is_seeded: bool) -> tuple[PlantState, PolicyMemory | None, int]:
        """Return where the robot begins, with the policy's memory unless it is a fresh one, and the first frame shown.

        It sets the episode's commands.
        """
        scenario = self.scenario
        start = scenario.starts(self.np_random.random(scenario.starts.draws))
        if isinstance(self.robot, RandomisedRobot):
            is_new = is_seeded or self._drawn_from != self.np_random_seed
            self._drawn_from = self.np_random_seed
            self.robot.draw(self.np_random_seed % 2**64 if is_new else None)
        plant, self._commands = self.robot.started(start), start.commands
        frame = 0 if start.frame is None or "state" in options else int(start.frame)
        if "command" in options:
            self._commands = velocity_option(options.pop("command"))[None]
        plant, memory = options.pop("state", plant), options.pop("memory", None)
        refuse_others(options, "command", "state", "memory")
        if not isinstance(plant, PlantState):
            raise InputError(f"reset: state is a {type(plant).__name__}, expected a PlantState")
        if isinstance(memory, RLPolicyMemory):
            memory = memory.policy
        if not isinstance(memory, PolicyMemory | None):
            raise InputError(f"reset: memory is a {type(memory).__name__}, expected an RLPolicyMemory")
        return plant, memory, frame

    def step(self, action: Array) -> Step:
        """One policy step.

        Raises:
            InputError: the action has another shape than the space's, or a reward is not finite.
            gymnasium.error.ResetNeeded: there was no reset yet.
        """
        loop, task = self._loop, self.scenario.task
        if loop is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        with np.errstate(over="ignore"):  # becomes infinite, and is refused
            raw = np.array(action, dtype=np.float32)
        if raw.shape != self.action_space.shape:
            raise InputError(f"action: has shape {raw.shape}, expected {self.action_space.shape}")
        frame = loop.memory.frame
        if not loop.wiring.accepts(raw):
            return self._lost(loop.wiring.action_problem(raw), frame)
        self._steps += 1
        with np.errstate(all="ignore"):  # of a simulation that is no longer sound the observation may be anything
            command = loop.act(raw, velocity=task.command(self._commands, self._steps))
        if loop.tripped:
            return self._lost(loop.alarms[0], frame)
        if self.robot.fault:
            return self._lost(self.robot.fault, frame)
        observation, frame = loop.observation, loop.memory.frame
        problem = loop.wiring.observation_problem(observation)
        if problem:
            return self._lost(problem, frame)

        sample = sample_step(loop, self.robot, self._steps)
        judgement = task.judge(sample)
        require_finite(judgement.reward, judgement.terms)
        self._observation = observation.copy()
        self._show_step(loop.state, command)
        info = {"frame": frame, "terms": judgement.terms}
        return observation, float(judgement.reward), bool(judgement.terminated), bool(judgement.truncated), info

    def _lost(self, fault: str, frame: Frame) -> Step:
        self.fault_count += 1
        return self._observation.copy(), 0.0, True, False, {"frame": frame, "terms": {}, "fault": fault}

    def _show_step(self, state: MITState, command: MITCommand) -> None:
        mode = ControlMode(Mode.LOCOMOTION, RL_POLICY, f"step {self._steps}")
        self._show(TickInput(state), TickOutput(command, mode))
