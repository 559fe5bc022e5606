"""A robot in MuJoCo behind the interface that real robots have: the reference for every other simulation."""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, RobotError, require_known
from humanoid_sim.messages import SafetyLevel, SafetyStatus
from humanoid_sim.mit import FloatArray, MITCommand, MITState, bind_torque
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.floating_base import BaseState, StartPose, Support
from humanoid_sim.simulation.model import UNSOUND, SimConfig, build_model
from humanoid_sim.simulation.randomisation import PUSH_DURATION, Randomisation, RandomPushes, Variation, push_wrench
from humanoid_sim.simulation.sensing import Sensors
from humanoid_sim.simulation.stability import DampingStability

_SOURCE = "mujoco"
_OK = (SafetyStatus(source=_SOURCE),)
_NO_SENSORS = int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
_FASTEST_PUSH = 10.0  # m/s


class SimRobot:
    """A simulated robot: `write` applies a command and advances physics by one control period, of `physics_steps`.

    `mit_torque` acts before every physics step. The clock counts physics steps; `activate` puts the robot back to its
    start at the present time, as a relaunch on a running robot would find it, and `reset` begins an episode at time 0.
    A simulation that is no longer finite becomes a CRITICAL safety status; physics then stands still until `activate`.
    Not thread-safe.
    """

    def __init__(self, description: RobotDescription, config: SimConfig | None = None) -> None:
        """Build the model. Raises `InputError` where settings, MJCF or damping do not fit the physics step."""
        self.config = config = SimConfig() if config is None else config
        self.description = description
        self.joints = description.joint_names
        self.control_period = config.period(description)
        self.physics_steps = config.physics_steps(description)
        self._timestep = config.timestep(description)
        self.model = build_model(description, physics_timestep=self._timestep, sensors=config)
        self.data = mujoco.MjData(self.model)  # MuJoCo's state, live, with all that it derives from `qpos` and `qvel`
        self._warnings = self.data.warning.number[UNSOUND]  # a view: counts by kind
        self._sensors = Sensors(self.model, description, config)
        self.extern = self._sensors.widths
        self.stability = DampingStability(self.model, description)
        self.warnings = self.stability.check_description()
        """Messages to an operator about gains that are close to unstable, one line each."""
        self.is_closed = False
        self.data.qpos[self._sensors.joints.qpos] = description.initial_position
        self._support = Support(self.model, self.data, description, config.drop)
        self._step = self._start = 0

        moved = [self.model.body(int(self.model.joint(name).bodyid[0])).name for name in self.joints]
        base = [description.base.body] if description.is_floating else []
        self.pushable = (*base, *(name for name in moved if name))
        """Names of the bodies that can be pushed: a floating base, and the body that each joint moves."""
        self._push: tuple[int, FloatArray, int] | None = None  # body, wrench (6,), physics step at which it ends
        self._nominal = copy.copy(self.model)
        self._variation: Variation | None = None
        self._random_pushes: RandomPushes | None = None
        self._limit = description.torque_scale * description.effort_limit
        self._own_delay = self._delay = round(float(description.delay.mean()) / self._timestep)
        self._is_described = bool((description.torque_scale == 1.0).all())
        n, slices = len(self.joints), self._sensors.joints.slices
        self._gathers = slices is None  # else the joints' values are views of MuJoCo's arrays
        self._position, self._velocity, self._torque = np.zeros(n), np.zeros(n), np.zeros(n)
        if slices is not None:
            qpos, dof = slices
            self._position, self._velocity = self.data.qpos[qpos], self.data.qvel[dof]
            self._torque = self.data.qfrc_applied[dof]
        self._update_torque: Callable[[], None] | None = None
        self._pending: deque[tuple[int, MITCommand]] = deque()
        self._state: MITState | None = None
        self.fault = ""  # what is wrong with the simulation, which then stands still; empty while it is sound
        self.activate()

    @property
    def time(self) -> float:
        """s, the robot's clock: physics steps times the physics step."""
        return self._step * self._timestep

    @property
    def qpos(self) -> FloatArray:
        """Shape (nq,), a copy of MuJoCo's generalised position."""
        return np.array(self.data.qpos)

    @property
    def effort(self) -> FloatArray:
        """Shape (n,), N·m, a copy of the torque in the latest physics step, saturated."""
        return self._torque.copy()

    @property
    def base(self) -> BaseState | None:
        """Return pose and motion of a floating base now; None for a fixed one."""
        return self._sensors.base(self.data.qpos, self.data.qvel, self.data.sensordata)

    @property
    def supported(self) -> bool:
        return self._support.holds

    @cached_property
    def start_pose(self) -> StartPose:
        """Pose in which a robot without support starts."""
        return StartPose(self.model, self.description)

    def activate(self) -> None:
        """Put the robot to rest at its start, forget commands, clear a fault."""
        self._begin()
        self._bind(MITCommand.zeros(len(self.joints)))
        self.data.qpos[self._sensors.joints.qpos] = self.description.initial_position
        self._support.start(held=self.config.support)
        mujoco.mj_forward(self.model, self.data)

    def relaunch(self) -> None:
        """Activate in a new process: the clock is at 0."""
        self._step = 0
        self.activate()

    def reset(
        self, qpos: FloatArray | None = None, qvel: FloatArray | None = None, warmstart: FloatArray | None = None
    ) -> None:
        """Begin an episode at time 0, without support.

        Until the first command arrives, the motors hold the position that the joints start in, with its gains. It
        starts at `start_pose`, at rest, unless `qpos`, (nq,), and `qvel`, (nv,), are given; `warmstart`, (nv,), is the
        acceleration with which the solver begins.
        """
        self._step = 0
        self._begin()
        self.data.qpos[:] = self.start_pose.qpos() if qpos is None else qpos
        self.data.qvel[:] = 0.0 if qvel is None else qvel
        self.data.qacc_warmstart[:] = 0.0 if warmstart is None else warmstart
        mujoco.mj_forward(self.model, self.data)

    def vary(self, randomisation: Randomisation, generator: np.random.Generator) -> None:
        """Become another robot, drawn from a randomisation; `activate` or `reset` is to follow."""
        if randomisation.push[1] > 0.0 and self._random_pushes is None:
            mass = float(self._nominal.body_subtreemass[self.model.body(self.description.base.body).id])
            self._random_pushes = RandomPushes(randomisation, 1, mass, self.control_period)
        self._variation = variation = randomisation.draw(generator, self._nominal, len(self.joints))
        for name, values in variation.model_fields(self._nominal, self._sensors.joints.dof).items():
            getattr(self.model, name)[:] = values
        mujoco.mj_setConst(self.model, self.data)
        self._limit = self.description.torque_scale * self.description.effort_limit * variation.effort
        self._is_described = False
        self._delay = self._own_delay + round(variation.delay / self._timestep)

    def push(self, vx: float, vy: float, body: str = "") -> None:
        """Push a body, the floating base if empty, for `PUSH_DURATION` from now on; the newest push counts.

        The force is as large as it takes to speed up all that the body carries by `vx` and `vy`, m/s, world frame.
        """
        if not max(abs(vx), abs(vy)) <= _FASTEST_PUSH:
            raise InputError(f"push: is {vx:g},{vy:g} m/s, expected VX,VY within ±{_FASTEST_PUSH:g}")
        body = body or self.description.base.body
        require_known("body", [body], self.pushable)
        self.data.xfrc_applied[:] = 0.0
        i = self.model.body(body).id
        wrench = push_wrench(np.array([vx, vy]), float(self._nominal.body_subtreemass[i]))
        self._push = i, wrench, self._step + round(PUSH_DURATION / self._timestep)

    def read(self) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        """Return the state at the present simulation time, and the simulator's safety status."""
        if self.fault:
            return self.state(), (SafetyStatus(level=SafetyLevel.CRITICAL, source=_SOURCE, message=self.fault),)
        return self.state(), _OK

    def state(self) -> MITState:
        if self._state is None:
            data = self.data
            offset = None if self._variation is None else self._variation.encoder_offset
            self._state = self._sensors.state(self.time, data.qpos, data.qvel, data.sensordata, self._torque, offset)
        return self._state

    def body_poses(self, *, in_base: bool = False) -> tuple[FloatArray, FloatArray]:
        """Positions (b, 3), m, and quaternions (b, 4), w x y z, of the bodies, in the base's frame or the world's."""
        return self._sensors.body_poses(self.data.sensordata, in_base=in_base)

    def write(self, command: MITCommand) -> None:
        """Apply a command, shape (n,), and advance physics by one control period.

        Raises `RobotError` if the command is for another number of joints, or the robot is closed.
        """
        if command.position.shape != (len(self.joints),):
            name, shape = self.description.name, command.position.shape
            raise RobotError(f"{name}: command has shape {shape}, expected ({len(self.joints)},)")
        if self.is_closed:
            raise RobotError(f"{self.description.name}: the simulated robot is closed")
        self._state = None
        begin, end = self._step, self._step + self.physics_steps
        self._step = end
        if self.fault:
            return
        self._disturb(begin)
        applied = self._applied(command)
        if self._update_torque is None:
            start = self.data.qpos[self._sensors.joints.qpos]
            self._bind(replace(applied, position=start, velocity=np.zeros_like(start), effort=np.zeros_like(start)))
        self._pending.append((begin + self._delay, applied))
        while self._pending and self._pending[0][0] < end:
            arrival, applied = self._pending.popleft()
            self._advance(arrival - begin)
            self._bind(applied)
            begin = arrival
        self._advance(end - begin)
        if np.count_nonzero(self._warnings):
            self.fault = f"simulation unstable: its state is not finite, or huge (t = {self.time:.4f} s)"

    def set_support(self, held: bool, *, lifts: bool = False) -> None:
        self._support.move(held, lifts=lifts)
        mujoco.mj_step1(self.model, self.data)

    def close(self) -> None:
        self.is_closed = True

    def _begin(self) -> None:
        """Forget everything: no command is in force."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.time = self.time
        self._update_torque = self._state = self._push = None
        self.fault = ""
        self._torque[:] = 0.0
        self._pending.clear()
        self._start = self._step

    def _disturb(self, step: int) -> None:
        """Put support and pushes of the control period that begins at a physics step in force."""
        self._support.advance(self.control_period)
        if self._random_pushes is not None and self._variation is not None:
            period = np.array([(step - self._start) // self.physics_steps])
            body = self.model.body(self.description.base.body).id
            self.data.xfrc_applied[body] = self._random_pushes.wrench(period, [self._variation.push_seed])[0]
        elif self._push is not None:
            body, wrench, end = self._push
            self.data.xfrc_applied[body] = wrench if step < end else 0.0
            self._push = self._push if step < end else None

    def _applied(self, command: MITCommand) -> MITCommand:
        """Return the command with which described motors of full strength would give the torque that these give."""
        if self._is_described:
            return command
        scale, position = self.description.torque_scale, command.position
        stiffness, damping, effort = command.stiffness * scale, command.damping * scale, command.effort * scale
        if self._variation is not None:
            position = position - self._variation.encoder_offset
            stiffness, damping = stiffness * self._variation.stiffness, damping * self._variation.damping
        return MITCommand(position, command.velocity, effort, stiffness, damping)

    def _bind(self, command: MITCommand) -> None:
        update = bind_torque(command, self._position, self._velocity, self._limit, self._torque)

        def gather_and_scatter() -> None:
            joints, data = self._sensors.joints, self.data
            self._position[:], self._velocity[:] = data.qpos[joints.qpos], data.qvel[joints.dof]
            update()
            data.qfrc_applied[joints.dof] = self._torque

        self._update_torque = gather_and_scatter if self._gathers else update

    def _advance(self, count: int) -> None:
        """Take physics steps under the command in force. This loop is most of what a tick costs beyond MuJoCo.

        `mj_step1` comes last, so that position and velocity sensors are those of the new state.
        """
        if count == 0:
            return
        model, data, update_torque = self.model, self.data, self._update_torque
        assert update_torque is not None
        model.opt.disableflags |= _NO_SENSORS  # of the last state alone are read: 2 µs of 14 in a step of the Lite
        *steps, last = [mujoco.mj_step2, *[mujoco.mj_step] * (count - 1)]
        for step in steps:
            update_torque()
            step(model, data)
        model.opt.disableflags &= ~_NO_SENSORS
        update_torque()
        last(model, data)
        mujoco.mj_step1(model, data)
