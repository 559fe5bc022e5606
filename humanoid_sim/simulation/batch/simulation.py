"""Many robots in MuJoCo at once: `mujoco.rollout` on several threads, and NumPy on whole batches around it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, get_args

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITCommand, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.rates import steps_per_period
from humanoid_sim.simulation.batch.counter_random import seed_keys
from humanoid_sim.simulation.batch.motors import BatchMotors, MotorDifferences
from humanoid_sim.simulation.batch.physics import BatchPhysics, ModelPool, usable_processors
from humanoid_sim.simulation.batch.randomisation import Randomisation, vary_models
from humanoid_sim.simulation.batch.sensors import BatchSensors
from humanoid_sim.simulation.delay import delay_steps
from humanoid_sim.simulation.floating_base import BaseObserver, BaseState, StartPose
from humanoid_sim.simulation.model import base_body, body_ids, build_model, joint_addresses
from humanoid_sim.simulation.plant import BatchActuation, check_actuation, timestep_of
from humanoid_sim.simulation.stability import DampingStability

__all__ = ["BatchSimulation"]

Scalar = TypeVar("Scalar", bound=np.generic)
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
IndexArray = npt.NDArray[np.intp]


class BatchSimulation:
    """N robots under the MIT law; `step` advances all of them by one control period in native threads.

    The plant is `AffinePlant` or `ImplicitPlant` of `humanoid_sim.simulation.plant`; a floating base has no support.
    Every environment gives what it would give alone, whatever the others do. A simulation that is no longer finite is
    a fault of that environment: it stands still, as it was before the step, until it is reset. Not thread-safe.
    """

    def __init__(
        self,
        description: RobotDescription,
        count: int,
        *,
        control_period: float | None = None,
        physics_timestep: float | None = None,
        actuation: BatchActuation = "affine",
        threads: int | None = None,
        anchor_body: str = "",
        velocity_at: Sequence[str] = (),
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
            physics_timestep: s, must divide the control period; None for what suits robot and plant.
            actuation: `affine`, which agrees with the reference, or `implicit`, the faster approximation.
            threads: that step physics; None for one per processor that this process may use.
            anchor_body: MJCF body whose pose the state reports as `anchor_pose`; empty for none.
            velocity_at: `imu`, or MJCF sites, whose velocity the state of robots with a floating base reports.
            bodies: MJCF bodies that `body_poses` gives.
            push_body: MJCF body that the wrenches of `step` act on; empty for the base.
            randomisation: how the environments differ; None: not at all.
            seeds: shape (N,), whole numbers, of the differences and the noise; None: 0, 1, 2, ….

        Raises:
            InputError: an option is not accepted, the MJCF does not fit the description, or the description's damping
                is unstable at this physics step.
        """
        for name, value in (("count", count), ("threads", 1 if threads is None else threads)):
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise InputError(f"{name}: is {value!r}, expected a whole number >= 1")
        settings = description.simulation
        check_actuation(actuation, get_args(BatchActuation))
        timestep = timestep_of(description, actuation, physics_timestep)
        self.description = description
        self.count = count
        self.control_period = 1.0 / settings.control_frequency if control_period is None else control_period
        """s"""
        self.physics_steps = steps_per_period(self.control_period, timestep)
        """Physics steps in one control period."""
        self.randomisation = Randomisation() if randomisation is None else randomisation

        model = build_model(
            description,
            physics_timestep=timestep,
            affine_actuators=True,
            implicit=actuation == "implicit",
            scene="floor",
        )
        DampingStability(model, description).check_description()
        self._timestep = timestep
        self._joints = joint_addresses(model, description.joint_names)
        push = body_ids(model, [push_body])[0] if push_body else base_body(model, description)
        self._start = StartPose(model, description, self._joints)
        self._base = BaseObserver(model, description) if description.is_floating else None
        self._pool = ModelPool(model, count)
        self.threads = min(usable_processors() if threads is None else threads, count)
        """Threads that step physics."""
        self._physics = BatchPhysics(self._pool, count, self.physics_steps, self.threads, push)
        self._sensors = BatchSensors(
            self._physics,
            description,
            self._joints,
            self.randomisation,
            anchor_body=anchor_body,
            velocity_at=velocity_at,
            bodies=bodies,
        )
        self._effort = np.zeros((count, len(self._joints.dof)))
        self._step = np.zeros(count, dtype=np.int64)
        self._fault = np.zeros(count, dtype=np.bool_)
        self._truth: MITState | None = None
        self._report: MITState | None = None
        self._measured: FloatArray | None = None
        self._keys = seed_keys(np.zeros(count, dtype=np.uint64))
        self._motors = BatchMotors(
            self._pool,
            np.array(description.effort_limit),
            self.physics_steps,
            self._differences(),
            longest_delay=round(self.randomisation.command_delay[1] / timestep),
            jitter=delay_steps("randomisation: command_jitter", self.randomisation.command_jitter, timestep),
        )
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

    @property
    def base(self) -> BaseState | None:
        """True pose and motion of floating bases, shape (N, …); None for fixed ones.

        Their centres of mass are those of robots that weigh what the description says, whatever the randomisation does.
        """
        if self._base is None:
            return None
        centre_of_mass = self._sensors.centre_of_mass(self._measure())
        return self._base.at(self._physics.qpos, self._physics.qvel, centre_of_mass)

    def model(self, i: int) -> mujoco.MjModel:
        """The model of environment i, which others may share."""
        return self._pool[i]

    def reseed(self, seeds: npt.ArrayLike, indices: npt.ArrayLike | None = None) -> None:
        """Draw the differences of some environments anew, and put them back to where they began.

        Args:
            seeds: shape (k,) or scalar, whole numbers in [0, 2⁶⁴).
            indices: shape (k,), which; None for all.
        """
        where = np.arange(self.count) if indices is None else np.asarray(indices, dtype=np.intp)
        self._keys[:, where] = seed_keys(np.broadcast_to(np.asarray(seeds, dtype=np.uint64), where.shape))
        self._draw_differences(where)
        self.reset(where)

    def _draw_differences(self, where: IndexArray) -> None:
        vary_models(self._pool, where, self.randomisation, self._keys[:, where], self._joints.dof)
        self._motors.differences = self._differences()

    def _differences(self) -> MotorDifferences:
        randomisation, keys, n = self.randomisation, self._keys, len(self._joints.dof)
        delay = randomisation.draw("command_delay", keys, 1)[:, 0]
        return MotorDifferences(
            delay=np.rint(delay / self._timestep).astype(np.int64),
            stiffness=randomisation.draw("stiffness", keys, n),
            damping=randomisation.draw("damping", keys, n),
            keys=keys,
        )

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
        position, velocity = self._start.arrays(
            where.shape, joint_position=joint_position, joint_velocity=joint_velocity, base_yaw=base_yaw
        )
        position = position if qpos is None else np.asarray(qpos)
        velocity = velocity if qvel is None else np.asarray(qvel)
        self._physics.set(where, position, velocity)
        self._motors.hold(where, position[:, self._joints.qpos])
        self._effort[where] = 0.0
        self._step[where] = 0
        self._fault[where] = False
        self._truth = self._report = self._measured = None

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
        self._check_open()
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
        broken = self._physics.advance(control, wrench, chosen)
        self._fault[np.flatnonzero(broken) if chosen is None else chosen[broken]] = True
        moved = moving & ~self._fault
        torque = self._motors.torque(
            self._physics.previous_qpos[:, self._joints.qpos], self._physics.previous_qvel[:, self._joints.dof]
        )
        self._effort = np.where(moved[:, None], torque, self._effort)
        self._step = self._step + moved
        self._truth = self._report = self._measured = None

    def snapshot(self) -> dict[str, Any]:
        """A copy of all that later steps and reports depend on, for `restore` of a simulation that was built alike."""
        arrays = {"effort": self._effort.copy(), "step": self._step.copy(), "fault": self._fault.copy()}
        parts = {"physics": self._physics.snapshot(), "motors": self._motors.snapshot()}
        return arrays | parts | {"keys": self._keys.copy(), "is_closed": self._physics.is_closed}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over a snapshot, differences between the environments included."""
        self._keys[:] = snapshot["keys"]
        self._draw_differences(np.arange(self.count))
        self._physics.restore(snapshot["physics"])
        self._motors.restore(snapshot["motors"])
        self._effort, self._step, self._fault = (snapshot[name].copy() for name in ("effort", "step", "fault"))
        self._truth = self._report = self._measured = None
        if snapshot["is_closed"]:
            self.close()

    def truth(self) -> MITState:
        """The true state of the robots now, shape (N, …): what `state` is without noise."""
        if self._truth is None:
            self._truth = self._sensors.read(self._measure(), self._effort, self.base)
        return self._truth

    def state(self) -> MITState:
        """What the robots report now, shape (N, …), noise included."""
        if self._report is None:
            self._report = self._sensors.disturb(self.truth(), self._keys, self._step)
        return self._report

    def body_poses(self, *, in_base: bool = False) -> tuple[FloatArray, FloatArray]:
        """Where the bodies truly are.

        Args:
            in_base: in the frame of the robot's base instead of the world's.

        Returns:
            Positions (N, b, 3), m, and quaternions (N, b, 4), w x y z; new arrays.
        """
        return self._sensors.poses(self._measure(), in_base=in_base)

    def _measure(self) -> FloatArray:
        if self._measured is None:
            self._check_open()
            self._measured = self._sensors.measure()
        return self._measured

    def _check_open(self) -> None:
        if self._physics.is_closed:
            raise RobotError(f"{self.description.name}: the batch simulation is closed")

    def close(self) -> None:
        """Stop the threads. May be called twice."""
        self._physics.close()


def _read_only(array: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
    view = array.view()
    view.setflags(write=False)
    return view
