"""The policy under examination on its robot, and its closed-loop episode under a contract, without support."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.envs.config import PolicyEnvConfig, Scenario, build_scenario, motion_of
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.graph_motion import sweep_motion
from humanoid_sim.policy.onnx_policy import OnnxPolicy
from humanoid_sim.regress.episodes import run_episodes
from humanoid_sim.regress.preparation import PreparedCase
from humanoid_sim.regress.results import Episode
from humanoid_sim.regress.suite import Case, Suite, TaskName
from humanoid_sim.robots.description import RobotDescription, with_contract

_WALK_AND_TURN = (0.5, 0.0, 0.5)  # m/s, m/s, rad/s
_SETTLE = 0.5  # s from the start until the velocity counts
_TIMESTEP = 0.005  # s, of physics, at most: damping is integrated implicitly, so any gains are stable
_NOTICED: Mapping[str, float] = {
    **{"velocity_error": 0.2, "yaw_rate_error": 0.5, "tilt": 0.1, "effort": 15.0, "action_rate": 5.0},
    **{"joint_error": 0.1, "body_position_error": 0.3, "body_orientation_error": 0.2, "wrong keys": 0.2},
}
"""Metrics of `regress` that are errors, and 1 less F1, and from where on an onlooker notices them, in their unit."""


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A policy with its present contract and the motion that it follows, and the robot."""

    checkpoint: Checkpoint
    description: RobotDescription
    is_motion_given: bool = False  # not in the policy's graph

    @property
    def contract(self) -> PolicyContract:
        return self.checkpoint.contract

    def under(self, contract: PolicyContract) -> Subject:
        """Return the same with another contract, under which a motion has a frame a policy step."""
        motion, policy = self.checkpoint.motion, self.checkpoint.policy
        if motion is not None:
            names = motion.joint_names if self.is_motion_given else contract.joint_names  # a graph's have no names
            motion = replace(motion, policy_dt=contract.policy_dt, joint_names=names)
            reads_otherwise = contract.reference_quaternion != self.contract.reference_quaternion
            if reads_otherwise and not self.is_motion_given and isinstance(policy, OnnxPolicy):
                motion = sweep_motion(policy, contract)
        return replace(self, checkpoint=replace(self.checkpoint, contract=contract, motion=motion))

    def scenario(self, timestep: float = _TIMESTEP) -> Scenario:
        """Return the environment of an episode that starts in the default pose, in physics steps of s at most.

        Raises `InputError` if the contract does not fit.
        """
        policy_dt, zeros = self.contract.policy_dt, np.zeros(len(self.contract.joint_names))
        config = PolicyEnvConfig(
            policy=self.checkpoint,
            robot=self.description,
            joint_noise=0.0,
            velocity_noise=0.0,
            physics_timestep=policy_dt / math.ceil(policy_dt / timestep - 1e-6),
            implicit=True,
        )
        limp = replace(self.contract, joint_stiffness=zeros, joint_damping=zeros)  # the gains come with every command
        return replace(build_scenario(config), description=with_contract(self.description, limp))


def load_subject(
    path: Path, description: RobotDescription, contract_file: Path | None = None, motion: str | None = None
) -> Subject:
    """Return a checkpoint on a robot, however wrong its contract; by default with the motion that it carries.

    Raises `InputError` if it cannot run at all: unreadable, widths that do not fit, no motion, a live input.
    """
    checkpoint = load_checkpoint(path, contract_file, description.joint_names, verify=False)
    if checkpoint.contract.live_inputs:
        raise InputError(f"{path}: needs the live input {', '.join(checkpoint.contract.live_inputs)}; doctor has none")
    given = motion_of(motion, checkpoint, description)
    checkpoint = replace(checkpoint, motion=given or checkpoint.motion)
    checkpoint.with_motion()
    return Subject(checkpoint, description, given is not None)


def run_episode(subject: Subject, seconds: float) -> Episode:
    """Run a policy that walks and turns, or follows its motion; one that cannot run at all has failed after 0 s."""
    contract = subject.contract
    case = Case(name="doctor")
    task: TaskName = "piano" if contract.task_type == "piano" else "tracking"
    if contract.task_type == "locomotion" and subject.description.is_floating:
        bounds = np.array([[-np.inf, np.inf]] * 3) if contract.command_ranges is None else contract.command_ranges
        vx, vy, yaw_rate = np.clip(_WALK_AND_TURN, bounds[:, 0], bounds[:, 1]).tolist()
        case, task = Case(name="doctor", command=(vx, vy, yaw_rate)), "velocity"
    suite = Suite(name="doctor", task=task, cases=(case,), seeds=1, tolerances={}, settle=_SETTLE, implicit=True)
    steps = round(seconds / contract.policy_dt)
    try:
        scenario = subject.scenario()
        if subject.checkpoint.motion is not None:
            steps = min(steps, scenario.wiring.reference.frame_count - 1)
        (episode,) = run_episodes(PreparedCase(suite, case, subject.checkpoint, scenario, steps), [0], threads=1)
    except (FieldError, InputError) as error:
        return Episode(case="doctor", seed=0, steps=0, duration=0.0, failure=str(error), kind="fault", metrics={})
    return episode


def episode_errors(episode: Episode) -> dict[str, float]:
    """Return the errors of an episode by metric, the largest first, each about 1 where one begins to notice it."""
    known, played = dict(episode.metrics), episode.metrics.get("f1")
    if played is not None:
        known["wrong keys"] = 1.0 - played
    errors = {name: value / _NOTICED[name] for name, value in known.items() if value and name in _NOTICED}
    return dict(sorted(errors.items(), key=lambda item: -item[1]))
