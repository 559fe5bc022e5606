"""What a run of `train` trains: contract, robot, motion and task, and the environments for them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from humanoid_sim.assets import PIANO_POLICY, SAMPLE_MOTION, SAMPLE_POLICY, sample_policy
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.scenario import Scenario, make_scenario, read_policy
from humanoid_sim.envs.tasks import TASKS
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.errors import InputError, known_names
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch import Randomisation
from humanoid_sim.strict_yaml import read_yaml
from humanoid_sim.training.ppo.learner import ALGORITHMS
from humanoid_sim.training.ppo.options import TrainConfig

__all__ = ["Subject", "subject_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """Everything that the options say about what is trained, read and checked."""

    scenario: Scenario
    contract: PolicyContract
    """As it was read, before the robot's own limits went into it."""
    task: str
    """Of `TASKS`."""
    source: str
    """Name or path of the contract."""
    motion: str | None
    """Name or path."""
    robot: str
    randomisation: Randomisation
    privileged: tuple[str, ...]
    actuation: Any
    physics_timestep: float | None

    def environments(self, robots: int) -> PolicyVectorEnv:
        """So many robots, for either library."""
        return PolicyVectorEnv(
            robots,
            **self._options,
            randomisation=self.randomisation,
            privileged=self.privileged,
            autoreset_mode="SameStep",
        )

    def environment(self) -> PolicyEnv:
        """One robot that is as its model says, to be looked at."""
        return PolicyEnv(**self._options)

    @property
    def _options(self) -> dict[str, Any]:
        return {
            "contract": self.source,
            "robot": self.robot,
            "motion": self.motion,
            "task": self.task,
            "actuation": self.actuation,
            "physics_timestep": self.physics_timestep,
        }


def subject_of(config: TrainConfig) -> Subject:
    """Read and check what the options name.

    Raises:
        InputError: one line with the option, its value and what is accepted.
    """
    _known("--algorithm", "algorithm", config.algorithm, ALGORITHMS)
    _known("--task", "task", config.task, ("auto", *TASKS))
    if config.task == "piano" or (config.contract is None and sample_policy(config.robot) == PIANO_POLICY):
        raise InputError(
            "--task: is piano, whose songs this command does not read; LitePiano-v0 trains with a library of your own"
        )
    if config.privileged and config.algorithm == "ppo-sb3":
        raise InputError("--privileged: stable-baselines3's critic sees what the policy sees; give ppo-rsl_rl")
    description = load_robot(config.robot)
    source, motion = config.contract or sample_policy(config.robot).stem, config.motion
    if motion is None and source == SAMPLE_POLICY.stem:
        motion = SAMPLE_MOTION
    loaded = read_policy(source, motion, description.joint_names)
    if motion is None and loaded.contract.task_type != "locomotion":
        raise InputError(f"--motion: is missing; {source} carries its motion itself, which a new policy will not")
    values = None if config.randomisation is None else read_yaml(Path(config.randomisation))
    try:
        randomisation = Randomisation.of(values)
    except InputError as error:
        raise InputError(f"{config.randomisation}: {error}") from None
    scenario = make_scenario(
        source,
        description,
        motion,
        task=config.task,
        actuation=config.actuation,
        physics_timestep=config.physics_timestep,
    )
    task = next(name for name, kind in TASKS.items() if type(scenario.task) is kind)
    return Subject(
        scenario=scenario,
        contract=loaded.contract,
        task=task,
        source=source,
        motion=motion,
        robot=config.robot,
        randomisation=randomisation,
        privileged=config.privileged,
        actuation=config.actuation,
        physics_timestep=config.physics_timestep,
    )


def _known(option: str, what: str, name: str, known: Iterable[str]) -> None:
    """Refuse a name that is not known, and suggest the nearest."""
    names = tuple(known)
    if name not in names:
        raise InputError(f"{option}: {known_names(what, name, names)}")
