"""Starts of episodes: around the default pose, or at a frame of the motion, by random numbers that a caller draws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.rotation import multiply, rotate
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.step import StepContext
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.simulation.floating_base import StartPose, base_addresses
from humanoid_sim.simulation.model import joint_addresses
from humanoid_sim.simulation.stance import clearance


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """Where episodes begin, and the commands in them."""

    qpos: FloatArray
    """Shape (..., nq), MuJoCo's generalised position: joints within their limits, a floating base on its feet."""
    qvel: FloatArray
    """Shape (..., nv)."""
    commands: FloatArray
    """Shape (..., k, 3), the velocity commands one after the other."""
    frame: npt.NDArray[np.integer]
    """Shape (...), of the reference, to be shown first."""


class EpisodeStarts:
    """Starts for one robot or many. Not thread-safe."""

    def __init__(
        self,
        context: StepContext,
        model: mujoco.MjModel,
        *,
        noise: tuple[float, float],
        reference_start: float,
        commands: Callable[[FloatArray], FloatArray],
        command_draws: int,
    ) -> None:
        """Prepare for a robot.

        Raises `InputError` if episodes are to begin in a motion that has no joints.

        Args:
            model: from `build_model`.
            noise: rad and rad/s by which joints may start off their pose, and off its velocity.
            reference_start: share of the episodes that begin at a random frame of the motion.
            commands: makes velocity commands of `command_draws` random numbers, as a task does.
        """
        description, self._reference = context.description, context.reference
        self._context, self._noise, self._commands = context, noise, commands
        self._joints = joint_addresses(model, description.joint_names)
        self._pose = StartPose(model, description)
        self.standing_height = self._pose.standing_height
        """m, of the centre of mass above the floor; 0 for a fixed base."""
        self._base = base_addresses(model, description) if description.is_floating else None
        self._lengths = np.array(self._reference.lengths or (self._reference.frame_count,))
        self._share = reference_start
        self._states = motion_states(context, model) if reference_start else None
        self._turns = context.contract.align_reference
        n = description.joint_count
        self._splits = np.cumsum([n, n, 1, command_draws, int(len(self._lengths) > 1)]).tolist()
        self.draws = self._splits[-1] + 2 * (reference_start > 0.0)
        """Random numbers that a start takes."""

    def __call__(self, numbers: FloatArray) -> Start:
        """Return the start that uniform random numbers in [0, 1), shape (..., draws), stand for."""
        position, velocity, turn, commands, motion, inside = np.split(numbers, self._splits, axis=-1)
        c, batch = self._context, numbers.shape[:-1]
        chosen = np.zeros(batch, dtype=np.intp)
        if motion.size:
            chosen = np.asarray(motion[..., 0] * len(self._lengths)).astype(np.intp)
        frame = (np.cumsum(self._lengths) - self._lengths)[chosen]
        yaw = np.pi * (2.0 * turn[..., 0] - 1.0) if self._base is not None else np.zeros(batch)
        qpos, qvel = self._pose.arrays(batch, joint_position=c.default_pose, base_yaw=yaw)
        if self._states is not None:
            is_inside = inside[..., 0] < self._share
            # not the last frame, after which the episode would be over
            further = (inside[..., 1] * np.maximum(self._lengths[chosen] - 1, 1)).astype(np.intp)
            frame = np.where(is_inside, frame + further, frame)
            there = self._at_frames(frame, yaw if self._turns else np.zeros(batch), qpos, qvel)
            qpos, qvel = (np.where(is_inside[..., None], a, b) for a, b in zip(there, (qpos, qvel), strict=True))
        off, speed = self._noise
        joints, dof = self._joints.qpos, self._joints.dof
        qpos[..., joints] = np.clip(qpos[..., joints] + off * (2.0 * position - 1.0), c.lower, c.upper)
        qvel[..., dof] += speed * (2.0 * velocity - 1.0)
        return Start(qpos, qvel, self._commands(commands), frame)

    def _at_frames(
        self, frame: npt.NDArray[np.integer], yaw: FloatArray, qpos: FloatArray, qvel: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the motion's states at frames (...), turned about the vertical by `yaw`, (...), rad.

        The base of `qpos` and `qvel` stays where the motion does not tell it.
        """
        assert self._states is not None
        at, moving = self._states[0][frame], self._states[1][frame]
        if self._base is None:
            return at, moving
        place, orientation, linear, angular = self._base
        if "anchor_pos" not in self._reference.terms:
            at[..., place], at[..., orientation] = qpos[..., place], qpos[..., orientation]
            moving[..., linear], moving[..., angular] = qvel[..., linear], qvel[..., angular]
            return at, moving
        none = np.zeros_like(yaw)
        turn = np.stack([np.cos(0.5 * yaw), none, none, np.sin(0.5 * yaw)], axis=-1)
        at[..., place] = rotate(turn, at[..., place])
        at[..., orientation] = multiply(turn, at[..., orientation])
        moving[..., linear] = rotate(turn, moving[..., linear])
        return at, moving


def motion_states(context: StepContext, model: mujoco.MjModel) -> tuple[FloatArray, FloatArray]:
    """Return qpos (F, nq) and qvel (F, nv) of a robot that follows its motion exactly, frame by frame.

    Where the motion has the robot below its floor, the base is lifted onto it. Raises `InputError` if the motion has no
    joints, or other bodies move before the floating base.
    """
    description, reference = context.description, context.reference
    if "reference_joint_pos" not in reference.terms or context.joint_target is None:
        raise InputError("reference_start: is > 0, but the policy follows no motion with joints")
    addresses = joint_addresses(model, description.joint_names)
    qpos = np.tile(model.qpos0, (reference.frame_count, 1))
    qpos[:, addresses.qpos] = np.clip(context.joint_target, description.lower, description.upper)
    ghost = ReferenceGhost.of(description, context.contract, reference)
    if description.is_floating and "anchor_pos" in reference.terms and ghost is not None:
        place, orientation, _, _ = base_addresses(model, description)
        if place.start:
            raise InputError(f"reference_start: base '{description.base.body}' is not the first body that moves")
        for frame, row in enumerate(qpos):
            posed = ghost.pose(model, row, frame)
            row[place], row[orientation] = posed[place], posed[orientation]
            row[place][2] += description.simulation.floor_height
            row[place][2] += max(0.0, -clearance(model, row))
    qvel = np.zeros((len(qpos), model.nv))
    for frame, row in enumerate(qvel):
        before, after = max(frame - 1, int(reference.first(frame))), min(frame + 1, int(reference.last(frame)))
        if after > before:
            seconds = (after - before) * context.contract.policy_dt
            mujoco.mj_differentiatePos(model, row, seconds, qpos[before], qpos[after])
    return qpos, qvel
