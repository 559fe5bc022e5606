"""The whole control stack as a Gymnasium environment: an operator's view, for rollouts of the five-mode FSM."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.live_inputs import LiveInput, LiveInputs
from humanoid_sim.controllers.supervisor import SupervisorMemory
from humanoid_sim.envs.base import RENDER_MODES, ShownEnv
from humanoid_sim.envs.episode_robot import EpisodeRobot
from humanoid_sim.envs.resets import refuse_others, velocity_option
from humanoid_sim.envs.scenario import Named, read_policy
from humanoid_sim.envs.spaces import INTENTS, modes_action_space, modes_observation, modes_observation_space
from humanoid_sim.errors import FieldError, InputError, blaming
from humanoid_sim.messages import ControlMode, Intent, Mode, SafetyStatus, TickInput, TickOutput
from humanoid_sim.mit import COMMAND_FIELDS, EXTERN_WIDTHS, VELOCITY_COMMAND, Extern, FloatArray, MITCommand, MITState
from humanoid_sim.policy.motion import Motion
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract_physics
from humanoid_sim.session.sources import RemoteInbox
from humanoid_sim.simulation import DROP
from humanoid_sim.simulation.floating_base import support_in_mode
from humanoid_sim.simulation.plant import Actuation
from humanoid_sim.stack import build_supervisor

Step = tuple[dict[str, Any], float, bool, bool, dict[str, Any]]


class ModesEnv(ShownEnv, gymnasium.Env[dict[str, Any], Any]):
    """One step is one control tick of the whole stack, as `play` runs it: read, supervisor, write.

    The action is an intent, 0 for none, and, with `remote`, a remote command to go with it; `spaces` describes
    both spaces. The reward is the time in s that the robot spends in LOCOMOTION or REMOTE. An episode is terminated by
    a granted QUIT, and truncated after `episode_seconds`. A fault is not the end: the stack falls back, and it is for
    the operator to walk up again.

    Every episode starts as a run of `play` does: joints at rest in the robot's initial position, ZERO_TORQUE. Nothing
    in it is random, so the seed decides nothing but the samples of the action space.

    `info` has `controller`, `status` (the latest word to the operator), `refusals` (what was refused in this tick and
    why, the remote command included), `faults` (what failed in this tick, and who took over), and `time`, s.
    """

    KEPT = ("_memory", "_velocity", "_sound", "_steps")
    metadata = {"render_modes": RENDER_MODES, "render_fps": 200}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self,
        robot: Named | RobotDescription,
        policy: Named | None = None,
        motion: Named | Motion | None = None,
        *,
        remote: bool = False,
        control_frequency: float | None = None,
        actuation: Actuation = "affine",
        action_limit: float | None = None,
        live: Mapping[str, LiveInput] | None = None,
        episode_seconds: float = 60.0,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: str | None = None,
    ) -> None:
        """Build robot and stack. Raises `InputError` for what cannot be read, or does not fit.

        Args:
            robot: a description, or what `load_robot` takes.
            policy: of LOCOMOTION: a checkpoint (.onnx) by name or path; None for a stack without LOCOMOTION.
            motion: what it follows, as `PolicyEnv` takes it.
            remote: whether REMOTE is available, and the action has a remote command.
            control_frequency: Hz; None for the robot's.
            actuation: `affine`, stepped natively, or `qfrc_applied`, the reference.
            action_limit: as `make_scenario` takes it, like `live`, which is called once in every tick.
            episode_seconds: s after which an episode is truncated.
            render_mode: as `PolicyEnv` takes it, and the three that follow.
        """
        description = robot if isinstance(robot, RobotDescription) else load_robot(robot)
        frequency = description.simulation.control_frequency if control_frequency is None else control_frequency
        for name, value in (("control_frequency", frequency), ("episode_seconds", episode_seconds)):
            if not 0.0 < value < np.inf:
                raise InputError(f"{name}: is {value}, expected a finite number > 0")
        period = 1.0 / frequency
        loaded = None if policy is None else read_policy(policy, motion, description.joint_names)
        if loaded is not None:
            description = with_contract_physics(description, loaded.contract)
        self._prepare_pictures(description, period, render_mode, (width, height, camera))
        observed = None if loaded is None else loaded.contract
        self.robot = EpisodeRobot(
            description,
            control_period=period,
            actuation=actuation,
            drop=DROP,
            anchor_body="" if observed is None else observed.anchor_body,
            velocity_at=() if observed is None else observed.velocity_points,
            height_scan=None if observed is None else observed.height_scan,
        )
        self._live = _live_inputs(description.name, observed, live)
        provided = {
            **self.robot.extern,
            VELOCITY_COMMAND: EXTERN_WIDTHS[VELOCITY_COMMAND],
            **(self._live.widths if self._live else {}),
        }
        self.supervisor = build_supervisor(
            description, period, loaded, remote=remote, live=provided, action_limit=action_limit
        )
        self.action_space = modes_action_space(description, remote)
        self.observation_space = modes_observation_space(description)
        self.is_remote = remote
        """True where REMOTE is available, and actions have a remote command."""
        self.max_episode_steps = max(round(episode_seconds / period), 1)
        self._memory: SupervisorMemory | None = None
        self._inbox = RemoteInbox(self.robot.joints, lambda: self.robot.time)
        self._velocity: FloatArray = np.zeros(3)
        self._sound, _ = self._read()
        self._steps = 0

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Relaunch: the robot as it starts, in ZERO_TORQUE.

        Raises `InputError` if an option is unknown, or does not hold what it should.

        Args:
            seed: of the random numbers that Gymnasium keeps.
            options: `command`: vx, vy in m/s and yaw rate in rad/s for a policy that walks.
        """
        super().reset(seed=seed)
        options = {} if options is None else dict(options)
        self._velocity = velocity_option(options.pop("command", np.zeros(3)))
        refuse_others(options, "command")
        self.robot.relaunch()
        self._memory, self._steps = self.supervisor.initial(), 0
        self._inbox = RemoteInbox(self.robot.joints, lambda: self.robot.time)
        state, safety = self._read()
        mode = ControlMode(Mode.ZERO_TORQUE, self._memory.controller, self._memory.status_message)
        self._show(TickInput(state, safety), TickOutput(MITCommand.zeros(len(self.robot.joints)), mode))
        info = {"controller": mode.controller_name, "status": mode.status_message, "time": 0.0}
        return self._observe(state, None, safety), info | {"refusals": (), "faults": ()}

    def step(self, action: Any) -> Step:
        """One control tick.

        Raises:
            InputError: the action is not one of the space.
            gymnasium.error.ResetNeeded: there was no reset yet.
        """
        if self._memory is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        intent, refusals = self._take(action)
        state, safety = self._read()
        if self._live is not None:
            state = self._live.extend(state)
        tick = TickInput(state, safety, () if intent is None else (intent,), self._inbox.latest())
        self._memory, output = self.supervisor.step(self._memory, tick)
        mode = output.control_mode.mode
        if self.robot.base_state is not None:
            support_in_mode(self.robot, mode)
        self._show(tick, output)
        self.robot.write(output.command)
        self._steps += 1

        reward = self.robot.control_period if mode.is_free else 0.0
        info = {
            "controller": output.control_mode.controller_name,
            "status": output.control_mode.status_message,
            "refusals": (*refusals, *output.refusals),
            "faults": tuple(f"{fault.controller}: {fault.message}" for fault in output.faults),
            "time": self.robot.time,
        }
        state, safety = self._read()
        observation = self._observe(state, output, safety)
        return observation, reward, output.quit, self._steps >= self.max_episode_steps, info

    def snapshot(self) -> dict[str, Any]:
        """See `CopyableEnv.snapshot`."""
        return super().snapshot() | {"robot": self.robot.snapshot(), "_inbox": self._inbox.latest()}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """See `CopyableEnv.restore`."""
        robot, latest = snapshot["robot"], snapshot["_inbox"]
        super().restore({name: value for name, value in snapshot.items() if name not in ("robot", "_inbox")})
        self.robot.restore(robot)
        self._inbox = RemoteInbox(self.robot.joints, lambda: self.robot.time, latest)

    def _read(self) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        state, safety = self.robot.read()
        return replace(state, extern={**state.extern, VELOCITY_COMMAND: Extern(self._velocity, 0.0)}), safety

    def _observe(self, state: MITState, output: TickOutput | None, safety: tuple[SafetyStatus, ...]) -> dict[str, Any]:
        """Return what is shown: of a simulation that is no longer sound the last state in which it was."""
        if all(status.is_ok for status in safety):
            self._sound = state
        return modes_observation(self._sound, output, safety)

    def _take(self, action: Any) -> tuple[Intent | None, tuple[str, ...]]:
        """Give the intent of an action, and why its remote command, which goes where those of others do, is refused."""
        if self.is_remote and not (isinstance(action, Mapping) and {"intent", "send"} <= action.keys()):
            raise InputError(f"action: is {action!r}, expected a mapping with intent, send and command")
        number = action["intent"] if self.is_remote else action
        if not spaces.Discrete(len(INTENTS)).contains(number):
            raise InputError(f"action: intent is {number!r}, expected a whole number from 0 to {len(INTENTS) - 1}")
        if self.is_remote and action["send"]:
            try:
                self._inbox.put(self.robot.joints, self._remote_command(action.get("command")))
            except FieldError as error:
                return INTENTS[int(number)], (str(error),)
        return INTENTS[int(number)], ()

    def _remote_command(self, fields: Any) -> MITCommand:
        """Return the command whose fields are the rows of an array.

        Raises `FieldError` if there are not as many numbers as the space has.
        """
        expected = len(COMMAND_FIELDS), len(self.robot.joints)
        try:
            rows = np.asarray(fields, dtype=np.float64)
        except (TypeError, ValueError):
            rows = np.empty(0)
        if rows.shape != expected:
            raise FieldError(f"remote command has shape {rows.shape}, expected {expected}")
        return MITCommand(*rows)


def _live_inputs(
    robot: str, contract: PolicyContract | None, live: Mapping[str, LiveInput] | None
) -> LiveInputs | None:
    """Return what feeds the policy's live inputs; None without a policy."""
    if contract is None:
        if live:
            raise InputError(f"live['{next(iter(live))}']: is given, but there is no policy that observes it")
        return None
    with blaming(f"policy on robot '{robot}'"):
        return LiveInputs(contract, {} if live is None else dict(live))
