"""The policy under examination on its robot, and a closed-loop episode of it under a contract, without support."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np

from humanoid_sim.assets import motion_path
from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.policy_step import Policy, PolicyWiring
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.controllers.rl_policy import infer
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.evaluation.errors import pose_error
from humanoid_sim.evaluation.failure import describe_fall, describe_stray, has_fallen, has_run_away, has_strayed
from humanoid_sim.evaluation.rollout import ClosedLoop
from humanoid_sim.evaluation.run_figures import MotionErrors
from humanoid_sim.mit import EXTERN_WIDTHS, FloatArray, MITState
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.robots.description import RobotDescription, with_contract, with_joint_limits
from humanoid_sim.robots.rates import steps_per_period
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.model import SimConfig, build_model
from humanoid_sim.simulation.stability import DampingStability

Command = tuple[float, float, float]
"""vx, vy in m/s and yaw rate in rad/s."""
Plant = tuple[bool, float]
"""Implicit damping, and the physics step, s."""

_YAW = 2.0  # rad, heading at the start: far from 0, where world and body frames would agree
_SETTLED = 0.5  # s from a new command until the velocity counts
_EXPLICIT, _IMPLICIT = False, True
_PLANTS: tuple[Plant, ...] = (
    *((_EXPLICIT, 0.005), (_EXPLICIT, 0.0025), (_EXPLICIT, 0.002), (_IMPLICIT, 0.0025), (_IMPLICIT, 0.002)),
    *((_EXPLICIT, 0.001), (_EXPLICIT, 0.0005)),
)
"""Fastest first: where damping is stable the longest step gives the figures of the shortest."""
_STABLE = 1.5  # see simulation.stability
_NOTICED: Mapping[str, float] = {
    "velocity": 0.2,  # m/s, of the mean
    "turning": 0.5,  # rad/s, of the mean
    "tilt": 0.1,  # rad, root mean square
    "height": 0.02,  # m, standard deviation
    "joints": 0.1,  # rad, mean
    "position": 0.3,  # m, mean
    "angle": 0.2,  # rad, mean
    "hand position": 0.1,  # m, root mean square
    "hand angle": 0.3,  # rad, root mean square
    "shaking": 5.0,  # rad/s, root mean square of the commanded positions' change
    "torque": 15.0,  # N·m, root mean square
}
"""Errors at which an onlooker begins to notice."""
_SQUARED = ("shaking", "torque", "tilt")  # of these the squares are kept


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A policy, its present contract, the motion that it follows, and the robot."""

    contract: PolicyContract
    policy: Policy
    description: RobotDescription
    motion: Motion | None = None
    in_policy_order: bool = False
    """The motion comes from the policy's graph: its joints are the policy's, place by place, a frame a policy step."""

    @property
    def motion_seconds(self) -> float:
        """s, length of the motion; 0 without one."""
        return 0.0 if self.motion is None else len(self.motion.frames) * self.contract.policy_dt

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
    """Return a checkpoint on a robot, however wrong its contract.

    Raises `InputError` if it cannot run at all: unreadable, widths that do not fit, no motion, a live input.

    Args:
        contract_file: a contract.yaml; None: the one beside the model, if there is one.
        motion: name or file; None: the motion that the model carries.
    """
    checkpoint = load_checkpoint(path, contract_file, description.joint_names, verify=False)
    contract = checkpoint.contract
    for name, width in contract.live_inputs.items():
        raise InputError(f"{path}: needs the live input '{name}' of width {width}, and doctor has none")
    if motion is not None and contract.task_type == "locomotion":
        raise InputError(f"--motion: is '{motion}', but {path} follows no motion")
    followed = checkpoint.motion if motion is None else read_motion(motion_path(motion))
    load_policy(contract, checkpoint.policy, followed, checkpoint.observation_width, source=str(path))
    return Subject(contract, checkpoint.policy, description, followed, motion is None)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Outcome of one episode."""

    time_up: float
    """s until the robot was lost."""
    seconds: float
    """s, length of the episode."""
    parts: Mapping[str, float]
    """Errors by name, each about 1 where an onlooker begins to notice."""
    lost: str = ""
    """Way in which the robot was lost; empty if it stayed up."""

    @property
    def cost(self) -> float:
        """Sum of the errors: smaller is better."""
        return sum(self.parts.values())


class Simulations:
    """Robots in simulation for contracts, kept and used again. Not thread-safe."""

    def __init__(self, subject: Subject) -> None:
        self._subject = subject
        self._robots: dict[tuple[object, ...], BatchSim] = {}
        self._stability: dict[Plant, DampingStability] = {}

    def run(self, contract: PolicyContract, seconds: float, commands: Sequence[Command]) -> Outcome:
        """Run a contract once; one that cannot run is lost at 0 s. The same contract gives the same outcome.

        Args:
            seconds: length of the episode.
            commands: velocity commands, for equal shares of the time.
        """
        try:
            loaded, robot = self._subject.load(contract), self.robots(contract, 1)
            robot.reset(base_yaw=np.array([_YAW]))
            contract = with_joint_limits(contract, robot.description)
            wiring = PolicyWiring(robot.joints, contract, loaded.reference, {**loaded.extern, **EXTERN_WIDTHS})
            loop = ClosedLoop(robot, wiring, np.array(commands[:1]))
        except (FieldError, InputError) as error:
            return Outcome(0.0, seconds, {}, str(error))
        score, period = _Score(loaded, robot, self._subject.base_reference(contract)), contract.policy_dt
        steps = round(seconds / period)
        for step in range(steps):
            command, frame = commands[step * len(commands) // steps], int(np.asarray(loop.memory.frame)[0])
            lost = score.compare(frame, loop)
            if robot.fault[0] or has_run_away(loop.state.joint_velocity)[0]:
                lost = "the joints run away"
            inferred = infer(wiring, loaded.policy, loop.observation[0], frame)
            if isinstance(inferred, Fault):
                lost = lost or inferred.message
            if lost or isinstance(inferred, Fault):
                return Outcome(step * period, seconds, score.parts(period), lost)
            sent = loop.act(inferred.action[None], velocity=np.array([command]))
            is_settled = step * period % (seconds / len(commands)) >= _SETTLED
            score.add(sent.position[0], command if is_settled else None)
        return Outcome(seconds, seconds, score.parts(period))

    def robots(self, contract: PolicyContract, count: int) -> BatchSim:
        """Return robots in the contract's default pose, on the fastest plant that is stable with its gains."""
        plant = is_implicit, timestep = self._plant(contract)
        order, limits = np.argsort(contract.joint_names), contract.effort_limit
        key = (
            *(count, plant, contract.policy_dt, contract.anchor_body, contract.velocity_points),
            contract.default_joint_pos[order].tobytes(),
            None if limits is None else limits[order].tobytes(),
        )
        if key not in self._robots:
            config = SimConfig(
                control_period=contract.policy_dt,
                physics_timestep=timestep,
                anchor_body=contract.anchor_body,
                velocity_at=contract.velocity_points,
                height_scan=contract.height_scan,
            )
            self._robots[key] = BatchSim(self._limp(contract), count, config, implicit=is_implicit, threads=1)
        return self._robots[key]

    def _plant(self, contract: PolicyContract) -> Plant:
        own = [contract.joint_names.index(name) for name in self._subject.description.joint_names]
        for plant in _PLANTS:
            is_implicit, timestep = plant
            try:
                steps_per_period(contract.policy_dt, timestep)
            except InputError:
                continue
            if plant not in self._stability:
                limp = self._limp(contract)
                model = build_model(
                    limp, physics_timestep=timestep, affine_actuators=True, implicit=is_implicit, scene=False
                )
                self._stability[plant] = DampingStability(model, limp)
            if self._stability[plant].suits(contract.joint_damping[own], contract.joint_stiffness[own], _STABLE):
                return plant
        raise InputError("its damping is unstable in simulation")

    def _limp(self, contract: PolicyContract) -> RobotDescription:
        """Return the robot in the contract's default pose, without gains: they come with every command."""
        zeros = np.zeros(len(contract.joint_names))
        return with_contract(self._subject.description, replace(contract, joint_stiffness=zeros, joint_damping=zeros))


