"""The policy under examination on its robot, and a closed-loop episode of it under a contract, without support."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.assets import motion_path
from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import Policy, PolicyWiring
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.controllers.rl_policy import infer
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.evaluation.failure import (
    describe_fall,
    describe_stray,
    has_fallen,
    has_run_away,
    has_strayed,
    length,
    quaternion_angle,
    rms,
)
from humanoid_sim.evaluation.rollout import ClosedLoop, sample_step
from humanoid_sim.evaluation.step import StepContext
from humanoid_sim.evaluation.step_metrics import METRICS
from humanoid_sim.mit import EXTERN_WIDTHS, FloatArray, MITCommand
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.robots.description import RobotDescription, with_contract, with_joint_limits
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.model import SimConfig

Command = tuple[float, float, float]
"""vx, vy in m/s and yaw rate in rad/s."""

_YAW = 2.0  # rad, heading at the start: far from 0, where world and body frames would agree
_SETTLED = 0.5  # s from a new command until the velocity counts
TIMESTEP = 0.005  # s, of physics, at most: damping is integrated implicitly, so any gains are stable
_NOTICED: Mapping[str, float] = {
    "velocity": 0.2,  # m/s, of the mean
    "turning": 0.5,  # rad/s, of the mean
    "height": 0.02,  # m, standard deviation
    "shaking": 5.0,  # rad/s, root mean square of the commanded positions' change
    # root mean squares
    **{"base_distance": 0.3, "base_angle": 0.2},  # of a base from where the motion has it
    **{"effort": 15.0, "tilt": 0.1, "joint_error": 0.1, "hand_position_error": 0.1, "hand_orientation_error": 0.3},
}
"""Errors at which an onlooker begins to notice."""
_OF_WALKING = ("effort", "tilt")
_OF_MOTIONS = ("effort", "joint_error", "hand_position_error", "hand_orientation_error")


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

    def base_reference(self, contract: PolicyContract) -> MotionReference | None:
        """Return the poses of the robot's base in the motion, as its anchor terms; None if it has none."""
        motion, base = self.motion, self.description.base.body
        if motion is None or motion.layout != "joints_bodies_w" or base not in motion.body_names:
            return None
        return self.load(replace(contract, anchor_body=base)).reference

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
    seconds: float
    parts: Mapping[str, float]  # errors by name, each about 1 where an onlooker begins to notice
    lost: str = ""

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

    def run(self, contract: PolicyContract, seconds: float, commands: Sequence[Command]) -> Outcome:
        """Run a contract once, each command for an equal share of the time; one that cannot run is lost at 0 s."""
        try:
            loaded = self._subject.load(contract)
            bodies = contract.body_names if "motion_body_pos_b" in loaded.reference.terms else ()
            robot = self.robots(contract, 1, bodies)
            robot.reset(base_yaw=np.array([_YAW]))
            contract = with_joint_limits(contract, robot.description)
            wiring = PolicyWiring(robot.joints, contract, loaded.reference, {**loaded.extern, **EXTERN_WIDTHS})
            loop = ClosedLoop(robot, wiring, np.array(commands[:1]))
            score = _Score(loop, robot, loaded, self._subject.base_reference(contract))
        except (FieldError, InputError) as error:
            return Outcome(0.0, seconds, {}, str(error))
        steps = round(seconds / contract.policy_dt)
        for step in range(steps):
            command = commands[step * len(commands) // steps]
            lost = score.loss()
            inferred = infer(wiring, loaded.policy, loop.observation[0], score.frame)
            if isinstance(inferred, Fault) or lost:
                message = inferred.message if isinstance(inferred, Fault) and not lost else lost
                return Outcome(step * contract.policy_dt, seconds, score.errors(), message)
            is_settled = step * contract.policy_dt % (seconds / len(commands)) >= _SETTLED
            sent = loop.act(inferred.action[None], velocity=np.array([command]))
            score.add(step + 1, sent, command if is_settled else (np.nan,) * 3)
        return Outcome(seconds, seconds, score.errors())


class _Score:
    """Errors of one episode: the robot in the world, whatever the contract says."""

    def __init__(self, loop: ClosedLoop, robot: BatchSim, loaded: LoadedPolicy, base: MotionReference | None) -> None:
        """Begin; `base` has the base's poses in the motion, if it does."""
        self._loop, self._robot, self._motion, self._contract = loop, robot, base, loaded.contract
        self._alignment = None if base is None else base.align(self._pose())
        self._context = StepContext(robot.description, loaded.contract, loaded.reference)
        names = _OF_WALKING if loaded.contract.task_type == "locomotion" else _OF_MOTIONS
        self._metrics = [name for name in names if self._context.has(METRICS[name].needs)]
        self._rows: list[dict[str, Any]] = []

    def _pose(self) -> FloatArray:
        """Return the base's pose now, shape (1, 7), m and w x y z, world frame."""
        base = self._robot.base
        assert base is not None
        return np.hstack([base.position, base.quaternion])

    @property
    def frame(self) -> int:
        return int(np.asarray(self._loop.memory.frame)[0])

    def loss(self) -> str:
        """Return how the robot was lost by now; or ''."""
        base = self._robot.base
        if self._robot.fault[0] or has_run_away(self._loop.state.joint_velocity)[0]:
            return "the simulation diverged"
        if self._motion is not None:
            poses = self._pose(), *self._motion.anchor(self.frame, self._alignment)
            return describe_stray(*(part[0] for part in poses)) if has_strayed(*poses)[0] else ""
        standing = self._robot.start_pose.standing_height
        return describe_fall(base, standing, 0) if base is not None and has_fallen(base, standing)[0] else ""

    def add(self, step: int, sent: MITCommand, command: Sequence[float]) -> None:
        """Add a policy step, and the velocity command; NaN: not settled yet."""
        sample = sample_step(self._loop, self._robot, step)
        row: dict[str, Any] = {"sent": sent.position[0], "command": command}
        row |= {name: METRICS[name].values(self._context, sample)[0] for name in self._metrics}
        if sample.base is not None:
            row |= {"velocity": sample.base.planar_velocity[0], "height": sample.base.height[0]}
        if self._motion is not None:
            pose, (position, quaternion) = self._pose(), self._motion.anchor(self.frame, self._alignment)
            row["base_distance"] = length(position - pose[:, :3])[0]
            row["base_angle"] = quaternion_angle(pose[:, 3:], quaternion)[0]
        self._rows.append(row)

    def errors(self) -> dict[str, float]:
        """Return the errors, each about 1 where an onlooker begins to notice."""
        if len(self._rows) < 2:
            return {}
        rows = {name: np.array([row[name] for row in self._rows]) for name in self._rows[0]}
        found: dict[str, Any] = {
            name: rms(rows[name]) for name in (*self._metrics, "base_distance", "base_angle") if name in rows
        }
        found["shaking"] = rms(np.diff(rows["sent"], axis=0).ravel()) / self._contract.policy_dt
        settled = np.isfinite(rows["command"][:, 0])
        if self._contract.task_type == "locomotion" and "velocity" in rows and settled.any():
            commands = np.unique(rows["command"][settled], axis=0)
            off = [rows["velocity"][(rows["command"] == each).all(axis=1)].mean(axis=0) - each for each in commands]
            found["height"] = rows["height"][settled].std()
            found["velocity"] = np.mean([np.hypot(x, y) for x, y, _ in off])
            found["turning"] = np.mean([abs(turning) for _, _, turning in off])
        return {name: float(value) / _NOTICED[name] for name, value in found.items()}
