"""The policy under examination on its robot, and a closed-loop episode of it under a contract, without support."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.assets import motion_path
from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import Policy, PolicyWiring
from humanoid_sim.controllers.rl_policy import infer
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.evaluation.step import StepContext
from humanoid_sim.evaluation.step_metrics import METRICS, describe_failure, has_run_away, rms
from humanoid_sim.mit import EXTERN_WIDTHS, FloatArray
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.robots.description import RobotDescription, with_contract, with_joint_limits
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.model import SimConfig

_SECONDS = 4.0  # s, of an episode
_WALK_AND_TURN = np.array([[0.5, 0.0, 0.5]])  # m/s, m/s, rad/s
_YAW = 2.0  # rad, heading at the start: far from 0, where world and body frames would agree
_SETTLED = 0.5  # s from the start until the velocity counts
TIMESTEP = 0.005  # s, of physics, at most: damping is integrated implicitly, so any gains are stable
_NOTICED: Mapping[str, float] = {
    "velocity": 0.2,  # m/s, of the mean
    "turning": 0.5,  # rad/s, of the mean
    "height": 0.02,  # m, standard deviation
    "shaking": 5.0,  # rad/s, root mean square of the commanded positions' change
    # of the table of step metrics, root mean square
    **{"effort": 15.0, "tilt": 0.1, "joint_error": 0.1, "hand_position_error": 0.1, "hand_orientation_error": 0.3},
    **{"anchor_position_error": 0.3, "anchor_orientation_error": 0.2},
}
"""Errors at which an onlooker begins to notice."""
_ANSWERED = 0.2  # share of a command that the mean velocity must reach


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A policy, its present contract, the motion that it follows, and the robot."""

    contract: PolicyContract
    policy: Policy
    description: RobotDescription
    motion: Motion | None = None
    in_policy_order: bool = False
    """The motion comes from the policy's graph: its joints are the policy's, place by place, a frame a policy step."""

    def load(self, contract: PolicyContract) -> LoadedPolicy:
        """Return the policy and its motion under a contract. Raises `InputError` if they do not fit."""
        return load_policy(contract, self.policy, self.motion_under(contract))

    def motion_under(self, contract: PolicyContract) -> Motion | None:
        """Return the motion as a contract would have it read; None for a policy that follows none."""
        if self.motion is None:
            return None
        motion = replace(self.motion, policy_dt=contract.policy_dt)
        if not self.in_policy_order:
            return motion
        motion = replace(motion, joint_names=contract.joint_names)
        if contract.reference_quaternion == self.contract.reference_quaternion or motion.layout != "joints_bodies_w":
            return motion
        start = 2 * len(motion.joint_names) + 3 * len(motion.body_names)
        frames = motion.frames.copy()
        shift = 1 if contract.reference_quaternion == "xyzw" else -1
        turned = np.roll(frames[:, start:].reshape(len(frames), -1, 4), shift, axis=-1)
        frames[:, start:] = turned.reshape(len(frames), -1)
        return replace(motion, frames=frames)


