"""What a run of `train` trains: contract, robot, motion and task, and the environments for them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.privileged import Privileged
from humanoid_sim.envs.scenario import Scenario, checkpoint_of, make_scenario
from humanoid_sim.envs.tasks import TASKS
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.errors import InputError, known_names
from humanoid_sim.robots.description import load_robot
from humanoid_sim.training.ppo.environment import ONLY_TRAINED, arguments_of, as_options
from humanoid_sim.training.ppo.learner import ALGORITHMS
from humanoid_sim.training.ppo.options import TrainConfig


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """Everything that the options say about what is trained, read and checked."""

    scenario: Scenario
    contract: PolicyContract
    """As it was read, before the robot's own limits went into it."""
    task: str
    """Of `TASKS`, or the name of a class of the user's own."""
    arguments: Mapping[str, Any]
    """Of the environments, by keyword."""
    told: Mapping[str, Any]
    """What the arguments came to, as plain values, which a run that is resumed must have again."""

    @property
    def robot(self) -> str:
        """Name or path."""
        return str(self.arguments["robot"])

    def environments(self, robots: int) -> PolicyVectorEnv:
        """So many robots, for either library."""
        return PolicyVectorEnv(robots, **self.arguments, autoreset_mode="SameStep")

    def environment(self) -> PolicyEnv:
        """One robot that is as its model says, to be looked at from an episode's beginning."""
        return PolicyEnv(**_without(self.arguments, *ONLY_TRAINED, "reference_start"))


def _without(arguments: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {name: value for name, value in arguments.items() if name not in names}


def subject_of(config: TrainConfig) -> Subject:
    """Read and check what the options name.

    Raises:
        InputError: one line with the option, its value and what is accepted.
    """
    if config.algorithm not in ALGORITHMS:
        raise InputError(f"--algorithm: {known_names('algorithm', config.algorithm, ALGORITHMS)}")
    if config.privileged and config.algorithm == "ppo-sb3":
        raise InputError("--privileged: stable-baselines3's critic sees what the policy sees; give ppo-rsl_rl")
    read = arguments_of(config)
    arguments = {name: argument.value for name, argument in read.items()}
    description = load_robot(config.robot)
    source = arguments["contract"]
    checkpoint = checkpoint_of(source, description.joint_names)
    if arguments["motion"] is None and checkpoint.contract.task_type != "locomotion":
        raise InputError(f"--motion: is missing; {source} carries its motion itself, which a new policy will not")
    try:
        scenario = make_scenario(**_without(arguments, *ONLY_TRAINED) | {"contract": checkpoint, "robot": description})
        if config.privileged:
            Privileged(config.privileged, is_floating=description.is_floating)
    except InputError as error:
        raise as_options(error) from None
    task = next((name for name, kind in TASKS.items() if type(scenario.task) is kind), type(scenario.task).__name__)
    told = {name: argument.told for name, argument in read.items()}
    return Subject(scenario, checkpoint.contract, task, arguments, told | {"task": told["task"] or task})
