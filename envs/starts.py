"""Starts of episodes: around the default pose, by random numbers that a caller draws."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np

from humanoid_sim.envs.tasks import Task
from humanoid_sim.evaluation.step import StepContext
from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.floating_base import StartPose
from humanoid_sim.simulation.model import joint_addresses

if TYPE_CHECKING:
    from humanoid_sim.envs.config import PolicyEnvConfig


class Start(NamedTuple):
    """Where episodes begin, and the commands in them."""

    qpos: FloatArray  # shape (..., nq): joints within their limits, a floating base on its feet
    qvel: FloatArray  # shape (..., nv)
    commands: FloatArray  # shape (..., k, 3), the velocity commands one after the other


class EpisodeStarts:
    """Starts for one robot or many."""

    def __init__(self, config: PolicyEnvConfig, context: StepContext, model: mujoco.MjModel, task: Task) -> None:
        self._config, self._context, self._task = config, context, task
        self._joints, self._nv = joint_addresses(model, context.description.joint_names), model.nv
        self._pose = StartPose(model, context.description)
        self.standing_height = self._pose.standing_height
        """m, of the centre of mass above the floor; 0 for a fixed base."""
        n = context.description.joint_count
        self._splits = [n, 2 * n, 2 * n + 1]
        self.draws = 2 * n + 1 + task.command_draws  # random numbers that a start takes

    def __call__(self, numbers: FloatArray) -> Start:
        """Return the start that uniform random numbers in [0, 1), shape (..., draws), stand for."""
        position, velocity, turn, commands = np.split(numbers, self._splits, axis=-1)
        robot, joints, dof = self._context.description, self._joints.qpos, self._joints.dof
        yaw = np.pi * (2.0 * turn[..., 0] - 1.0)
        qpos, qvel = self._pose.qpos(numbers.shape[:-1], yaw), np.zeros((*numbers.shape[:-1], self._nv))
        off = self._config.joint_noise * (2.0 * position - 1.0)
        qpos[..., joints] = np.clip(np.array(robot.initial_position) + off, robot.lower, robot.upper)
        qvel[..., dof] = self._config.velocity_noise * (2.0 * velocity - 1.0)
        return Start(qpos, qvel, self._task.commands(commands))
