"""Starts of episodes: around the default pose, by random numbers that a caller draws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.evaluation.step import StepContext
from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.floating_base import StartPose
from humanoid_sim.simulation.model import joint_addresses


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
        noise: tuple[float, float],
        commands: Callable[[FloatArray], FloatArray],
        command_draws: int,
    ) -> None:
        """Prepare for a robot; joints may start off their default pose and rest by `noise`, rad and rad/s.

        `commands` makes velocity commands of `command_draws` random numbers, as a task does.
        """
        self._context, self._noise, self._commands = context, noise, commands
        self._joints = joint_addresses(model, context.description.joint_names)
        self._pose = StartPose(model, context.description)
        self.standing_height = self._pose.standing_height
        """m, of the centre of mass above the floor; 0 for a fixed base."""
        self._lengths = np.array(context.reference.lengths or (context.reference.frame_count,))
        n = context.description.joint_count
        self._splits = np.cumsum([n, n, 1, command_draws]).tolist()
        self.draws = self._splits[-1] + int(len(self._lengths) > 1)
        """Random numbers that a start takes."""

    def __call__(self, numbers: FloatArray) -> Start:
        """Return the start that uniform random numbers in [0, 1), shape (..., draws), stand for."""
        position, velocity, turn, commands, motion = np.split(numbers, self._splits, axis=-1)
        c, batch = self._context, numbers.shape[:-1]
        chosen = np.zeros(batch, dtype=np.intp)
        if motion.size:
            chosen = np.asarray(motion[..., 0] * len(self._lengths)).astype(np.intp)
        frame = (np.cumsum(self._lengths) - self._lengths)[chosen]
        yaw = np.pi * (2.0 * turn[..., 0] - 1.0)
        qpos, qvel = self._pose.arrays(batch, joint_position=c.default_pose, base_yaw=yaw)
        off, speed = self._noise
        joints, dof = self._joints.qpos, self._joints.dof
        qpos[..., joints] = np.clip(qpos[..., joints] + off * (2.0 * position - 1.0), c.lower, c.upper)
        qvel[..., dof] += speed * (2.0 * velocity - 1.0)
        return Start(qpos, qvel, self._commands(commands), frame)