class _Score:
    """Errors of one episode: the robot in the world, whatever the contract says."""

    def __init__(self, loaded: LoadedPolicy, robot: BatchSim, base: MotionReference | None) -> None:
        contract, terms = loaded.contract, loaded.reference.terms
        self._robot = robot
        self._walks = contract.task_type == "locomotion"
        self._targets = loaded.reference if "reference_joint_pos" in terms else None
        self._order = joint_indices(contract.joint_names, robot.joints, "joint_names of the policy")
        self._bodies = MotionErrors(robot.description, loaded) if "motion_body_pos_b" in terms else None
        self._base, self._alignment = base, None if robot.base is None or base is None else base.align(_pose(robot))
        self._values: dict[str, list[float]] = {}
        self._velocities: dict[Command, list[FloatArray]] = {}
        self._sent: FloatArray | None = None

    def _add(self, name: str, value: object) -> None:
        self._values.setdefault(name, []).append(float(np.asarray(value)))

    def compare(self, frame: int, loop: ClosedLoop) -> str:
        """Compare the state with the reference's frame; return how the robot was lost, or ''."""
        base, position = self._robot.base, loop.state.joint_position[0]
        if self._bodies is not None:
            self._bodies.update(frame, _first(loop.state))
        if self._targets is not None:
            target = self._targets.term("reference_joint_pos", frame)
            self._add("joints", np.abs(position[self._order] - target).mean())
        if base is None:
            return ""
        if self._base is not None:
            error = pose_error(_pose(self._robot), *self._base.anchor(frame, self._alignment))
            self._add("position", error.distance)
            self._add("angle", error.angle)
            return describe_stray(error) if has_strayed(error) else ""
        standing = self._robot.start_pose.standing_height
        return describe_fall(base, standing, 0) if has_fallen(base, standing)[0] else ""

    def add(self, sent: FloatArray, command: Command | None) -> None:
        """Take in a policy step: the positions (n,) sent, and the command; None: not settled yet."""
        base = self._robot.base
        if self._sent is not None:
            self._add("shaking", ((sent - self._sent) ** 2).mean())
        self._sent = sent
        self._add("torque", (self._robot.effort[0] ** 2).mean())
        if self._walks and base is not None:
            self._add("tilt", base.tilt[0] ** 2)
            if command is not None:
                self._velocities.setdefault(command, []).append(np.array(base.planar_velocity[0]))
                self._add("height", base.height[0])

    def parts(self, period: float) -> dict[str, float]:
        """Return the errors, each about 1 where an onlooker begins to notice."""
        errors = {name: float(np.mean(values)) for name, values in self._values.items()}
        errors |= {name: math.sqrt(errors[name]) for name in _SQUARED if name in errors}
        if "shaking" in errors:
            errors["shaking"] /= period
        if "height" in errors:
            errors["height"] = float(np.std(self._values["height"]))
        if self._velocities:
            off = np.array([np.mean(each, axis=0) - command for command, each in self._velocities.items()])
            errors["velocity"] = float(np.hypot(off[:, 0], off[:, 1]).mean())
            errors["turning"] = float(np.abs(off[:, 2]).mean())
        summary = None if self._bodies is None else self._bodies.summary()
        if summary is not None:
            for name, error in (("hand position", "hands position"), ("hand angle", "hands orientation")):
                errors[name] = summary["errors"][error]["rms"]
        return {name: value / _NOTICED[name] for name, value in errors.items()}


def _pose(robot: BatchSim) -> FloatArray:
    """Return the base's pose, shape (7,), m and w x y z, world frame."""
    assert robot.base is not None
    return np.concatenate([robot.base.position[0], robot.base.quaternion[0]])


def _first(state: MITState) -> MITState:
    """Return the state of a batch's first robot, without its live inputs."""
    return MITState(
        **{field.name: getattr(state, field.name)[0] for field in fields(MITState) if field.name != "extern"}
    )
