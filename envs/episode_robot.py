"""The robot of an environment of one: put anywhere, also where a recorded run began, it tells what it truly does."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import seen_from
from humanoid_sim.envs.tasks.task import Start
from humanoid_sim.errors import InputError
from humanoid_sim.mit import COMMAND_FIELDS, BoolArray, Extern, FloatArray, MITCommand, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.batch import BatchSimulation
from humanoid_sim.simulation.floating_base import BaseState, StartPose
from humanoid_sim.simulation.model import base_body
from humanoid_sim.simulation.mujoco_robot import MujocoRobot

_KEPT = ("_pending", "_joint_line", "_body_line", "_step", "_fault", "is_closed", "_is_lifted")
"""Attributes of a `MujocoRobot` beside its plant: commands and samples under way, its clock, what went wrong."""


@dataclass(frozen=True, slots=True, eq=False)
class PlantState:
    """All that the next physics step depends on, beside the command and the support."""

    qpos: FloatArray
    """Shape (nq,), MuJoCo's generalised position."""
    qvel: FloatArray
    """Shape (nv,), generalised velocity."""
    acceleration: FloatArray | None = None
    """Shape (nv,), of the physics step before, as the solver found it and begins with it again. None: zeros."""
    effort: FloatArray | None = None
    """Shape (n,), N·m, of the physics step before, which only reports show. None: zeros."""
    felt: FloatArray | None = None
    """Shape (nv,), of the physics step before, as the IMU feels it: `MujocoRobot.acceleration`. None: as the solver
    found it."""

    @classmethod
    def of(cls, robot: MujocoRobot) -> PlantState:
        """Return a copy of a simulated robot's."""
        data, (state, _) = robot.data, robot.read()
        return cls(
            data.qpos.copy(),
            data.qvel.copy(),
            data.qacc_warmstart.copy(),
            state.joint_effort,
            robot.acceleration.copy(),
        )

    def require(self, data: mujoco.MjData) -> None:
        """Refuse the state of another robot than that of `data`. Raises `InputError` if it is one."""
        given, expected = (self.qpos.shape, self.qvel.shape), (data.qpos.shape, data.qvel.shape)
        if given != expected:
            (qpos, qvel), (nq, nv) = given, expected
            raise InputError(f"state: qpos and qvel have the shapes {qpos} and {qvel}, expected {nq} and {nv}")


