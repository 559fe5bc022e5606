"""A robot in MuJoCo behind the interface that real robots have: the reference for every other simulation."""

from __future__ import annotations

import copy
from collections import deque
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np

from humanoid_sim.errors import RobotError
from humanoid_sim.messages import SafetyLevel, SafetyStatus
from humanoid_sim.mit import FloatArray, MITCommand, MITState, mit_torque
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.rates import delay_steps
from humanoid_sim.simulation.floating_base import BaseState, FloatingBase, StartPose, move_support
from humanoid_sim.simulation.model import UNSOUND, SimConfig, build_model
from humanoid_sim.simulation.push import Pushes
from humanoid_sim.simulation.randomisation import RandomPushes, Variation
from humanoid_sim.simulation.sensing import Sensors
from humanoid_sim.simulation.stability import DampingStability

_SOURCE = "mujoco"
_OK = SafetyStatus(source=_SOURCE)


@dataclass(frozen=True, slots=True)
class Touch:
    """A piano's key that is touched."""

    force: float
    """N, normal to the surfaces."""
    key: int
    """0 is A0, 87 is C8."""
    time: float
    """s"""


_Sample = tuple[int, FloatArray, FloatArray, FloatArray, FloatArray]
"""Physics step at which it was taken, `qpos`, `qvel`, `sensordata`, effort."""


