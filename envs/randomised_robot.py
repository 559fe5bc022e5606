"""One robot out of a batch of one: what a vector environment simulates, for an environment that has no others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.envs.episode_robot import PlantState
from humanoid_sim.envs.tasks.task import Start
from humanoid_sim.mit import COMMAND_FIELDS, Extern, FloatArray, MITCommand, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.batch import BatchSimulation
from humanoid_sim.simulation.floating_base import BaseState

BoolArray = npt.NDArray[np.bool_]


class RandomisedRobot:
    """Robot of an environment, as `EpisodeRobot` is, with the differences that are drawn for its episodes.

    There is one text of what a randomisation does to a robot, that of `BatchSimulation`, so a robot alone is to the
    last bit what it would be among others.
    """

    def __init__(self, description: RobotDescription, **options: Any) -> None:
        """Build a batch of one; options as `BatchSimulation` takes them.

        Raises:
            InputError: as of `BatchSimulation`.
        """
        self.batch = BatchSimulation(description, 1, threads=1, **options)
        """The simulation."""
        self.description = description
        self.joints, self.control_period = self.batch.joints, self.batch.control_period
        self.physics_steps = self.batch.physics_steps
        self.data = mujoco.MjData(self.batch.model(0))
        """Present pose and motion, for pictures: nothing is simulated in it."""
        self._show()

    @property
    def model(self) -> mujoco.MjModel:
        """The robot as it is in this episode."""
        return self.batch.model(0)

    @property
    def is_closed(self) -> bool:
        """Return whether `close` was called."""
        return self.batch.is_closed

    @property
    def qpos(self) -> FloatArray:
        """Shape (nq,), MuJoCo's generalised position; a read-only view."""
        qpos: FloatArray = self.batch.qpos[0]
        return qpos

    @property
    def effort(self) -> FloatArray:
        """See `EpisodeRobot.effort`."""
        effort: FloatArray = self.batch.effort[0]
        return effort

    @property
    def base(self) -> BaseState | None:
        """See `BatchSimulation.base`."""
        base = self.batch.base
        if base is None:
            return None
        values = {field.name: getattr(base, field.name)[0] for field in fields(base) if field.name != "up"}
        return BaseState(**values, up=base.up)

    @property
    def fault(self) -> str:
        """See `EpisodeRobot.fault`."""
        return "simulation unstable" if self.batch.fault[0] else ""

    def draw(self, seed: int | None, amounts: Mapping[str, float]) -> None:
        """Make it the robot of the first episode of a seed, a whole number in [0, 2⁶⁴), or of the next one for None.

        Amounts are as `BatchSimulation.redraw` takes them; it is to be placed then.
        """
        if seed is None:
            self.batch.redraw(amounts=amounts)
        else:
            self.batch.reseed(seed, amounts=amounts)

    def started(self, start: Start) -> PlantState:
        """See `EpisodeRobot.started`."""
        return PlantState(*self.batch.start_pose.arrays(**start.pose))

    def place(self, start: PlantState) -> None:
        """See `EpisodeRobot.place`; the first command finds motors that hold this pose.

        Raises:
            InputError: the state is another robot's.
        """
        start.require(self.data)
        self.batch.reset(qpos=start.qpos[None], qvel=start.qvel[None])
        self._show()

    def step(self, command: MITCommand, *, wrench: FloatArray | None = None, where: BoolArray | None = None) -> None:
        """See `Robots.step`."""
        row = MITCommand(*(getattr(command, name)[None] for name in COMMAND_FIELDS))
        self.batch.step(row, wrench=None if wrench is None else wrench[None])
        self._show()

    def state(self) -> MITState:
        """Return what is reported now: late, biased and noisy as the randomisation says."""
        return _alone(self.batch.state())

    def truth(self) -> MITState:
        """See `BatchSimulation.truth`."""
        return _alone(self.batch.truth())

    def body_poses(self, *, in_base: bool = False) -> tuple[FloatArray, FloatArray]:
        """See `EpisodeRobot.body_poses`."""
        position, quaternion = self.batch.body_poses(in_base=in_base)
        return position[0], quaternion[0]

    def snapshot(self) -> dict[str, Any]:
        """See `EpisodeRobot.snapshot`."""
        return self.batch.snapshot()

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over a snapshot."""
        self.batch.restore(snapshot)
        self._show()

    def close(self) -> None:
        """Refuse further commands. May be called twice."""
        self.batch.close()

    def _show(self) -> None:
        self.data.qpos[:], self.data.qvel[:] = self.batch.qpos[0], self.batch.qvel[0]


def _alone(state: MITState) -> MITState:
    """Return the only row of a batch of one."""
    rows = {field.name: np.asarray(getattr(state, field.name))[0] for field in fields(state) if field.name != "extern"}
    live = {name: Extern(value.value[0], value.arrival_time) for name, value in state.extern.items()}
    return MITState(**rows | {"time": float(rows["time"])}, extern=live)
