"""Where an episode begins: in a task's own start, in the middle of a motion, on a piece of ground."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.reference import MotionReference
from humanoid_sim.envs.curriculum import Amounts
from humanoid_sim.envs.reference_states import ReferenceStates
from humanoid_sim.envs.tasks import Task
from humanoid_sim.envs.tasks.task import Start
from humanoid_sim.mit import FloatArray
from humanoid_sim.simulation.terrain import Terrain

__all__ = ["EpisodeStarts"]


@dataclass(frozen=True, slots=True, eq=False)
class EpisodeStarts:
    """Functions of random numbers that a caller hands in, for one robot or many."""

    task: Task
    reference: MotionReference
    """One motion or several, of which each episode has one."""
    terrain: Terrain | None = None
    """What the robot walks on; None for a level floor."""
    reference_start: float = 0.0
    """Share of the episodes that begin at a random frame of the motion, in the motion's own state."""
    states: ReferenceStates | None = None
    """Of all frames, where some episodes begin there."""
    turns: bool = False
    """Whether a motion in the world may have any heading: its policy lays it onto the robot."""

    @property
    def draws(self) -> int:
        """Random numbers that a start takes."""
        of_ground = 0 if self.terrain is None else self.terrain.draws
        return self.task.draws + self._motion_draws + of_ground

    @property
    def _motion_draws(self) -> int:
        return (len(self.reference.lengths) > 1) + 2 * (self.reference_start > 0.0)

    def __call__(self, numbers: FloatArray, amounts: Amounts) -> Start:
        """The start that uniform random numbers in [0, 1), shape (..., draws), stand for.

        `amounts` are of the commands and of the ground that a curriculum allows.
        """
        own, moving = self.task.draws, self.task.draws + self._motion_draws
        start = self._in_motion(numbers[..., :own], numbers[..., own:moving])
        start = replace(start, commands=amounts.commands * start.commands)
        if self.terrain is None:
            return start
        return replace(start, base_offset=self.terrain.spawn(numbers[..., moving:], amounts.terrain))

    def _in_motion(self, numbers: FloatArray, of_motion: FloatArray) -> Start:
        """The task's own start, or one in the state of the reference."""
        if not self._motion_draws:
            return self.task.start(numbers)
        lengths = np.array(self.reference.lengths or (self.reference.frame_count,))
        chosen = np.zeros(numbers.shape[:-1], dtype=np.intp)
        if len(lengths) > 1:
            chosen = np.asarray(np.floor(of_motion[..., 0] * len(lengths)).astype(np.intp))
        frame: npt.NDArray[np.intp] = (np.cumsum(lengths) - lengths)[chosen]
        if self.states is None or not self.reference_start:
            return replace(self.task.start(numbers), frame=frame)
        is_inside = of_motion[..., -2] < self.reference_start
        # not the last frame, after which the episode would be over
        inside = np.floor(of_motion[..., -1] * np.maximum(lengths[chosen] - 1, 1)).astype(np.intp)
        frame = np.where(is_inside, frame + inside, frame)
        around = (self.states.joint_position[frame], self.states.joint_velocity[frame], is_inside)
        start = replace(self.task.start(numbers, around), frame=frame)
        base = self.states.base_at(frame, start.base_yaw if self.turns else np.zeros_like(start.base_yaw))
        if base is None:
            return start
        pose, velocity = base
        return replace(start, base_pose=np.where(is_inside[..., None], pose, np.nan), base_velocity=velocity)
