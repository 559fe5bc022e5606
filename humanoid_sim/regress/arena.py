"""What one policy needs to run one case: its motion, the task that judges it, and how long it takes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from humanoid_sim.assets import motion_path
from humanoid_sim.controllers.parameters import joint_indices
from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.envs.setting import Setting, make_setting
from humanoid_sim.envs.tasks.task import Task
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import Motion, body_poses, read_motion
from humanoid_sim.regress.subject import Subject
from humanoid_sim.regress.suite import Case, Suite
from humanoid_sim.training.inverse_kinematics import InverseKinematics

__all__ = ["Arena", "case_motion", "make_arena"]

_IK_DAMPING = 1e-3
"""m/rad: the poses of a motion can be reached, and the joints are to be exact."""


@dataclass(frozen=True, slots=True, eq=False)
class Arena:
    """A subject and a case, found to fit."""

    subject: Subject
    case: Case
    motion: Motion | None
    setting: Setting
    steps: int
    """Policy steps of a whole episode."""
    joint_reference: FloatArray | None
    """Shape (F, n), rad, robot's order: where the motion has the joints, frame by frame as far as an episode comes;
    None without a motion."""

    @property
    def task(self) -> Task:
        """What judges the steps."""
        return self.setting.task

    @property
    def reference(self) -> MotionReference:
        """The motion, cut into terms."""
        return self.setting.wiring.reference

    @property
    def policy_dt(self) -> float:
        """Time between two policy steps, s."""
        return self.setting.contract.policy_dt


def make_arena(suite: Suite, subject: Subject, case: Case, motion: Motion | None) -> Arena:
    """Bring a subject and a case together.

    Args:
        suite: of the case.
        subject: the policy and its robot.
        case: what is to be done.
        motion: that the case names; None for the one in the policy, or for a task without.

    Raises:
        InputError: one line that names the checkpoint and what does not fit.
    """
    checkpoint = subject.checkpoint
    if suite.task == "tracking" and motion is None:
        motion = checkpoint.motion
        if motion is None:
            raise InputError(f"{checkpoint.source}: carries no motion, and case '{case.name}' of the suite names none")
    try:
        # The widths of model and terms; what the setting makes of the contract has no model.
        load_policy(
            checkpoint.contract,
            checkpoint.policy,
            motion,
            checkpoint.observation_width,
            source=checkpoint.source,
            motion_source=f"case '{case.name}': {case.motion or 'the motion in the policy'}",
        )
        setting = make_setting(
            checkpoint.contract,
            subject.description,
            motion,
            task="velocity" if suite.task == "velocity" else "auto",
            physics_timestep=suite.physics_timestep,
            action_limit=suite.action_limit,
            joint_noise=suite.start.joint_position,
            velocity_noise=suite.start.joint_velocity,
        )
    except InputError as error:
        text = str(error)
        raise InputError(text if checkpoint.source in text else f"{checkpoint.source}: {text}") from None
    steps = _steps(setting, case)
    joints = None if motion is None else _joint_reference(setting, motion, steps + 1)
    return Arena(subject, case, motion, setting, steps, joints)


def case_motion(folder: Path, case: Case) -> Motion | None:
    """The motion that a case names; None if it names none.

    Raises:
        InputError: it cannot be read.
    """
    if not case.motion:
        return None
    beside = folder / case.motion
    try:
        return read_motion(beside if beside.is_file() else motion_path(case.motion))
    except InputError as error:
        raise InputError(f"case '{case.name}': {str(error).removeprefix('--motion: ')}") from None


def _steps(setting: Setting, case: Case) -> int:
    if case.duration is not None:
        return max(round(case.duration / setting.contract.policy_dt), 1)
    return max(setting.wiring.reference.frame_count - 1, 1)


def _joint_reference(setting: Setting, motion: Motion, count: int) -> FloatArray | None:
    """The motion's joints in its first `count` frames; of one that has bodies only, those that bring them there."""
    description, contract, terms = setting.description, setting.contract, setting.wiring.reference.terms
    if "reference_joint_pos" in terms:
        order = joint_indices(description.joint_names, contract.joint_names, "joints of the robot")
        return terms["reference_joint_pos"][:count, order].astype(np.float64)
    if "motion_body_pos_b" not in terms:
        return None
    position, rotation = body_poses(motion.frames[:count], len(contract.body_names))
    solver = InverseKinematics(description, contract.body_names, damping=_IK_DAMPING)
    return solver.solve_path(position, rotation, np.array(description.initial_position))