def load_subject(
    path: Path, description: RobotDescription, contract_file: Path | None = None, motion: str | None = None
) -> Subject:
    """Return a checkpoint on a robot, however wrong its contract; by default with the motion that it carries.

    Raises `InputError` if it cannot run at all: unreadable, widths that do not fit, no motion, a live input.
    """
    checkpoint = load_checkpoint(path, contract_file, description.joint_names, verify=False)
    contract = checkpoint.contract
    if contract.live_inputs:
        raise InputError(f"{path}: needs the live input {', '.join(contract.live_inputs)}, and doctor has none")
    if motion is not None and contract.task_type == "locomotion":
        raise InputError(f"--motion: is '{motion}', but {path} follows no motion")
    followed = checkpoint.motion if motion is None else read_motion(motion_path(motion))
    load_policy(contract, checkpoint.policy, followed, checkpoint.observation_width, source=str(path))
    return Subject(contract, checkpoint.policy, description, followed, motion is None)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of one episode."""

    time_up: float  # s until the robot was lost
    parts: Mapping[str, float] = field(default_factory=dict)  # errors by name, each about 1 where one begins to notice
    lost: str = ""
    unanswered: tuple[str, ...] = ()  # commands that it does not follow

    @property
    def cost(self) -> float:
        """Sum of the errors: smaller is better."""
        return sum(self.parts.values())


class Simulations:
    """Robots in simulation for contracts, kept and used again. Not thread-safe."""

    def __init__(self, subject: Subject) -> None:
        self._subject = subject
        self._robots: dict[tuple[RobotDescription, SimConfig, int], BatchSim] = {}

    def robots(
        self, contract: PolicyContract, count: int, bodies: tuple[str, ...] = (), timestep: float = TIMESTEP
    ) -> BatchSim:
        """Return robots in the contract's default pose, whose gains come with every command."""
        zeros = np.zeros(len(contract.joint_names))
        limp = with_contract(self._subject.description, replace(contract, joint_stiffness=zeros, joint_damping=zeros))
        config = SimConfig(
            control_period=contract.policy_dt,
            physics_timestep=contract.policy_dt / math.ceil(contract.policy_dt / timestep - 1e-6),
            anchor_body=contract.anchor_body,
            velocity_at=contract.velocity_points,
            height_scan=contract.height_scan,
            bodies=bodies,
        )
        key = limp, config, count
        if key not in self._robots:
            self._robots[key] = BatchSim(limp, count, config, implicit=True, threads=1)
        return self._robots[key]

    def run(
        self, contract: PolicyContract, commands: FloatArray = _WALK_AND_TURN, seconds: float = _SECONDS
    ) -> Outcome:
        """Run a contract once, each command (C, 3) for an equal time; one that cannot run is lost at 0 s."""
        try:
            loaded = self._subject.load(contract)
            bodies = contract.body_names if "motion_body_pos_b" in loaded.reference.terms else ()
            robot = self.robots(contract, 1, bodies)
            robot.reset(qpos=robot.start_pose.qpos((1,), np.array([_YAW])))
            contract = with_joint_limits(contract, robot.description)
            wiring = PolicyWiring(robot.joints, contract, loaded.reference, {**loaded.extern, **EXTERN_WIDTHS})
            bounds = np.array([[-np.inf, np.inf]] * 3) if contract.command_ranges is None else contract.command_ranges
            commands = np.clip(commands, bounds[:, 0], bounds[:, 1])
            loop = ClosedLoop(robot, wiring, commands[:1])
        except (FieldError, InputError) as error:
            return Outcome(0.0, lost=str(error))
        context = StepContext(robot.description, contract, loaded.reference, robot.start_pose.standing_height)
        ends = {"fallen": "floating base", "strayed": "motion with an anchor"}
        lost = [METRICS[name] for name, needs in ends.items() if needs in context.parts]
        judged = {name: METRICS[name] for name in _NOTICED if name in METRICS and METRICS[name].needs in context.parts}
        if contract.task_type != "locomotion":
            judged.pop("tilt", None)  # a motion may bend down
        rows, sample, steps = list[dict[str, Any]](), loop.sample(0), round(seconds / contract.policy_dt)
        if self._subject.motion is not None:
            steps = min(steps, loaded.reference.frame_count)
        for step in range(steps):
            inferred = infer(wiring, loaded.policy, loop.observation[0], int(np.asarray(loop.memory.frame)[0]))
            reason = inferred.message if isinstance(inferred, Fault) else ""
            if robot.fault[0] or has_run_away(loop.state.joint_velocity)[0]:
                reason = "the simulation diverged"
            elif any(end.values(context, sample)[0] for end in lost):
                reason = describe_failure(context, sample, 0)
            if reason or isinstance(inferred, Fault):
                return Outcome(step * contract.policy_dt, lost=reason)
            command = commands[step * len(commands) // steps]
            sent = loop.act(inferred.action[None], velocity=command[None])
            sample = loop.sample(step + 1)
            row = {name: metric.values(context, sample)[0] for name, metric in judged.items()}
            if sample.base is not None and contract.task_type == "locomotion":
                row |= {"velocity": sample.base.planar_velocity[0], "height": sample.base.height[0], "command": command}
            rows.append({**row, "sent": sent.position[0]})
        return _outcome(contract, {name: np.array([row[name] for row in rows]) for name in rows[0]})


def _outcome(contract: PolicyContract, rows: Mapping[str, FloatArray]) -> Outcome:
    """Return the errors, and the commands that are not followed, of an episode by its figures, (steps, ...) each."""
    found = {name: rms(values) for name, values in rows.items() if name in METRICS}
    found["shaking"] = rms(np.diff(rows["sent"], axis=0).ravel()) / contract.policy_dt
    unanswered = []
    if "velocity" in rows:
        skip = round(_SETTLED / contract.policy_dt)
        off = (rows["velocity"] - rows["command"])[skip:].mean(axis=0)
        found |= {"height": rows["height"][skip:].std(), "velocity": np.hypot(off[0], off[1]), "turning": abs(off[2])}
        for command in np.unique(rows["command"], axis=0):
            mean = rows["velocity"][(rows["command"] == command).all(axis=1)].mean(axis=0)
            for name, wanted, reached in zip(("vx", "vy", "yaw rate"), command, mean, strict=True):
                if wanted and reached / wanted < _ANSWERED:
                    unanswered.append(f"{name} {wanted:g} ({reached:.2f} reached)")
    parts = {name: float(value) / _NOTICED[name] for name, value in found.items()}
    return Outcome(len(rows["sent"]) * contract.policy_dt, parts, unanswered=tuple(unanswered))
