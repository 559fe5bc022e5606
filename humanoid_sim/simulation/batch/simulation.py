"""Many robots in MuJoCo at once: `mujoco.rollout` on several threads, and NumPy on whole batches around it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar, get_args

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.mit import COMMAND_FIELDS, BoolArray, FloatArray, IndexArray, IntArray, MITCommand, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.rates import delay_steps, steps_per_period
from humanoid_sim.simulation.batch.draws import Draws
from humanoid_sim.simulation.batch.motors import BatchMotors, MotorDifferences
from humanoid_sim.simulation.batch.physics import BatchPhysics, ModelPool, usable_processors, vary_models
from humanoid_sim.simulation.batch.randomisation import Randomisation
from humanoid_sim.simulation.batch.sensors import BatchSensors
from humanoid_sim.simulation.floating_base import BaseObserver, BaseState, StartPose, base_addresses
from humanoid_sim.simulation.keys import PianoKeys
from humanoid_sim.simulation.model import base_body, body_ids, build_model, joint_addresses
from humanoid_sim.simulation.plant import BatchActuation, check_actuation, mean_delay_steps, timestep_of
from humanoid_sim.simulation.push import PUSH_DURATION
from humanoid_sim.simulation.stability import DampingStability

Scalar = TypeVar("Scalar", bound=np.generic)

_DELAYS = "command_delay", "state_delay"
_OF_MOTORS = "command_delay", "stiffness", "damping", "motor_strength", "effort_limit", "joint_position_bias"
_OF_SENSORS = (
    "state_delay",
    "joint_position_bias",
    "orientation_bias",
    "angular_velocity_bias",
    "linear_acceleration_bias",
    "gravity_tilt",
)


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
        height_scan: HeightScan | None = None,
        bodies: Sequence[str] = (),
        push_body: str = "",
        randomisation: Randomisation | None = None,
        seeds: npt.ArrayLike | None = None,
    ) -> None:
        """Build the model once, and copies of it where environments differ.

        Raises `InputError` if an option is not accepted, the MJCF does not fit the description, or the description's
        damping is unstable at this physics step.

        Args:
            control_period: s, by which one `step` advances; None for the description's.
            physics_timestep: s, must divide the control period; None for what suits robot and plant.
            actuation: `affine`, which agrees with the reference, or `implicit`, the faster approximation.
            threads: that step physics; None for one per processor that this process may use.
            anchor_body: MJCF body whose pose the state reports as `anchor_pose`; empty for none.
            velocity_at: `imu`, or MJCF sites, whose velocity the state of robots with a floating base reports.
            height_scan: of the ground, which the state reports; None for none.
            push_body: MJCF body that the wrenches of `step` act on; empty for the base.
            randomisation: how the environments differ, drawn again by `redraw`; None: not at all.
            seeds: shape (N,), whole numbers, of the differences and the noise; None: 0, 1, 2, ….
        """
        for name, value in (("count", count), ("threads", 1 if threads is None else threads)):
            if isinstance(value, bool) or not isinstance(value, int) or value < 1:
                raise InputError(f"{name}: is {value!r}, expected a whole number >= 1")
        settings = description.simulation
        check_actuation(actuation, get_args(BatchActuation))
        timestep = timestep_of(description, actuation, physics_timestep)
        self.description = description
        self.joints = description.joint_names
        """Names of the n joints, in the order of all per-joint arrays."""
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
        if self.randomisation.has("push") and not description.is_floating:
            raise InputError(f"randomisation: push: '{description.name}' has a fixed base, which no push moves")
        self._joints = joint_addresses(model, description.joint_names)
        carriers = [description.base.body] if description.is_floating else description.hands
        self._carriers = np.array(body_ids(model, carriers), dtype=np.intp)
        self._draws = Draws(
            self.randomisation,
            count,
            joints=len(self._joints.dof),
            bodies=int(model.nbody),
            carriers=len(self._carriers),
        )
        push = body_ids(model, [push_body])[0] if push_body else base_body(model, description)
        self.start_pose = StartPose(model, description, self._joints)
        """Pose in which a robot starts, for any joint positions."""
        self._base = BaseObserver(model, description) if description.is_floating else None
        self._pool = ModelPool(model, count)
        self.threads = min(usable_processors() if threads is None else threads, count)
        """Threads that step physics."""
        longest = {name: round(getattr(self.randomisation, name)[1] / timestep) for name in _DELAYS}
        self._physics = BatchPhysics(
            self._pool, count, self.physics_steps, self.threads, push, longest_delay=longest["state_delay"]
        )
        self._is_late = longest["state_delay"] > 0
        self._sensors = BatchSensors(
            self._physics,
            description,
            self._joints,
            self._draws,
            anchor_body=anchor_body,
            velocity_at=velocity_at,
            height_scan=height_scan,
            bodies=bodies,
        )
        self._effort = np.zeros((count, len(self._joints.dof)))
        self._touches = None if description.piano is None else _BatchTouches(self._pool, self._physics)
        self._step = np.zeros(count, dtype=np.int64)
        self._fault = np.zeros(count, dtype=np.bool_)
        self._truth: MITState | None = None
        self._report: MITState | None = None
        self._measured: FloatArray | None = None
        self._limit = description.torque_scale * description.effort_limit
        self._motors = BatchMotors(
            self._pool,
            self.physics_steps,
            MotorDifferences.none(
                count, self._limit, description.torque_scale, mean_delay_steps(description, timestep)
            ),
            self._draws,
            longest_delay=longest["command_delay"],
            jitter=delay_steps("randomisation: command_jitter", self.randomisation.command_jitter, timestep),
        )
        self._pushes: RandomPushes | None = None
        if self.randomisation.has("push"):
            mass = float(model.body_subtreemass[model.body(description.base.body).id])
            self._pushes = RandomPushes(self._draws, mass, self.control_period)
        self.reseed(np.arange(count) if seeds is None else seeds)

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

    @property
    def key_force(self) -> FloatArray:
        """Shape (N,), N, with which a key of each robot's piano was touched in the latest `step`, at most.

        Of every physics step; 0 where none was touched. Computed when it is asked for, at about the cost of a `step`.
        Raises `RobotError` if the robot has no piano.
        """
        if self._touches is None:
            raise RobotError(f"{self.description.name}: has no piano, whose keys could be touched")
        return self._touches.hardest()

    def model(self, i: int) -> mujoco.MjModel:
        """Return the model of environment i, which others may share."""
        return self._pool[i]

    def reseed(self, seeds: npt.ArrayLike, indices: npt.ArrayLike | None = None) -> None:
        """Draw the differences of some environments anew, and put them back to where they began.

        Args:
            seeds: shape (k,) or scalar, whole numbers in [0, 2⁶⁴).
            indices: shape (k,), which; None for all.
        """
        where = np.arange(self.count) if indices is None else np.asarray(indices, dtype=np.intp)
        self._draws.seed(where, seeds)
        self._draw_differences(where)
        self.reset(where)

    def redraw(self, indices: npt.ArrayLike | None = None) -> None:
        """Draw the differences of some environments for their next episode, as `reseed`; they are to be reset then."""
        where = np.arange(self.count) if indices is None else np.asarray(indices, dtype=np.intp)
        self._draws.next_episode(where)
        self._draw_differences(where)

    def _draw_differences(self, where: IndexArray) -> None:
        vary_models(self._pool, where, self._draws, self._joints.dof, self._carriers)
        if self.randomisation.has(*_OF_MOTORS):
            self._motors.differences.draw(where, self._draws, self._timestep, self._limit)
        if self.randomisation.has(*_OF_SENSORS):
            self._sensors.differences.draw(where, self._draws, self._timestep)

    def reset(
        self,
        indices: npt.ArrayLike | None = None,
        *,
        qpos: FloatArray | None = None,
        qvel: FloatArray | None = None,
        **pose: FloatArray | None,
    ) -> None:
        """Start some environments anew, at time 0, without a fault or a memory of what was.

        Until their first command arrives, the motors hold the position that the joints start in.

        Args:
            indices: shape (k,), which; None for all.
            qpos: shape (k, nq), MuJoCo's generalised position, instead of a pose.
            qvel: shape (k, nv), MuJoCo's generalised velocity, likewise.
            pose: where the robots start, and how they move, as `StartPose.arrays` takes it, shape (k, …) each.
        """
        where = np.arange(self.count) if indices is None else np.asarray(indices, dtype=np.intp)
        position, velocity = self.start_pose.arrays(where.shape, **pose)
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

        Raises `RobotError` if the command has another shape, or the simulation is closed.

        Args:
            command: shape (N, n). A row that is not finite is a fault of its environment.
            wrench: shape (N, 6), N and N·m, force and torque on the push body at its centre of mass, world frame, for
                the whole period; None for none.
            where: shape (N,), the environments that advance; None for all. The others stand still, as do those with a
                fault.
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
        if self._pushes is not None:
            pushes = self._pushes.wrench(self._step)
            wrench = pushes if wrench is None else wrench + pushes
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

    def speed_up(self, velocity: FloatArray) -> None:
        """Change the velocity of whole robots at once, without a force: a push as legged_gym and Isaac Lab mean it.

        `velocity`, shape (N, 3), m/s, world frame, is by how much all bodies of each robot move faster. Raises
        `RobotError` if the base is fixed, or the simulation is closed.
        """
        self._check_open()
        if not self.description.is_floating:
            raise RobotError(f"{self.description.name}: has a fixed base, whose velocity does not change")
        _, _, linear, _ = base_addresses(self._pool.nominal, self.description)
        self._physics.speed_up(linear, velocity)
        self._truth = self._report = self._measured = None

    def snapshot(self) -> dict[str, Any]:
        """Copy all that later steps and reports depend on, for `restore` of a simulation that was built alike."""
        arrays = {"effort": self._effort.copy(), "step": self._step.copy(), "fault": self._fault.copy()}
        parts = {"physics": self._physics.snapshot(), "motors": self._motors.snapshot()}
        return arrays | parts | {"draws": self._draws.snapshot(), "is_closed": self._physics.is_closed}

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Take over a snapshot, differences between the environments included."""
        self._draws.restore(snapshot["draws"])
        self._draw_differences(np.arange(self.count))
        self._physics.restore(snapshot["physics"])
        self._motors.restore(snapshot["motors"])
        self._effort, self._step, self._fault = (snapshot[name].copy() for name in ("effort", "step", "fault"))
        self._truth = self._report = self._measured = None
        if snapshot["is_closed"]:
            self.close()

    def truth(self) -> MITState:
        """Return the true state of the robots now, shape (N, …): what `state` is without noise."""
        if self._truth is None:
            self._truth = self._sensors.read(self._physics.now, self._measure(), self._effort, self.base)
        return self._truth

    def state(self) -> MITState:
        """Return what the robots report now, shape (N, …): late, biased and noisy as the randomisation says."""
        if self._report is None:
            state = self._late_state() if self._is_late else self.truth()
            self._report = self._sensors.disturb(state, self._step)
        return self._report

    def _late_state(self) -> MITState:
        """Return the state that has arrived by now."""
        self._check_open()
        delay = self._sensors.differences.delay
        then, before, control = self._physics.past(delay)
        measured = self._sensors.measure(then)
        centre_of_mass = self._sensors.centre_of_mass(measured)
        base = None if self._base is None else self._base.at(then.qpos, then.qvel, centre_of_mass)
        torque = self._motors.torque(before.qpos[:, self._joints.qpos], before.qvel[:, self._joints.dof], control)
        effort = np.where((then.time > 0.0)[:, None], torque, 0.0)
        age = np.broadcast_to((self._physics.time - then.time)[:, None], effort.shape)
        return replace(self._sensors.read(then, measured, effort, base), time=self._physics.time, joint_age=age)

    def body_poses(self, *, in_base: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return where the bodies truly are, in the base's frame or the world's: new (N, b, 3), m, and (N, b, 4)."""
        return self._sensors.poses(self._measure(), in_base=in_base)

    def _measure(self) -> FloatArray:
        if self._measured is None:
            self._check_open()
            self._measured = self._sensors.measure(self._physics.now)
        return self._measured

    def _check_open(self) -> None:
        if self._physics.is_closed:
            raise RobotError(f"{self.description.name}: the batch simulation is closed")

    @property
    def is_closed(self) -> bool:
        """Return whether `close` was called."""
        return self._physics.is_closed

    def close(self) -> None:
        """Stop the threads. May be called twice."""
        self._physics.close()


def _read_only(array: npt.NDArray[Scalar]) -> npt.NDArray[Scalar]:
    view = array.view()
    view.setflags(write=False)
    return view


class RandomPushes:
    """One push of `PUSH_DURATION` in each stretch of `push_interval`, at a moment and in a direction that are drawn."""

    def __init__(self, draws: Draws, mass: float, control_period: float) -> None:
        """Set up; the draws are of a randomisation with pushes, the mass, kg, is of the robot as its model is."""
        self._draws, self._mass, self._period = draws, mass, control_period
        self._interval = max(round(draws.randomisation.push_interval / control_period), 1)
        self._duration = min(max(round(PUSH_DURATION / control_period), 1), self._interval)

    def wrench(self, step: IntArray) -> FloatArray:
        """Force and torque in the control periods that begin now, shape (N, 6), N and N·m, world frame.

        `step`, shape (N,), counts control periods since each environment's start.
        """
        draws = self._draws
        stretch, since = np.divmod(step, self._interval)
        moment, direction, strength = draws.shares("push", stretch, 3).T
        begin = np.floor(moment * (self._interval - self._duration + 1))
        low, high = draws.randomisation.push
        speed = low + (high - low) * strength
        lasts = (begin <= since) & (since < begin + self._duration)
        force = np.where(lasts, self._mass * speed / (self._duration * self._period), 0.0)
        wrench = np.zeros((len(step), 6))
        wrench[:, 0] = force * np.cos(2.0 * np.pi * direction)
        wrench[:, 1] = force * np.sin(2.0 * np.pi * direction)
        return wrench


_MOVED = 1e-4
"""rad from where the spring holds a key: one that has not come so far was not touched."""


class _BatchTouches:
    """Works out anew the contacts of the steps in which a key is down, which `mujoco.rollout` does not tell."""

    def __init__(self, pool: ModelPool, physics: BatchPhysics) -> None:
        """Find the keys. Raises `InputError` where the robots have no piano."""
        self._pool, self._physics = pool, physics
        self._keys = PianoKeys(pool.nominal)

    def hardest(self) -> FloatArray:
        """Shape (N,), N, with which each robot touched a key hardest in the latest control period.

        Normal to the surfaces; 0 where none was touched, and where a robot stood still.
        """
        found = np.zeros(len(self._physics.qpos))
        data = self._pool.room
        for i, states, controls in self._physics.latest():
            model = self._pool[i]
            angles = states[:, 1 + self._keys.qpos]
            moved = np.asarray((angles > _MOVED).any(axis=1))
            for step in np.flatnonzero(moved[:-1] | moved[1:]).tolist():
                mujoco.mj_setState(model, data, states[step], int(mujoco.mjtState.mjSTATE_FULLPHYSICS))
                data.ctrl[:] = controls[step]
                data.qacc_warmstart[:] = 0.0  # whatever was computed before: each robot gives what it would give alone
                mujoco.mj_forward(model, data)
                found[i] = max(found[i], float(self._keys.force(model, data).max()))
        return found
