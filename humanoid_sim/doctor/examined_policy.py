"""The examined policy, with its present contract and motion, and the robot that it is to move."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from humanoid_sim.assets import motion_path
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.doctor.edits import RobotFacts
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint
from humanoid_sim.policy.golden import golden_problem, stored_samples
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.mjcf import bare_model, own_joint_damping
from humanoid_sim.simulation.model import base_body, breadth_first, build_model, joints_of
from humanoid_sim.simulation.plant import BatchActuation


@dataclass(frozen=True, slots=True, eq=False)
class ExaminedPolicy:
    """Everything that a hypothesis is tried on."""

    contract: PolicyContract
    """Present contract."""
    policy: Policy
    description: RobotDescription
    motion: Motion | None = None
    """Motion that the policy follows; None for a policy that follows none."""
    in_policy_order: bool = False
    """The motion's joints are the policy's, place by place, whatever they are called: it comes from its graph."""
    base_height: float | None = None
    """Height of the base at the start, m; None: such that the robot stands on the floor."""
    actuation: BatchActuation = "affine"
    """Plant on which the motors are simulated."""
    contradicts: Callable[[PolicyContract], bool] | None = None
    """Function that returns True if the trainer's samples in the checkpoint, which agree with the present contract, do
    not agree with another; None if there are no samples, or if they do not agree with the present one."""
    problem: str = ""
    """Difference between those samples and the present contract; empty if there is none."""

    @property
    def motion_seconds(self) -> float:
        """s, the length of the motion; 0 without one."""
        return 0.0 if self.motion is None else len(self.motion.frames) * self.contract.policy_dt

    def load(self, contract: PolicyContract) -> LoadedPolicy:
        """Return the policy and its motion under another contract.

        Raises `InputError` if the motion does not fit the contract.
        """
        return load_policy(contract, self.policy, self.motion_under(contract))

    def motion_under(self, contract: PolicyContract) -> Motion | None:
        """Return the motion as that contract would have it read; None for a policy that follows none."""
        motion = self.motion
        if motion is None:
            return None
        if self.in_policy_order:
            # The graph holds a frame per policy step, whatever the rate, and calls its joints by their places.
            motion = replace(motion, policy_dt=contract.policy_dt, joint_names=contract.joint_names)
            if contract.reference_quaternion != self.contract.reference_quaternion:
                motion = _reread_quaternions(motion, contract.reference_quaternion)
            return motion
        return _resampled(motion, contract.policy_dt)

    def base_reference(self) -> MotionReference | None:
        """Return where the robot's base should be, whatever the contract's anchor body; None if nobody knows."""
        motion, base = self.motion, self.description.base.body
        if motion is None or motion.layout != "joints_bodies_w" or base not in motion.body_names:
            return None
        return self.load(replace(self.contract, anchor_body=base)).reference


def load_examined(
    path: Path, description: RobotDescription, contract_file: Path | None = None, motion: str | None = None
) -> ExaminedPolicy:
    """Return a checkpoint on a robot, however wrong its contract: only what cannot run at all is refused.

    Raises `InputError` if the checkpoint cannot be read, its widths do not fit, or it needs a motion.

    Without a contract.yaml it is the one beside the model, if there is one; without the file or name of a motion, the
    one that the model carries.
    """
    # Golden vectors would refuse a wrong contract, and that is what the doctor is called for.
    checkpoint = load_checkpoint(path, contract_file, description.joint_names, verify=False)
    contract = checkpoint.contract
    follows = contract.task_type != "locomotion"
    if motion is not None and not follows:
        raise InputError(f"--motion: is '{motion}', but {path} follows no motion")
    given = None if motion is None else read_motion(motion_path(motion))
    if follows and given is None and checkpoint.motion is None:
        raise InputError(f"--motion: is missing; {path} is a {contract.task_type} policy and follows a motion")
    chosen = (given or checkpoint.motion) if follows else None
    load_policy(contract, checkpoint.policy, chosen, checkpoint.observation_width, source=str(path))
    problem, contradicts = _trainers_verdict(checkpoint)
    return ExaminedPolicy(
        contract, checkpoint.policy, description, chosen, given is None, contradicts=contradicts, problem=problem
    )


def _trainers_verdict(checkpoint: Checkpoint) -> tuple[str, Callable[[PolicyContract], bool] | None]:
    """See `ExaminedPolicy.problem` and `contradicts`."""
    try:
        samples = stored_samples(checkpoint)
    except InputError:  # whatever is wrong with them, the search needs none
        return "", None
    if samples is None:
        return "", None
    if problem := golden_problem(checkpoint, samples):
        return problem, None
    return "", lambda contract: bool(golden_problem(replace(checkpoint, contract=contract), samples))


def _resampled(motion: Motion, policy_dt: float) -> Motion:
    """Return the motion at another rate, each frame held until the next."""
    if math.isclose(motion.policy_dt, policy_dt, rel_tol=1e-6):
        return motion
    count = max(int(len(motion.frames) * motion.policy_dt / policy_dt), 1)
    frames = (np.arange(count) * policy_dt / motion.policy_dt + 1e-6).astype(np.intp)
    return replace(motion, frames=motion.frames[frames], policy_dt=policy_dt)


def _reread_quaternions(motion: Motion, order: str) -> Motion:
    """Return the motion whose source was read as the other order: w x y z becomes what `order` would have given."""
    if motion.layout != "joints_bodies_w":
        return motion
    start = 2 * len(motion.joint_names) + 3 * len(motion.body_names)
    frames = motion.frames.copy()
    quaternions = frames[:, start:].reshape(len(frames), -1, 4)
    frames[:, start:] = np.roll(quaternions, 1 if order == "xyzw" else -1, axis=-1).reshape(len(frames), -1)
    return replace(motion, frames=frames)


def robot_facts(description: RobotDescription, motion: Motion | None) -> RobotFacts:
    """Return what the hypotheses need. Raises `InputError` if the robot's MJCF cannot be built."""
    model = build_model(description, scene=False)
    base = base_body(model, description)
    sites = [model.site(i) for i in range(model.nsite) if description.is_floating and model.site(i).name]
    points = [site.name for site in sites if int(site.bodyid[0]) == base or "imu" in site.name.lower()]
    return RobotFacts(
        joint_names=description.joint_names,
        breadth_first=joints_of(model, breadth_first(model), description.joint_names),
        effort_limit=description.effort_limit,
        stiffness=description.stiffness,
        damping=description.damping,
        own_damping=own_joint_damping(bare_model(description), description),
        initial_position=np.array(description.initial_position),
        points=tuple(point for point in points if point != description.imu),
        motion_bodies=motion.body_names if motion is not None and motion.layout == "joints_bodies_w" else (),
    )
