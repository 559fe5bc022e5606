"""What an environment is made of: one frozen configuration, and the scenario that it resolves to."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar, cast

from humanoid_sim import mit
from humanoid_sim.assets import motion_path, policy_path, sample_songs
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.guards import Guards
from humanoid_sim.controllers.live_inputs import LiveInput, LiveInputs
from humanoid_sim.controllers.policy_step import Policy, PolicyWiring
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.envs.starts import EpisodeStarts
from humanoid_sim.envs.tasks import Task
from humanoid_sim.errors import InputError, blaming, require_known
from humanoid_sim.evaluation.step import StepContext, StepSample
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint, required_contract, zero_policy
from humanoid_sim.policy.layers import join
from humanoid_sim.policy.loaded_policy import LoadedPolicy
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.policy.readers.own import read_contract_file
from humanoid_sim.policy.song import load_song, song_motion
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract, with_joint_limits
from humanoid_sim.robots.guards import guards_of
from humanoid_sim.simulation.model import SimConfig, build_model
from humanoid_sim.simulation.randomisation import Randomisation
from humanoid_sim.simulation.sensing import live_inputs

Named = str | Path
"""Name of a file that ships with the package, or a path."""
Motions = Named | Motion | Sequence[Named | Motion]
RewardTerm = tuple[float, Callable[[StepSample], FloatArray | float]]
"""A weight, 1/s, and the term's value of a policy step: shape (...), or one number for all robots."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyEnvConfig:
    """A policy's environment, whatever its seed. `dataclasses.replace` changes one; so do keywords of `make`."""

    policy: Named | PolicyContract | Checkpoint
    """A checkpoint (.onnx), a contract file (.yaml) or a `PolicyContract`."""
    robot: Named | RobotDescription
    """A shipped robot, a description (.yaml) or an MJCF."""
    motion: Motions | None = None
    """A sample motion, a file, of a piano policy a song or MIDI file; several, of which each episode has one; None: the
    one in the checkpoint, or none."""
    task: str = "auto"
    """A key of `humanoid_sim.envs.tasks.TASKS`; `auto`: the one that policy and motion are made for."""
    rewards: Mapping[str, float | RewardTerm] = field(default_factory=dict)
    """Weights, 1/s, of rows of `step_metrics.METRICS`, or (weight, function of a `StepSample`); beside the task's."""
    terminations: tuple[str, ...] | None = None
    """Rows of `METRICS` that end the episode where they are not 0; None: the task's."""
    max_episode_steps: int | None = None
    """Policy steps after which an episode is truncated; None: the motion's, or 20 s."""
    joint_noise: float = 0.05
    """rad by which each joint may start off the default pose."""
    velocity_noise: float = 0.1
    """rad/s by which each joint may start off rest."""
    physics_timestep: float | None = None
    """s; None: the robot's."""
    implicit: bool = False
    """Integrate the motors' damping implicitly, in longer physics steps: for training, not exact."""
    randomisation: Randomisation | Mapping[str, Any] | None = None
    """How the robots of different episodes differ."""
    guards: bool = True
    """The guards of the control stack end an episode as they end LOCOMOTION."""
    action_limit: float | None = None
    """Largest magnitude of a raw action, beyond which the policy has failed; None: the contract's, or 100."""
    live: Mapping[str, LiveInput] = field(default_factory=dict)
    """By name, makers of the live inputs that the contract declares: of an `MITState` a value (..., width)."""

    def __post_init__(self) -> None:
        """Check the numbers. Raises `InputError`."""
        for name in ("joint_noise", "velocity_noise"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise InputError(f"{name}: is {getattr(self, name)!r}, expected a finite number >= 0")
        if self.max_episode_steps is not None and self.max_episode_steps < 1:
            raise InputError(f"max_episode_steps: is {self.max_episode_steps!r}, expected a whole number >= 1")
        if self.action_limit is not None and not 0.0 < self.action_limit < 1e38:
            raise InputError(f"action_limit: is {self.action_limit!r}, expected a finite number > 0")


CONFIGS: Mapping[str, PolicyEnvConfig] = {
    "lite_tracking": PolicyEnvConfig(policy="lite_tracking", robot="lite", motion="wave"),
    "biped_velocity": PolicyEnvConfig(policy="lite_biped_velocity", robot="lite_biped"),
    "lite_piano": PolicyEnvConfig(policy="lite_piano_task", robot="lite_piano", motion="ode_to_joy"),
}
"""Those of the registered environments."""

Config = TypeVar("Config", bound=Any)


def changed(config: Config, options: Mapping[str, Any]) -> Config:
    """Return the configuration with other values of some fields. Raises `InputError` for an unknown one."""
    require_known("option", options, [one.name for one in fields(config)])
    return replace(config, **options)


def policy_config(config: PolicyEnvConfig | str, options: Mapping[str, Any]) -> PolicyEnvConfig:
    """Return a configuration, or one of `CONFIGS`, with other values of some fields."""
    if isinstance(config, str):
        require_known("config", [config], CONFIGS)
        config = CONFIGS[config]
    return changed(config, options)


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """Parts of an environment that do not depend on how many robots there are."""

    config: PolicyEnvConfig
    description: RobotDescription
    """The robot, with the contract's gains, in the contract's default pose."""
    wiring: PolicyWiring
    """Observations and commands of the policy, by the functions of the deployed controller."""
    task: Task
    starts: EpisodeStarts
    policy: Policy
    """The checkpoint's; one that answers zeros where there is only a contract."""
    contract_as_read: PolicyContract
    """Contract of the policy, before the robot's own limits went into it."""
    motion: Motions | None
    """What the policy was given to follow, songs as the goals that they came to."""
    live: LiveInputs
    guards: Guards | None

    @property
    def contract(self) -> PolicyContract:
        """Return the policy's contract."""
        return self.wiring.contract

    @property
    def sim_config(self) -> SimConfig:
        """Return the settings of simulated robots, one or a batch."""
        return replace(
            observed_by(self.contract),
            control_period=self.contract.policy_dt,
            physics_timestep=self.config.physics_timestep,
            bodies=self.task.context.tracked,
            support=False,
        )


def build_scenario(config: PolicyEnvConfig, *, motion_source: str = "motion") -> Scenario:
    """Read what is named, and check that it fits together. Raises `InputError`.

    `motion_source` names a motion that is given itself.
    """
    described = config.robot if isinstance(config.robot, RobotDescription) else load_robot(config.robot)
    checkpoint = checkpoint_of(config.policy, described.joint_names)
    motion = _with_songs(config.motion, checkpoint.contract, described)
    loaded = read_policy(checkpoint, motion, motion_source)
    contract = with_joint_limits(loaded.contract, described)
    description = with_contract(described, contract)
    with blaming(f"policy on robot '{description.name}'"):
        live = LiveInputs(contract, config.live)
        reported = live_inputs(description, observed_by(contract))
        provided = {mit.VELOCITY_COMMAND: 3, **reported, **live.widths}
        extern = {name: width for name, width in loaded.extern.items() if name in provided}
        wiring = PolicyWiring(description.joint_names, contract, loaded.reference, extern, config.action_limit)
    context = StepContext(description, contract, loaded.reference)
    task = Task(config, context)
    noise = config.joint_noise, config.velocity_noise
    model = build_model(description, scene="floor")
    starts = EpisodeStarts(context, model, noise, task.commands, task.command_draws)
    context.standing_height = starts.standing_height
    return Scenario(
        config=config,
        description=description,
        wiring=wiring,
        task=task,
        starts=starts,
        policy=loaded.policy,
        contract_as_read=loaded.contract,
        motion=motion,
        live=live,
        guards=guards_of(description) if config.guards else None,
    )


def observed_by(contract: PolicyContract) -> SimConfig:
    """Return the settings of a simulated robot whose state a policy observes."""
    return SimConfig(
        anchor_body=contract.anchor_body, velocity_at=contract.velocity_points, height_scan=contract.height_scan
    )


def checkpoint_of(source: Named | PolicyContract | Checkpoint, joints: tuple[str, ...]) -> Checkpoint:
    """Return a checkpoint, or a contract with a policy that answers zeros. Raises `InputError` if it cannot be read."""
    if isinstance(source, Checkpoint):
        return source
    if isinstance(source, PolicyContract):
        return Checkpoint(source, zero_policy(source.action_count), "contract")
    path = policy_path(source, "policy", contracts=True)
    if path.suffix == ".onnx":
        return load_checkpoint(path, None, joints)
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"policy: is '{source}', expected a checkpoint (.onnx) or a contract (.yaml)")
    contract = required_contract(join([read_contract_file(path)], str(path)), path)
    return Checkpoint(contract, zero_policy(contract.action_count), str(path))


