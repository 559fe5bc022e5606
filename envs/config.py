"""What an environment is made of: one frozen configuration, and the scenario that it resolves to."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from humanoid_sim import mit
from humanoid_sim.assets import motion_path, policy_path
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.guards import Guards
from humanoid_sim.controllers.policy_step import Policy, PolicyWiring
from humanoid_sim.envs.starts import EpisodeStarts
from humanoid_sim.envs.tasks import Task
from humanoid_sim.errors import InputError, blaming, require_known
from humanoid_sim.evaluation.step import StepContext, StepSample
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint, zero_policy
from humanoid_sim.policy.layers import join
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.policy.readers.own import read_contract_file
from humanoid_sim.policy.song import load_song, song_motion
from humanoid_sim.robots.description import RobotDescription, load_robot, with_contract, with_joint_limits
from humanoid_sim.robots.guards import guards_of
from humanoid_sim.simulation.model import SimConfig, build_model
from humanoid_sim.simulation.randomisation import Randomisation
from humanoid_sim.simulation.sensing import live_inputs

Named = str | Path  # name of a file that ships with the package, or a path
RewardTerm = tuple[float, Callable[[StepSample], FloatArray | float]]
"""A weight, 1/s, and the term's value of a policy step: shape (...), or one number for all robots."""
Config = TypeVar("Config", bound=Any)


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyEnvConfig:
    """A policy's environment, whatever its seed. `dataclasses.replace` changes one; so do keywords of `make`."""

    policy: Named | PolicyContract | Checkpoint  # a checkpoint (.onnx), a contract file (.yaml) or a `PolicyContract`
    robot: Named | RobotDescription  # a shipped robot, a description (.yaml) or an MJCF
    motion: Named | Motion | None = None
    """A sample motion, a file, of a piano policy a song or MIDI file; None: the one in the checkpoint, or none."""
    task: str = "auto"  # a key of `humanoid_sim.envs.tasks.TASKS`; `auto`: the one that policy and motion are made for
    rewards: Mapping[str, float | RewardTerm] = field(default_factory=dict)
    """Weights, 1/s, of rows of `step_metrics.METRICS`, or (weight, function of a `StepSample`); beside the task's."""
    terminations: tuple[str, ...] | None = None
    """Rows of `METRICS` that end the episode where they are not 0; None: the task's."""
    max_episode_steps: int | None = None
    """Policy steps after which an episode is truncated; None: the motion's, or 20 s."""
    joint_noise: float = 0.05  # rad by which each joint may start off the default pose
    velocity_noise: float = 0.1  # rad/s by which each joint may start off rest
    physics_timestep: float | None = None  # s; None: the robot's
    implicit: bool = False  # integrate the motors' damping implicitly, in longer physics steps: for training, not exact
    randomisation: Randomisation | Mapping[str, Any] | None = None  # how the robots of different episodes differ
    guards: bool = True  # the guards of the control stack end an episode as they end LOCOMOTION

    def __post_init__(self) -> None:
        for name in ("joint_noise", "velocity_noise"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise InputError(f"{name}: is {getattr(self, name)!r}, expected a finite number >= 0")
        if self.max_episode_steps is not None and self.max_episode_steps < 1:
            raise InputError(f"max_episode_steps: is {self.max_episode_steps!r}, expected a whole number >= 1")


CONFIGS: Mapping[str, PolicyEnvConfig] = {
    "lite_tracking": PolicyEnvConfig(policy="lite_tracking", robot="lite", motion="wave"),
    "biped_velocity": PolicyEnvConfig(policy="lite_biped_velocity", robot="lite_biped"),
    "lite_piano": PolicyEnvConfig(policy="lite_piano_task", robot="lite_piano", motion="ode_to_joy"),
}
"""Those of the registered environments."""


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
    description: RobotDescription  # with the contract's gains, in the contract's default pose
    wiring: PolicyWiring  # observations and commands of the policy, by the functions of the deployed controller
    task: Task
    starts: EpisodeStarts
    policy: Policy  # the checkpoint's; one that answers zeros where there is only a contract
    contract_as_read: PolicyContract  # before the robot's own limits went into it
    motion: Motion | None  # a song as the goals that it came to
    guards: Guards | None

    @property
    def contract(self) -> PolicyContract:
        return self.wiring.contract

    @property
    def sim_config(self) -> SimConfig:
        return replace(
            observed_by(self.contract),
            control_period=self.contract.policy_dt,
            physics_timestep=self.config.physics_timestep,
            bodies=self.task.context.tracked,
            support=False,
        )


def build_scenario(config: PolicyEnvConfig) -> Scenario:
    """Read what is named, and check that it fits together. Raises `InputError`."""
    described = config.robot if isinstance(config.robot, RobotDescription) else load_robot(config.robot)
    checkpoint = checkpoint_of(config.policy, described.joint_names)
    motion = motion_of(config.motion, checkpoint, described)
    loaded = checkpoint.with_motion(motion)
    contract = with_joint_limits(loaded.contract, described)
    description = with_contract(described, contract)
    with blaming(f"policy on robot '{description.name}'"):
        provided = {mit.VELOCITY_COMMAND: 3, **live_inputs(description, observed_by(contract))}
        extern = {name: width for name, width in loaded.extern.items() if name in provided}
        wiring = PolicyWiring(description.joint_names, contract, loaded.reference, extern)
    context = StepContext(description, contract, loaded.reference)
    task = Task(config, context)
    starts = EpisodeStarts(config, context, build_model(description, scene="floor"), task)
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
    contract = join([read_contract_file(path)], path).required_contract()
    return Checkpoint(contract, zero_policy(contract.action_count), str(path))


def motion_of(motion: Named | Motion | None, checkpoint: Checkpoint, robot: RobotDescription) -> Motion | None:
    """Return what a policy follows: a motion, or a song as far as the robot plays it; None for the checkpoint's own."""
    task_type = checkpoint.contract.task_type
    if task_type == "locomotion" and motion is not None:
        raise InputError(f"motion: is '{motion}', but {checkpoint.source} follows no motion")
    if motion is None or isinstance(motion, Motion):
        return motion
    if task_type == "piano" and not str(motion).endswith(".mcap"):
        return song_motion(load_song(str(motion), robot, what="motion"), checkpoint.contract.policy_dt, robot)
    return read_motion(motion_path(str(motion)))
