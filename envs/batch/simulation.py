"""Many robots in MuJoCo at once: `mujoco.rollout` on several threads, and NumPy on whole batches around it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TypeVar

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.rotation import conjugate, multiply, rotate_inverse
from humanoid_sim.envs.batch.body_tree import BodyPose, BodyTree, body_ids
from humanoid_sim.envs.batch.counter_random import seed_keys
from humanoid_sim.envs.batch.models import ModelPool
from humanoid_sim.envs.batch.motors import BatchMotors
from humanoid_sim.envs.batch.physics import BatchPhysics
from humanoid_sim.envs.batch.randomisation import Randomisation, vary_model
from humanoid_sim.envs.batch.sensors import BatchSensors
from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITCommand, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.rates import steps_per_period
from humanoid_sim.simulation.delay import delay_steps
from humanoid_sim.simulation.floating_base import FloatingBase
from humanoid_sim.simulation.model import base_body, build_model, joint_addresses

__all__ = ["BatchSimulation"]

BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
IndexArray = npt.NDArray[np.intp]
Scalar = TypeVar("Scalar", bound=np.generic)


class BatchSimulation:
    """N robots under the MIT law; `step` advances all of them by one control period in native threads.

    The plant is `humanoid_sim.simulation.plant.AffinePlant`; a floating base has no support. Every environment gives
    what it would give alone, whatever the others do. A simulation that is no longer finite is a fault of that
    environment: it stands still, as it was before the step, until it is reset. Not thread-safe.
    """

    def __init__(
        self,
        description: RobotDescription,
        count: int,
        *,
        control_period: float | None = None,
        physics_timestep: float | None = None,
        threads: int | None = None,
        anchor_body: str = "",
        bodies: Sequence[str] = (),
        push_body: str = "",
        randomisation: Randomisation | None = None,
        seeds: npt.ArrayLike | None = None,
    ) -> None:
        """Build the model once, and copies of it where environments differ.

        Args:
            description: the robot.
            count: N.
            control_period: s, by which one `step` advances; None for the description's.
            physics_timestep: s, must divide the control period; None for the description's.
            threads: that step physics; None for one per processor that this process may use.
            anchor_body: MJCF body whose pose the state reports as `anchor_pose`; empty for none.
            bodies: MJCF bodies that `body_poses` gives.
            push_body: MJCF body that the wrenches of `step` act on; empty for the base.
            randomisation: how the environments differ; None: not at all.
            seeds: shape (N,), whole numbers, of the differences and the noise; None: 0, 1, 2, ….

        Raises:
            InputError: an option is not accepted, or the MJCF does not fit the description.
        """
        _check_count("count", count)
        if threads is not None:
            _check_count("threads", threads)
        settings = description.simulation
        timestep = settings.physics_timestep if physics_timestep is None else physics_timestep
        self.description = description
        self.count = count
        self.control_period = 1.0 / settings.control_frequency if control_period is None else control_period
        """s"""
        self.physics_steps = steps_per_period(self.control_period, timestep)
        """Physics steps in one control period."""
        self.randomisation = Randomisation() if randomisation is None else randomisation

        model = build_model(description, physics_timestep=timestep, affine_actuators=True)
        self._timestep = timestep
        self._joints = joint_addresses(model, description.joint_names)
        self._sensors = BatchSensors(model, description, self._joints, self.randomisation, anchor_body)
        self._base = base_body(model, description)
        self._bodies = BodyTree(model, [*body_ids(model, bodies), self._base])
        push = body_ids(model, [push_body])[0] if push_body else self._base
        self._wrench = slice(model.nu + 6 * push, model.nu + 6 * push + 6)
        self._pushed: FloatArray | None = None
        self._start, self._base_quaternion = _start(model, description, self._joints.qpos)
        self._pool = ModelPool(model, count)
        available = len(os.sched_getaffinity(0)) if threads is None else threads
        self._physics = BatchPhysics(self._pool, count, self.physics_steps, min(available, count))
        self._effort = np.zeros((count, len(self._joints.dof)))
        self._step = np.zeros(count, dtype=np.int64)
        self._fault = np.zeros(count, dtype=np.bool_)
        self._report: MITState | None = None
        self._poses: dict[int, BodyPose] | None = None
        self.reseed(np.arange(count) if seeds is None else seeds)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the n joints, in the order of all per-joint arrays."""
        return self.description.joint_names

    @property
    def extern(self) -> Mapping[str, int]:
        """Names and widths of the live inputs that the state carries, as the policy's controller wants them."""
        return self._sensors.widths

    @property
    def qpos(self) -> FloatArray:
        """Shape (N, nq), MuJoCo's generalised position; a read-only view."""
        return _read_only(self._physics.qpos)

    @property
    def qvel(self) -> FloatArray:
        """Shape (N, nv), MuJoCo's generalised velocity; a read-only view."""
        return _read_only(self._physics.qvel)

    @property
    def effort(self) -> FloatArray:
        """Shape (N, n), N·m, the saturated torque of the latest physics step; a read-only view."""
        return _read_only(self._effort)

    @property
    def steps(self) -> IntArray:
        """Shape (N,), control periods since each environment was reset; a read-only view."""
        return _read_only(self._step)

    @property
    def fault(self) -> BoolArray:
        """Shape (N,), environments that stand still because they broke; a read-only view."""
        return _read_only(self._fault)

    def model(self, i: int) -> mujoco.MjModel:
        """The model of environment i, which others may share."""
        return self._pool[i]

    def reseed(self, seeds: npt.ArrayLike) -> None:
        """Draw the environments' differences anew, and put all of them back to where they began.

        Args:
            seeds: shape (N,) or scalar, whole numbers in [0, 2⁶⁴).
        """
        self._keys = seed_keys(np.broadcast_to(np.asarray(seeds, dtype=np.uint64), (self.count,)))
        drawn, n = self.randomisation, len(self._joints.dof)
        if drawn.varies_models:
            self._pool.separate()
            for i in range(self.count):
                vary_model(self._pool[i], self._pool.nominal, drawn, self._keys[:, i : i + 1], self._joints.dof)
        delay = np.rint(drawn.draw("command_delay", self._keys, 1)[:, 0] / self._timestep).astype(np.int64)
        self._motors = BatchMotors(
            self._pool,
            np.array(self.description.effort_limit),
            self.physics_steps,
            delay=delay,
            jitter=delay_steps("randomisation: command_jitter", drawn.command_jitter, self._timestep),
            keys=self._keys,
            stiffness_factor=drawn.draw("stiffness", self._keys, n),
            damping_factor=drawn.draw("damping", self._keys, n),
        )
        self.reset()

    def reset(
        self,
        indices: npt.ArrayLike | None = None,
        *,
        joint_position: FloatArray | None = None,
        joint_velocity: FloatArray | None = None,
        base_yaw: FloatArray | None = None,
        qpos: FloatArray | None = None,
        qvel: FloatArray | None = None,
    ) -> None:
        """Start some environments anew, at time 0, without a fault or a memory of what was.

        Until their first command arrives, the motors hold the position that the joints start in.

        Args:
            indices: shape (k,), which; None for all.
            joint_position: shape (k, n), rad; None for the description's initial position.
            joint_velocity: shape (k, n), rad/s; None for rest.
            base_yaw: shape (k,), rad, about the vertical, by which a floating base is turned at its start.
            qpos: shape (k, nq), MuJoCo's generalised position, instead of `joint_position` and `base_yaw`.
            qvel: shape (k, nv), MuJoCo's generalised velocity, instead of `joint_velocity`.
        """
        where = np.arange(self.count) if indices is None else np.asarray(indices, dtype=np.intp)
        count, nominal = len(where), self._pool.nominal
        position = np.empty((count, nominal.nq))
        position[:] = self._start if qpos is None else qpos
        if qpos is None and joint_position is not None:
            position[:, self._joints.qpos] = joint_position
        if qpos is None and base_yaw is not None and self._base_quaternion is not None:
            half, none = 0.5 * np.asarray(base_yaw), np.zeros(count)
            turn = np.stack([np.cos(half), none, none, np.sin(half)], axis=-1)
            position[:, self._base_quaternion] = multiply(turn, self._start[self._base_quaternion])
        velocity = np.zeros((count, nominal.nv))
        if qvel is not None:
            velocity[:] = qvel
        elif joint_velocity is not None:
            velocity[:, self._joints.dof] = joint_velocity
        self._physics.set(where, position, velocity)
        self._motors.hold(where, position[:, self._joints.qpos])
        self._effort[where] = 0.0
        self._step[where] = 0
        self._fault[where] = False
        self._report = self._poses = None

    def step(self, command: MITCommand, *, wrench: FloatArray | None = None, where: BoolArray | None = None) -> None:
        """Advance by one control period.

        Args:
            command: shape (N, n). A row that is not finite is a fault of its environment.
            wrench: shape (N, 6), N and N·m, force and torque on the push body at its centre of mass, world frame, for
                the whole period; None for none.
            where: shape (N,), the environments that advance; None for all. The others stand still, as do those with a
                fault.

        Raises:
            RobotError: the command has another shape, or the simulation is closed.
        """
        name = self.description.name
        if self._physics.is_closed:
            raise RobotError(f"{name}: the batch simulation is closed")
        if command.position.shape != self._effort.shape:
            raise RobotError(f"{name}: command has shape {command.position.shape}, expected {self._effort.shape}")
        moving = np.ones(self.count, dtype=np.bool_) if where is None else where
        if not command.is_finite():
            sound = np.all([np.isfinite(getattr(command, field)).all(axis=1) for field in COMMAND_FIELDS], axis=0)
            self._fault |= moving & ~sound
            command = MITCommand(*(np.where(sound[:, None], getattr(command, f), 0.0) for f in COMMAND_FIELDS))
        moving = moving & ~self._fault
        chosen = None if moving.all() else np.flatnonzero(moving)
        control = self._motors.send(command, self._step, chosen)
        if wrench is not None:
            control = self._with_wrench(control, wrench)
        broken = self._physics.advance(control, chosen)
        self._fault[np.flatnonzero(broken) if chosen is None else chosen[broken]] = True
        moved = moving & ~self._fault
        torque = self._motors.torque(
            self._physics.previous_qpos[:, self._joints.qpos], self._physics.previous_qvel[:, self._joints.dof]
        )
        self._effort = np.where(moved[:, None], torque, self._effort)
        self._step = self._step + moved
        self._report = self._poses = None

    def _with_wrench(self, control: FloatArray, wrench: FloatArray) -> FloatArray:
        """Controls followed by the wrenches on all bodies, as MuJoCo orders them."""
        if self._pushed is None:
            nominal = self._pool.nominal
            self._pushed = np.zeros((self.count, self.physics_steps, nominal.nu + 6 * nominal.nbody))
        self._pushed[:, :, : control.shape[2]] = control
        self._pushed[:, :, self._wrench] = wrench[:, None]
        return self._pushed

    def state(self) -> MITState:
        """What the robots report now, shape (N, …), noise included."""
        if self._report is None:
            physics = self._physics
            self._report = self._sensors.read(
                physics.time, physics.qpos, physics.qvel, physics.acceleration, self._effort, self._keys, self._step
            )
        return self._report

    def body_poses(self, *, in_base: bool = False) -> tuple[FloatArray, FloatArray]:
        """Where the bodies truly are.

        Args:
            in_base: in the frame of the robot's base instead of the world's.

        Returns:
            Positions (N, b, 3), m, and quaternions (N, b, 4), w x y z; new arrays.
        """
        if self._poses is None:
            self._poses = self._bodies.poses(self._physics.qpos)
        *bodies, base = self._bodies.bodies
        position = np.empty((self.count, len(bodies), 3))
        quaternion = np.empty((self.count, len(bodies), 4))
        for b, body in enumerate(bodies):
            position[:, b] = self._poses[body].position.T
            quaternion[:, b] = self._poses[body].quaternion.T
        if not in_base:
            return position, quaternion
        origin, axes = self._poses[base].position.T[:, None], self._poses[base].quaternion.T[:, None]
        return rotate_inverse(axes, position - origin), multiply(conjugate(axes), quaternion)

    def close(self) -> None:
        """Stop the threads. May be called twice."""
        self._physics.close()


def _check_count(name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise InputError(f"{name}: is {value!r}, expected a whole number >= 1")


def _read_only(array: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
    view = array.view()
    view.setflags(write=False)
    return view


def _start(model: mujoco.MjModel, description: RobotDescription, joints: IndexArray) -> tuple[FloatArray, slice | None]:
    """MuJoCo's generalised position at the start, and where in it a floating base's orientation is."""
    data = mujoco.MjData(model)
    data.qpos[joints] = description.initial_position
    if not description.is_floating:
        return data.qpos.copy(), None
    FloatingBase(model, description, data.qpos).place(data)
    first = int(model.jnt_qposadr[model.body_jntadr[model.body(description.base.body).id]])
    return data.qpos.copy(), slice(first + 3, first + 7)