def _with_songs(motion: Motions | None, contract: PolicyContract, robot: RobotDescription) -> Motions | None:
    """Return the motions with goals in the place of songs and MIDI files, as far as the robot plays them."""
    if contract.task_type != "piano" or motion is None or isinstance(motion, Motion):
        return motion
    if not isinstance(motion, str | Path):
        return [cast("Named | Motion", _with_songs(one, contract, robot)) for one in motion]
    if str(motion) not in sample_songs() and not str(motion).endswith((".mid", ".midi")):
        return motion
    return song_motion(load_song(str(motion), robot, what="motion"), contract.policy_dt, robot)


def read_policy(checkpoint: Checkpoint, motion: Motions | None, motion_source: str = "motion") -> LoadedPolicy:
    """Return a policy with what it follows: one motion, or several, one after the other. Raises `InputError`."""
    if motion is not None and not isinstance(motion, str | Path | Motion):
        if not motion or checkpoint.motion is not None:
            raise InputError(f"motion: is {len(motion)} of them, and {checkpoint.source} expects one, or its own")
        loaded = [read_policy(checkpoint, one, f"{motion_source}[{i}]") for i, one in enumerate(motion)]
        with blaming("motion"):
            return replace(loaded[0], reference=MotionReference.joined([one.reference for one in loaded]))
    followed = motion if isinstance(motion, Motion) else checkpoint.motion
    source = motion_source if isinstance(motion, Motion | None) else str(motion)
    if isinstance(motion, str | Path):
        followed = read_motion(motion_path(str(motion)))
    if checkpoint.contract.task_type == "locomotion" and motion is not None:
        raise InputError(f"motion: is '{source}', but {checkpoint.source} follows no motion")
    return checkpoint.with_motion(followed, source)