class EpisodeRobot(MujocoRobot):
    """A `MujocoRobot` that starts anew with every episode: to the last bit as in an episode before, or anywhere else.

    It also has what `BatchSimulation` has of many robots, with arrays of shape (…) without N.
    """

    def __init__(self, description: RobotDescription, *, bodies: tuple[str, ...] = (), **options: Any) -> None:
        """Build the model. Raises `InputError` as of `MujocoRobot`.

        Args:
            bodies: MJCF bodies that `body_poses` gives; they must be the model's.
            options: as `MujocoRobot` takes them.
        """
        super().__init__(description, **options)
        self._is_punctual = options.get("state_delay", 0.0) == 0.0 and options.get("state_sampling", "now") == "now"
        self._own = mujoco.MjData(self.model)
        self._bodies = [self.model.body(name).id for name in bodies]
        self._base_body = base_body(self.model, description)
        mujoco.mj_kinematics(self.model, self._own)
        unturned = np.array([1.0, 0.0, 0.0, 0.0])
        still = bool((self._own.xquat[self._base_body] == unturned).all())
        self._is_only_shifted = still and not description.is_floating

    def relaunch(self) -> None:
        """As `activate`, in a new process: the clock is at 0."""
        self._step = 0
        self.activate()

    @cached_property
    def _start_pose(self) -> StartPose:
        return StartPose(self.model, self.description, self._plant.addresses)

    def started(self, start: Start) -> PlantState:
        """Return where a task's start says, on its feet or on its stand."""
        return PlantState(*self._start_pose.arrays(**start.pose))

    def place(self, start: PlantState) -> None:
        """As `relaunch`, but in a state of the caller's choice. Raises `InputError` if the state is another robot's."""
        self.relaunch()
        data = self.data
        start.require(data)
        data.qpos[:], data.qvel[:] = start.qpos, start.qvel
        if start.acceleration is not None:
            data.qacc[:] = data.qacc_warmstart[:] = start.acceleration
            self.acceleration[:] = start.acceleration if start.felt is None else start.felt
        position, velocity, effort = self._joint_sample()
        self._joint_line.restart(self._step, (position, velocity, effort if start.effort is None else start.effort))
        self._body_line.restart(self._step, self._body_sample())

    def snapshot(self) -> dict[str, Any]:
        """Give a copy of all that later steps and reports depend on, for `restore` of a robot that was built alike."""
        kept = {name: copy.deepcopy(getattr(self, name)) for name in _KEPT}
        return kept | {"_plant": self._plant.snapshot()}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over a snapshot."""
        self._plant.restore(snapshot["_plant"])
        for name in _KEPT:
            setattr(self, name, snapshot[name])
        self._state = None

    def step(self, command: MITCommand, *, wrench: FloatArray | None = None, where: BoolArray | None = None) -> None:
        """As `write`; nothing pushes it, and it does not stand still."""
        self.write(command)

    def state(self) -> MITState:
        """Return what is seen now, late as it may be."""
        return self.read()[0]

    def truth(self) -> MITState:
        """Return what would be seen if neither delays nor sampling stood between."""
        if self._is_punctual:
            return self.state()
        return self._seen(self._joint_sample(), 0.0, self._body_sample(), self.time)

    @property
    def effort(self) -> FloatArray:
        """Shape (n,), N·m, of the latest physics step, saturated; a view that the next step changes."""
        return self._plant.effort

    @property
    def base(self) -> BaseState | None:
        """See `MujocoRobot.base_state`."""
        return self.base_state

    @property
    def fault(self) -> str:
        """Return what is wrong with the simulation, which then stands still; empty while it is sound."""
        return self._fault

    def body_poses(self, *, in_base: bool = False) -> tuple[FloatArray, FloatArray]:
        """Shape (b, 3), m, and (b, 4), w x y z, of the bodies, in the world's frame or in that of the base."""
        if not self._bodies:
            return np.empty((0, 3)), np.empty((0, 4))
        own, base = self._own, self._base_body
        own.qpos[:] = self.data.qpos
        mujoco.mj_kinematics(self.model, own)  # poses in `data` are one physics step older
        position, quaternion = own.xpos[self._bodies], own.xquat[self._bodies]
        if not in_base:
            return position, quaternion
        if self._is_only_shifted:
            return position - own.xpos[base], quaternion
        return seen_from(own.xpos[base], own.xquat[base], position, quaternion)


class RandomisedRobot:
    """As `EpisodeRobot`, with the differences that are drawn for its episodes: the only robot of a batch.

    There is one text of what a randomisation does to a robot, that of `BatchSimulation`, so a robot alone is to the
    last bit what it would be among others.
    """

    def __init__(self, description: RobotDescription, **options: Any) -> None:
        """Build a batch of one; options as `BatchSimulation` takes them.

        Raises `InputError` as of `BatchSimulation`.
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

    def draw(self, seed: int | None) -> None:
        """Make it the robot of the first episode of a seed, a whole number in [0, 2⁶⁴), or of the next one for None.

        It is to be placed then.
        """
        if seed is None:
            self.batch.redraw()
        else:
            self.batch.reseed(seed)

    def started(self, start: Start) -> PlantState:
        """See `EpisodeRobot.started`."""
        return PlantState(*self.batch.start_pose.arrays(**start.pose))

    def place(self, start: PlantState) -> None:
        """See `EpisodeRobot.place`; the first command finds motors that hold this pose.

        Raises `InputError` if the state is another robot's.
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