class SimRobot:
    """A simulated robot: `write` applies a command and advances physics by one control period.

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
        """See `Robot.joints`."""
        self.control_period = config.period(description)
        """s, by which one `write` advances the simulation."""
        self.physics_steps = config.physics_steps(description)
        """Physics steps in one control period."""
        self._timestep = config.timestep(description)
        self._command_steps = config.delay(description, self._timestep)
        self._state_steps = delay_steps("state_delay", config.state_delay, self._timestep)
        self._is_sampled_now = config.state_sampling == "now"
        self._is_punctual = self._is_sampled_now and self._state_steps == 0
        self.model = build_model(description, physics_timestep=self._timestep, sensors=config)
        """The compiled MuJoCo model."""
        self.data = mujoco.MjData(self.model)
        """MuJoCo's state, live, with all that it derives from `qpos` and `qvel`."""
        self._warnings = [self.data.warning[kind] for kind in UNSOUND]
        self._sensors = Sensors(self.model, description, config)
        self.extern = self._sensors.widths
        """Names and widths of the live inputs that the state has."""
        self.stability = DampingStability(self.model, description)
        self.warnings = self.stability.check_description()
        """Messages to an operator about this simulation, one line each: gains that are close to unstable."""
        self.pushes = Pushes(config.pushes, self.model, description)
        """The planned ones, and others that are added as they come."""
        self.hardest_touch: Touch | None = None
        """Hardest touch of a key of its piano in any physics step since `forget_touches`; None for none."""
        self.is_closed = False
        """True once `close` was called."""

        self._base: FloatingBase | None = None
        if description.is_floating:
            self.data.qpos[self._sensors.joints.qpos] = description.initial_position
            self._base = FloatingBase(self.model, description, self.data.qpos, config)
        self._is_lifted = False
        self._step = self._start = 0
        self._prepare_motors()
        self.activate()

    def _prepare_motors(self) -> None:
        description = self.description
        self._nominal: mujoco.MjModel | None = None
        self._variation: Variation | None = None
        self._random_pushes: RandomPushes | None = None
        self._limit = description.torque_scale * description.effort_limit
        self._scales = (description.torque_scale,) * 2
        self._is_as_commanded = bool((description.torque_scale == 1.0).all())
        self._delay = self._command_steps
        joints = self._sensors.joints
        self._is_contiguous = isinstance(joints.qpos_slice, slice) and isinstance(joints.dof_slice, slice)
        self._scratch = np.zeros(len(self.joints))
        # a view, where the joints are adjacent and in order: nothing to scatter at each physics step
        self._torque: FloatArray = self.data.qfrc_applied[joints.dof_slice]
        self._command: MITCommand | None = None
        self._pending: deque[tuple[int, MITCommand]] = deque()
        self._joint_samples: deque[_Sample] = deque()
        self._body_samples: deque[_Sample] = deque()
        self._state: MITState | None = None
        self._fault = ""

    @property
    def time(self) -> float:
        """s, the robot's clock: physics steps times the physics step."""
        return self._step * self._timestep

    @property
    def fault(self) -> str:
        """Return what is wrong with the simulation, which then stands still; empty while it is sound."""
        return self._fault

    @property
    def qpos(self) -> FloatArray:
        """Shape (nq,), a copy of MuJoCo's generalised position."""
        qpos: FloatArray = self.data.qpos.copy()
        return qpos

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
        """Return whether the support holds a floating base."""
        return self._base is not None and self._base.is_held(self.data)

    @cached_property
    def start_pose(self) -> StartPose:
        """Pose in which a robot without support starts, for any joint positions."""
        return StartPose(self.model, self.description)

    def activate(self) -> None:
        """Put the robot to rest at its start, forget commands, clear a fault. Raises `RobotError` if it is closed."""
        self._require_open()
        self._begin(MITCommand.zeros(len(self.joints)))
        self.data.qpos[self._sensors.joints.qpos] = self.description.initial_position
        if self._base is not None:
            self._base.place(self.data)
            if self.config.support:
                self._base.hold(self.data)
        self._sample_first()

    def relaunch(self) -> None:
        """Activate in a new process: the clock is at 0."""
        self._step = 0
        self.activate()

    def reset(
        self, qpos: FloatArray | None = None, qvel: FloatArray | None = None, warmstart: FloatArray | None = None
    ) -> None:
        """Begin an episode at time 0, without support.

        Until the first command arrives, the motors hold the position that the joints start in, with its gains.

        Args:
            qpos: shape (nq,); None for `start_pose`.
            qvel: shape (nv,); None for rest.
            warmstart: shape (nv,), acceleration of the physics step before, with which the solver begins; None: zeros.
        """
        self._require_open()
        self._step = 0
        self._begin(None)
        self.data.qpos[:] = self.start_pose.arrays()[0] if qpos is None else qpos
        self.data.qvel[:] = 0.0 if qvel is None else qvel
        self.data.qacc_warmstart[:] = 0.0 if warmstart is None else warmstart
        self._sample_first()

    def vary(self, variation: Variation) -> None:
        """Become that robot; `activate` or `reset` is to follow."""
        if self._nominal is None:
            self._nominal = copy.copy(self.model)
        scale = self.description.torque_scale
        self._variation = variation
        for name, values in variation.model_fields(self._nominal, self._sensors.joints.dof).items():
            getattr(self.model, name)[:] = values
        mujoco.mj_setConst(self.model, self.data)
        self._limit = scale * self.description.effort_limit * variation.effort
        self._scales = scale * variation.stiffness, scale * variation.damping
        self._is_as_commanded = False
        self._delay = self._command_steps + round(variation.delay / self._timestep)
        if variation.push[1] > 0.0:
            mass = float(self._nominal.body_subtreemass[self._nominal.body(self.description.base.body).id])
            self._random_pushes = RandomPushes(1, mass, variation.push_interval, self.control_period)

    def read(self) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        """Return the state as it is seen at the present simulation time, and the simulator's safety status."""
        if self._state is None:
            self._state = self._seen()
        if self._fault:
            return self._state, (SafetyStatus(level=SafetyLevel.CRITICAL, source=_SOURCE, message=self._fault),)
        return self._state, (_OK,)

    def state(self) -> MITState:
        """Return the state as it is seen now, late as it may be."""
        return self.read()[0]

    def truth(self) -> MITState:
        """Return the state as it is now, whatever delays and sampling there are."""
        return self.state() if self._is_punctual else self._state_of(self._now(), self._now())

    def body_poses(self, *, in_base: bool = False) -> tuple[FloatArray, FloatArray]:
        """Positions (b, 3), m, and quaternions (b, 4), w x y z, of the bodies, in the base's frame or the world's."""
        return self._sensors.body_poses(self.data.sensordata, in_base=in_base)

    def write(self, command: MITCommand) -> None:
        """Apply a command, shape (n,), and advance physics by one control period.

        Raises `RobotError` if the command is for another number of joints, or the robot is closed.
        """
        if command.position.shape != (len(self.joints),):
            raise RobotError(
                f"{self.description.name}: command has shape {command.position.shape}, expected ({len(self.joints)},)"
            )
        self._require_open()
        self._state = None
        if self._fault:
            self._step += self.physics_steps
            return
        self._disturb()
        if self._command is None:
            start = self.data.qpos[self._sensors.joints.qpos]
            self._command = replace(self._applied(command), position=start, velocity=0.0 * start, effort=0.0 * start)
        self._pending.append((self._step + self._delay, command))
        if self._is_punctual and self._delay == 0 and self._sensors.touch.stop == 0:
            self._arrive()
            self._advance(self.physics_steps)
        else:
            self._advance_slowly()
        if any(warning.number for warning in self._warnings):
            self._fault = f"simulation unstable: its state is not finite, or huge (t = {self.time:.4f} s)"

    def set_support(self, held: bool, *, lifts: bool = False) -> None:
        """Let the support hold a floating base where it now is, or let the base go.

        If it `lifts`, it then raises the base, slowly, to the height of its start; never without a `drop`. Raises
        `RobotError` if the base is fixed.
        """
        move_support(self._base, self.data, held, self.description.name)
        mujoco.mj_step1(self.model, self.data)
        self._is_lifted = lifts

    def forget_touches(self) -> None:
        """Look for the hardest touch from here on."""
        self.hardest_touch = None

    def close(self) -> None:
        """Refuse further commands. May be called twice."""
        self.is_closed = True

    def _require_open(self) -> None:
        if self.is_closed:
            raise RobotError(f"{self.description.name}: the simulated robot is closed")

    def _begin(self, command: MITCommand | None) -> None:
        """Forget everything; `command` is in force, None: the start position is to be held."""
        mujoco.mj_resetData(self.model, self.data)
        self._command = command
        self._torque[:] = 0.0
        self._fault = ""
        self._is_lifted = False
        self._pending.clear()
        self._state = None
        self._start = self._step
        self.pushes.forget()

    def _sample_first(self) -> None:
        self.data.time = self.time
        mujoco.mj_forward(self.model, self.data)
        self._joint_samples, self._body_samples = deque([self._now()]), deque([self._now()])

    def _disturb(self) -> None:
        """Put support and pushes of the coming control period in force."""
        if self._is_lifted and self._base is not None:
            self._base.lift(self.data, self.control_period)
        if self._random_pushes is not None and self._variation is not None:
            step = (self._step - self._start) // self.physics_steps
            body = self.model.body(self.description.base.body).id
            self.data.xfrc_applied[body] = self._random_pushes.wrench(np.array([step]), [self._variation])[0]
        else:
            self.pushes.apply(self.data, self.time)

    def _applied(self, command: MITCommand) -> MITCommand:
        """Return the command with which described motors of full strength would give the torque that these give."""
        if self._is_as_commanded:
            return command
        stiffness, damping = self._scales
        return MITCommand(
            position=command.position if self._variation is None else command.position - self._variation.encoder_offset,
            velocity=command.velocity,
            effort=command.effort * self.description.torque_scale,
            stiffness=command.stiffness * stiffness,
            damping=command.damping * damping,
        )

    def _arrive(self) -> None:
        """Let the oldest command under way reach the motors, which may answer."""
        self._command = self._applied(self._pending.popleft()[1])
        if not self._is_sampled_now:
            self._joint_samples.append(self._now())

    def _advance(self, count: int) -> None:
        """Take physics steps under the command in force. This loop is most of what a tick costs beyond MuJoCo."""
        model, data, command, joints = self.model, self.data, self._command, self._sensors.joints
        assert command is not None
        limit, lower, scratch, torque = self._limit, -self._limit, self._scratch, self._torque
        step1, step2, gathers = mujoco.mj_step1, mujoco.mj_step2, not self._is_contiguous
        position, velocity = data.qpos[joints.qpos_slice], data.qvel[joints.dof_slice]
        for _ in range(count):
            if gathers:
                position, velocity = data.qpos[joints.qpos], data.qvel[joints.dof]
            mit_torque(command, position, velocity, limit, out=torque, scratch=scratch, lower=lower)
            if gathers:
                data.qfrc_applied[joints.dof] = torque
            step2(model, data)
            step1(model, data)  # so that position and velocity sensors are those of the new state
        self._step += count

    def _advance_slowly(self) -> None:
        """Take the physics steps of a control period one by one: commands arrive, samples are taken, keys touched."""
        for _ in range(self.physics_steps):
            if self._pending and self._pending[0][0] <= self._step:
                self._arrive()
            self._advance(1)
            if not self._is_punctual and (self._step + self._state_steps) % self.physics_steps == 0:
                self._body_samples.append(self._now())
                if self._is_sampled_now:
                    self._joint_samples.append(self._now())
            if self._sensors.touch.stop and self.data.ncon:
                self._note_touch()

    def _note_touch(self) -> None:
        force = self.data.sensordata[self._sensors.touch]
        key = int(force.argmax())
        if force[key] > (0.0 if self.hardest_touch is None else self.hardest_touch.force):
            self.hardest_touch = Touch(float(force[key]), key, self.time)

    def _now(self) -> _Sample:
        data = self.data
        return self._step, data.qpos.copy(), data.qvel.copy(), data.sensordata.copy(), self._torque.copy()

    def _seen(self) -> MITState:
        """Return the latest samples that have arrived."""
        if self._is_punctual:
            data = self.data
            now = (self._step, data.qpos, data.qvel, data.sensordata, self._torque)
            return self._state_of(now, now)
        for samples in (self._joint_samples, self._body_samples):
            while len(samples) > 1 and samples[1][0] + self._state_steps <= self._step:
                samples.popleft()
        return self._state_of(self._joint_samples[0], self._body_samples[0])

    def _state_of(self, joints: _Sample, body: _Sample) -> MITState:
        offset = None if self._variation is None else self._variation.encoder_offset
        state = self._sensors.state(
            self.time,
            *body[1:4],
            joints[4],
            age=(self._step - joints[0]) * self._timestep,
            sampled=body[0] * self._timestep,
            encoder_offset=offset,
        )
        if joints[0] == body[0]:
            return state
        own, position = self._sensors.joints, joints[1][self._sensors.joints.qpos]
        position = position if offset is None else position + offset
        return replace(state, joint_position=position, joint_velocity=joints[2][own.dof])
