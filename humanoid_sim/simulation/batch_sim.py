"""Many robots in MuJoCo at once, stepped by `mujoco.batch` on several threads."""

from __future__ import annotations

import os
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
from mujoco.batch import Batch

from humanoid_sim.errors import InputError
from humanoid_sim.mit import BoolArray, FloatArray, IndexArray, MITCommand, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.floating_base import BaseState, StartPose
from humanoid_sim.simulation.model import UNSOUND, SimConfig, base_body, build_model
from humanoid_sim.simulation.randomisation import Randomisation, RandomPushes, Variation
from humanoid_sim.simulation.sensing import Sensors
from humanoid_sim.simulation.stability import DampingStability

_VELOCITY_STAGE = int(mujoco.mjtStage.mjSTAGE_VEL)


class BatchSim:
    """N robots under the MIT law as `SimRobot` has it, to 1e-9; `step` advances all of them by one control period.

    MuJoCo's affine actuators apply the law. A command's gains hold from its own step on, however late its targets
    arrive. With `implicit`, MuJoCo integrates damping implicitly at longer steps: an approximation, made for training.
    A floating base has no support. Every robot does what it would do alone. One whose simulation is no longer finite
    has a fault: it stands still, as it was before the step, until it is reset. Not thread-safe; arrays that it gives
    are its own.
    """

    def __init__(
        self,
        description: RobotDescription,
        count: int,
        config: SimConfig | None = None,
        *,
        implicit: bool = False,
        threads: int | None = None,
        randomisation: Randomisation | None = None,
        seeds: npt.ArrayLike | None = None,
    ) -> None:
        """Build the model of N = `count` robots, whose random differences begin with `seeds`, (N,); None: 0, 1, 2, ….

        `threads` step physics, None for one per processor. Raises `InputError` where settings, MJCF or damping do not
        fit, or a fixed base is to be pushed.
        """
        config = SimConfig() if config is None else config
        self.description = description
        self.joints = description.joint_names
        self.count = count
        self.control_period = config.period(description)
        self.physics_steps = config.physics_steps(description, implicit=implicit)
        self.threads = min(threads or os.cpu_count() or 1, count)
        self.randomisation = Randomisation() if randomisation is None else randomisation
        self._is_varied = self.randomisation.differs
        self._timestep = config.timestep(description, implicit=implicit)
        self._model = model = build_model(
            description,
            physics_timestep=self._timestep,
            affine_actuators=True,
            implicit=implicit,
            scene="floor",
            sensors=config,
        )
        DampingStability(model, description).check_description()
        self._sensors = Sensors(model, description, config, count=count, threads=self.threads)
        self.extern = self._sensors.widths
        self.start_pose = StartPose(model, description)  # pose in which a robot starts
        self._base_body = base_body(model, description)
        self._random_pushes: RandomPushes | None = None
        if self.randomisation.push[1] > 0.0:
            if not description.is_floating:
                raise InputError(f"randomisation: push: '{description.name}' has a fixed base, which no push moves")
            mass = float(model.body_subtreemass[self._base_body])
            self._random_pushes = RandomPushes(self.randomisation, count, mass, self.control_period)

        n = len(self.joints)
        self._batch: Any = Batch(model, count, self.threads)
        self._gains = self._batch.expand("actuator_biasprm")[:, :, 1:3]
        self._sensordata, self._force = self._batch.bind("sensordata"), self._batch.bind("actuator_force")
        self.effort = np.zeros((count, n))  # shape (N, n), N·m, the saturated torque of the latest physics step
        self.key_force = np.zeros(count)
        """Shape (N,), N, hardest touch of any key in any physics step of the latest `step`; 0 for none."""
        self.fault: BoolArray = np.zeros(count, dtype=np.bool_)
        """Shape (N,), robots that stand still because their simulation broke."""
        self._step = np.zeros(count, dtype=np.int64)
        self._state: MITState | None = None
        self._effort_scale = np.broadcast_to(description.torque_scale, (count, n))
        self._stiffness_scale, self._damping_scale = self._effort_scale.copy(), self._effort_scale.copy()
        self._encoder_offset = np.zeros((count, n))
        self._own_delay = round(float(description.delay.mean()) / self._timestep)
        self._delay = np.full(count, self._own_delay)
        longest = self._own_delay + round(self.randomisation.delay[1] / self._timestep)
        # targets of the latest commands, the newest first: as many as can be under way, and the one in force
        self._targets = np.zeros((1 + -(-longest // self.physics_steps), count, 3, n))
        self.generators = [np.random.default_rng(0)] * count  # the random numbers of each robot
        self.variations: list[Variation] = []  # the robots of this episode; empty without a randomisation
        self.reseed(np.arange(count) if seeds is None else seeds)
        self.reset()

    @property
    def qpos(self) -> FloatArray:
        """Shape (N, nq), MuJoCo's generalised position."""
        qpos: FloatArray = self._batch.qpos
        return qpos

    @property
    def qvel(self) -> FloatArray:
        """Shape (N, nv), MuJoCo's generalised velocity."""
        qvel: FloatArray = self._batch.qvel
        return qvel

    @property
    def base(self) -> BaseState | None:
        """Pose and motion of floating bases, shape (N, …); None for fixed ones."""
        return self._sensors.base(self.qpos, self.qvel, self._sensordata)

    def model(self, i: int) -> mujoco.MjModel:
        """Return a copy of the model of robot i, with the gains in force."""
        return self._batch.get_model(i)

    def reseed(self, seeds: npt.ArrayLike, indices: npt.ArrayLike | None = None) -> None:
        """Begin the random numbers of robots `indices`, (k,) or all, anew with `seeds`, (k,), and draw them.

        They are to be reset then.
        """
        where = self._where(indices)
        for i, seed in zip(where.tolist(), np.asarray(seeds).tolist(), strict=True):
            self.generators[i] = np.random.default_rng(int(seed))
        self.redraw(where)

    def redraw(self, indices: npt.ArrayLike | None = None) -> None:
        """Draw some robots for their next episode; they are to be reset then."""
        if not self._is_varied:
            return
        where, nominal, scale = self._where(indices), self._model, self.description.torque_scale
        self.variations = self.variations or [None] * self.count  # type: ignore[list-item]  # the first draws all
        for i in where.tolist():
            variation = self.randomisation.draw(self.generators[i], nominal, len(self.joints))
            self.variations[i] = variation
            for name, values in variation.model_fields(nominal, self._sensors.joints.dof).items():
                self._batch.expand(name)[i] = values
            self._stiffness_scale[i], self._damping_scale[i] = scale * variation.stiffness, scale * variation.damping
            self._encoder_offset[i] = variation.encoder_offset
            self._delay[i] = self._own_delay + round(variation.delay / self._timestep)
        self._batch.set_const(np.sort(where))

    def reset(
        self,
        indices: npt.ArrayLike | None = None,
        *,
        qpos: FloatArray | None = None,
        qvel: FloatArray | None = None,
    ) -> None:
        """Start robots `indices`, (k,) or all, anew at time 0, as `SimRobot.reset`.

        They start at `qpos`, (k, nq), and `qvel`, (k, nv), or else at `start_pose`, at rest.
        """
        where, batch = self._where(indices), self._batch
        position = self.start_pose.qpos(where.shape) if qpos is None else qpos
        ids = np.sort(where)
        batch.reset(ids, stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        batch.qpos[where], batch.qvel[where] = position, 0.0 if qvel is None else qvel
        self._gains[where] = 0.0
        batch.forward(ids)
        self._targets[:, where] = 0.0
        self._targets[:, where, 0] = position[:, self._sensors.joints.qpos]
        self.effort[where], self.key_force[where] = 0.0, 0.0
        self._step[where], self.fault[where] = 0, False
        self._state = None

    def step(self, command: MITCommand, *, where: BoolArray | None = None) -> None:
        """Advance by one control period under a command, shape (N, n); a row that is not finite is a robot's fault.

        `where`, shape (N,), are the robots that advance; None for all. The others stand still, as do those with a
        fault.
        """
        batch = self._batch
        moving = ~self.fault if where is None else where & ~self.fault
        if not moving.any():
            return
        ids = None if moving.all() else np.flatnonzero(moving)
        rows: slice | IndexArray = slice(None) if ids is None else ids
        self._state = None
        if self._random_pushes is not None:
            seeds = [variation.push_seed for variation in self.variations]
            batch.xfrc_applied[:, self._base_body] = self._random_pushes.wrench(self._step, seeds)
        before = batch.state[rows].copy()
        self._send(command, rows)
        self._advance(ids, rows)
        warned = batch.warning[rows][:, UNSOUND, 1].any(axis=1)
        if warned.any():
            broken = np.flatnonzero(warned) if ids is None else ids[warned]
            self.fault[broken] = True
            batch.state[broken] = before[warned]
            batch.forward(broken)
        moved = moving & ~self.fault
        self.effort[moved] = self._force[moved]
        self._step += moved

    def state(self) -> MITState:
        """Return the state of the robots now, shape (N, …)."""
        if self._state is None:
            offset = self._encoder_offset if self._is_varied else None
            physics_step = (self._step * self.physics_steps).astype(np.float64)
            time = physics_step * self._timestep  # as `SimRobot` counts, to the bit
            self._state = self._sensors.state(time, self.qpos, self.qvel, self._sensordata, self.effort, offset)
        return self._state

    def body_poses(self, *, in_base: bool = False) -> tuple[FloatArray, FloatArray]:
        """Positions (N, b, 3), m, and quaternions (N, b, 4) of the bodies, in the base's frame or the world's."""
        return self._sensors.body_poses(self._sensordata, in_base=in_base)

    def close(self) -> None:
        """Stop the threads; nothing may be called then."""
        self._batch = None

    def _where(self, indices: npt.ArrayLike | None) -> IndexArray:
        return np.arange(self.count) if indices is None else np.asarray(indices, dtype=np.intp)

    def _send(self, command: MITCommand, rows: slice | IndexArray) -> None:
        """Put a command's gains in force, and its targets under way."""
        gains = self._gains
        gains[rows, :, 0] = -(command.stiffness * self._stiffness_scale)[rows]
        gains[rows, :, 1] = -(command.damping * self._damping_scale)[rows]
        position = command.position - self._encoder_offset if self._is_varied else command.position
        newest = np.stack([position, command.velocity, command.effort * self._effort_scale], axis=1)
        self._targets[1:, rows] = self._targets[:-1, rows]
        self._targets[0, rows] = newest[rows]

    def _advance(self, ids: IndexArray | None, rows: slice | IndexArray) -> None:
        """Take the physics steps of a control period, as many at a time as are under the same targets."""
        touch, batch = self._sensors.touch, self._batch
        one_by_one = bool(touch.stop) or len(self._targets) > 1
        count = 1 if one_by_one else self.physics_steps
        ctrl, everyone = batch.ctrl, np.arange(self.count)
        self.key_force[rows] = 0.0
        for step in range(0, self.physics_steps, count):
            if step == 0 or len(self._targets) > 1:
                # control periods since the command in force at this step was written
                age = np.maximum(-(-(self._delay - step) // self.physics_steps), 0)
                position, velocity, effort = np.moveaxis(self._targets[age, everyone], 1, 0)
                ctrl[:] = effort - self._gains[:, :, 0] * position - self._gains[:, :, 1] * velocity
            is_last = step + count >= self.physics_steps
            batch.step(ids, nstep=count, stage=_VELOCITY_STAGE if is_last else 0)
            if touch.stop:
                self.key_force[rows] = np.maximum(self.key_force[rows], self._sensordata[rows][:, touch].max(axis=1))
