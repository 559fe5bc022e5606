"""A robot in MuJoCo behind the interface that real robots have."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Generic, Literal, TypeVar, get_args

import numpy as np

from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.messages import SafetyLevel, SafetyStatus
from humanoid_sim.mit import Extern, FloatArray, MITCommand, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.rates import delay_steps, steps_per_period
from humanoid_sim.simulation.floating_base import BaseObserver, BaseState, FloatingBase, move_support
from humanoid_sim.simulation.keys import PianoKeys, Touch, hardest_touch
from humanoid_sim.simulation.plant import Actuation, make_plant, mean_delay_steps, timestep_of
from humanoid_sim.simulation.push import Push, Pushes
from humanoid_sim.simulation.sensors import BodySample, BodySensors
from humanoid_sim.simulation.stability import DampingStability

T = TypeVar("T")
StateSampling = Literal["now", "on_command"]

_SOURCE = "mujoco"
_OK = SafetyStatus(source=_SOURCE)

_JointSample = tuple[FloatArray, FloatArray, FloatArray]
"""Position, velocity and effort."""


class _DelayLine(Generic[T]):
    """Delayed view of a stream of samples that take `delay` steps to reach the observer."""

    def __init__(self, delay: int) -> None:
        self._delay = delay
        self._samples: deque[tuple[int, T]] = deque()

    def restart(self, step: int, value: T) -> None:
        """Forget everything; `value` is seen at once."""
        self._samples.clear()
        self._samples.append((step, value))

    def push(self, step: int, value: T) -> None:
        """Add a sample taken at `step`, which is not before the previous one's."""
        self._samples.append((step, value))

    def at(self, step: int) -> tuple[int, T]:
        """Return the latest sample that has arrived at `step`, and when it was taken. `step` must not go back."""
        samples = self._samples
        while len(samples) > 1 and samples[1][0] + self._delay <= step:
            samples.popleft()
        return samples[0]


class MujocoRobot:
    """A simulated robot: `write` applies a command and advances physics by one control period.

    The clock counts physics steps and never goes back: `activate` puts joints and base back to where they began, at the
    present time, as a relaunch on a running robot would find them. A simulation that is no longer finite becomes a
    CRITICAL safety status; physics then stands still, with the state as it is, until `activate`.

    A floating base starts on its feet, held by a support until `set_support` lets it go. The state then carries the
    base's velocity as a live input, and of any robot the pose of `anchor_body` and a `height_scan`, if they are named.

    With the default options a state is read at the instant at which it is asked for. The others make the timing that of
    a bus: a command written at t takes effect at t + `command_delay`; a state sampled at t is seen from
    t + `state_delay` on; with `state_sampling="on_command"` a motor answers commands only, so that what is seen is the
    state at a command's arrival. Activation counts as an answer of every motor. The IMU is sampled at every instant,
    whatever the sampling, and is as late as the joints.
    """

    def __init__(
        self,
        description: RobotDescription,
        *,
        control_period: float | None = None,
        physics_timestep: float | None = None,
        actuation: Actuation = "qfrc_applied",
        command_delay: float = 0.0,
        state_delay: float = 0.0,
        state_sampling: StateSampling = "now",
        support: bool = True,
        base_position: tuple[float, float] = (0.0, 0.0),
        base_yaw: float = 0.0,
        base_height: float | None = None,
        drop: float = 0.0,
        anchor_body: str = "",
        velocity_at: Sequence[str] = (),
        height_scan: HeightScan | None = None,
        pushes: Sequence[Push] = (),
    ) -> None:
        """Build the model.

        Raises `InputError` if an option is not accepted, the MJCF does not fit the description, or the description's
        damping is unstable at this physics step.

        Args:
            control_period: s; None for the description's.
            physics_timestep: s, must divide the control period; None for the description's, or `IMPLICIT_TIMESTEP`.
            actuation: `qfrc_applied`, the reference, `affine` or `implicit`; see `humanoid_sim.simulation.plant`.
            command_delay: s, a multiple of the physics step, beside the mean of the description's own delays.
            state_delay: s, a multiple of the physics step.
            support: whether a floating base starts held; a fixed one ignores this and the four below.
            base_position: m, world frame, x and y where the base starts.
            base_yaw: rad, about the vertical, how the base is turned at the start.
            base_height: m, of the base's origin at the start; None for the description's, and if that has none, such
                that the robot hangs as far above the floor as `drop` says.
            drop: m, by which a floating base falls onto its feet when its support lets it go.
            anchor_body: MJCF body whose pose the state reports as `anchor_pose`; empty for none.
            velocity_at: `imu`, or MJCF sites, whose velocity the state of a robot with a floating base reports.
            height_scan: of the ground, which the state reports; None for none.
            pushes: of a floating base, each at its time.
        """
        if state_sampling not in get_args(StateSampling):
            accepted = " or ".join(get_args(StateSampling))
            raise InputError(f"state_sampling: is {state_sampling!r}, expected {accepted}")
        timestep = timestep_of(description, actuation, physics_timestep)
        period = 1.0 / description.simulation.control_frequency if control_period is None else control_period
        self.physics_steps = steps_per_period(period, timestep)
        """Physics steps in one control period."""
        command_steps = mean_delay_steps(description, timestep) + delay_steps("command_delay", command_delay, timestep)
        state_steps = delay_steps("state_delay", state_delay, timestep)

        self.description = description
        """Description that this robot was built from."""
        self.joints = description.joint_names
        """See `Robot.joints`."""
        self.control_period = period
        """s, by which one `write` advances the simulation."""
        self._timestep = timestep
        self._plant = make_plant(description, actuation=actuation, physics_timestep=timestep)
        self.model = self._plant.model
        """The compiled MuJoCo model."""
        self.data = self._plant.data
        """MuJoCo's state, live. What it derives from `qpos` (`xpos`, contacts) is one physics step older."""
        self.acceleration = self._plant.acceleration
        """Shape (nv,), of the latest physics step, live: what the IMU feels; see `Plant.acceleration`."""
        self.stability = DampingStability(self.model, description)
        """The stability measure of this robot's model, for the gains of a policy."""
        self.warnings = self.stability.check_description()
        """Messages to an operator about this simulation, one line each: gains that are close to unstable."""
        self.is_closed = False
        """True once `close` was called."""
        self._starts_held = support
        self._is_lifted = False
        self._base: FloatingBase | None = None
        self._observer: BaseObserver | None = None
        if description.is_floating:
            self._observer = BaseObserver(self.model, description)
            self._base = FloatingBase(
                self.model,
                description,
                self.data.qpos,
                position=base_position,
                yaw=base_yaw,
                height=base_height,
                drop=drop,
            )
        self._sensors = BodySensors(self.model, description, anchor_body, tuple(velocity_at), height_scan)

        self._keys = None if description.piano is None else PianoKeys(self.model)
        self.hardest_touch: Touch | None = None
        """Hardest touch of a key of its piano since `forget_touches`; None for none. Of every physics step, or, of the
        implicit plant, of the last one in each control period."""
        # The implicit plant's steps depend on how many are taken at a time.
        self._steps_at_once = 1 if self._keys is not None and actuation != "implicit" else self.physics_steps

        self.pushes = Pushes(pushes, self.model, description)
        """Those, and others that are added as they come."""
        self._set_timing(command_steps, state_steps, is_sampled_now=state_sampling == "now")
        self.activate()

    def _set_timing(self, command_steps: int, state_steps: int, *, is_sampled_now: bool) -> None:
        """Set up the lines of what is under way; delays are in physics steps."""
        self._step = 0
        self._fault = ""
        self._state: MITState | None = None
        # A command written at the start of a period arrives `whole` periods and `offset` steps later. Samples for
        # the read at the end of a period are taken `state_steps` before it, so at one fixed offset too.
        self._whole_periods_late, self._arrival_offset = divmod(command_steps, self.physics_steps)
        self._sample_offset = self.physics_steps - state_steps % self.physics_steps
        self._samples_now = is_sampled_now
        self._pending: deque[MITCommand] = deque()
        self._joint_line: _DelayLine[_JointSample] = _DelayLine(state_steps)
        self._body_line: _DelayLine[BodySample] = _DelayLine(state_steps)

    @property
    def time(self) -> float:
        """s, the robot's clock: physics steps since construction times the physics step."""
        return self._step * self._timestep

    @property
    def extern(self) -> Mapping[str, int]:
        """Names and widths of the live inputs that the state carries, as the policy's controller wants them."""
        return self._sensors.widths

    @property
    def supported(self) -> bool:
        """Return whether the support holds a floating base; a fixed base never needs one."""
        return self._base is not None and self._base.is_held(self.data)

    @property
    def base_state(self) -> BaseState | None:
        """Pose and motion of a floating base at the present simulation time, None for a fixed one. For monitors."""
        data = self.data
        return None if self._observer is None else self._observer.at(data.qpos, data.qvel)

    def forget_touches(self) -> None:
        """Look for the hardest touch from here on."""
        self.hardest_touch = None

    @property
    def qpos(self) -> FloatArray:
        """Shape (nq,), a read-only copy of MuJoCo's generalised position, for viewers."""
        qpos: FloatArray = self.data.qpos.copy()
        qpos.setflags(write=False)
        return qpos

    def activate(self) -> None:
        """Put the joints to rest in the initial position, forget commands, clear a fault. Raises `RobotError`."""
        if self.is_closed:
            raise RobotError(f"{self.description.name}: the simulated robot is closed")
        self._plant.reset()
        self.pushes.forget()
        if self._base is not None:
            self._base.place(self.data)
            self.set_support(self._starts_held)
        self._fault = ""
        self.data.time = self.time
        self._pending.clear()
        self._state = None
        self._joint_line.restart(self._step, self._joint_sample())
        self._body_line.restart(self._step, self._body_sample())

    def read(self) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        """Return the state as it is seen at the present simulation time, and the simulator's safety status.

        Reading twice gives the same state.
        """
        if self._state is None:
            sampled, joints = self._joint_line.at(self._step)
            felt, body = self._body_line.at(self._step)
            age = (self._step - sampled) * self._timestep
            self._state = self._seen(joints, age, body, felt * self._timestep)
        if self._fault:
            return self._state, (SafetyStatus(level=SafetyLevel.CRITICAL, source=_SOURCE, message=self._fault),)
        return self._state, (_OK,)

    def _seen(self, joints: _JointSample, age: float, body: BodySample, felt: float) -> MITState:
        """Return the state of samples; `age`, s, is the joints', and `felt`, s, the time of the body's."""
        live = {name: Extern(value, felt) for name, value in body.live.items()}
        position, velocity, effort = joints
        return MITState(
            time=self.time,
            joint_position=position,
            joint_velocity=velocity,
            joint_effort=effort,
            joint_age=np.full(len(self.joints), age),
            imu_quaternion=body.imu.quaternion,
            imu_angular_velocity=body.imu.angular_velocity,
            imu_linear_acceleration=body.imu.linear_acceleration,
            **({"extern": live} if live else {}),
        )

    def write(self, command: MITCommand) -> None:
        """Apply a command, shape (n,), and advance physics by one control period.

        Raises `RobotError` if the command is for another number of joints, or the robot is closed.
        """
        if command.position.shape != (len(self.joints),):
            raise RobotError(
                f"{self.description.name}: command has shape {command.position.shape}, expected ({len(self.joints)},)"
            )
        if self.is_closed:
            raise RobotError(f"{self.description.name}: the simulated robot is closed")
        self._state = None
        if self._fault:
            self._step += self.physics_steps
            return
        if self._is_lifted and self._base is not None:
            self._base.lift(self.data, self.control_period)
        self.pushes.apply(self.data, self.time)
        self._pending.append(command)
        if self._arrival_offset < self._sample_offset:
            self._advance(self._arrival_offset)
            self._arrive()
            self._advance(self._sample_offset - self._arrival_offset)
            self._sample()
            self._advance(self.physics_steps - self._sample_offset)
        else:
            self._advance(self._sample_offset)
            self._sample()
            self._advance(self._arrival_offset - self._sample_offset)
            self._arrive()
            self._advance(self.physics_steps - self._arrival_offset)
        fault = self._plant.fault()
        if fault:
            self._fault = f"{fault} (t = {self.time:.4f} s)"

    def set_support(self, held: bool, *, lifts: bool = False) -> None:
        """Let the support take a floating base where it now is, or let the base go; from the next write on.

        If it `lifts`, it then raises the base, slowly, to the height of its start; never without a `drop`. Raises
        `RobotError` if the base is fixed.
        """
        move_support(self._base, self.data, held, self.description.name)
        self._is_lifted = lifts

    def close(self) -> None:
        """Refuse further commands. May be called twice."""
        self.is_closed = True

    def _advance(self, steps: int) -> None:
        while steps:
            count = min(steps, self._steps_at_once)
            self._plant.step(count)
            self._step += count
            steps -= count
            if self._keys is not None:
                self.hardest_touch = hardest_touch(self._keys, self.model, self.data, self.time, self.hardest_touch)

    def _arrive(self) -> None:
        """Let the command written `command_delay` ago reach the motors, which may answer."""
        if len(self._pending) > self._whole_periods_late:
            self._plant.apply(self._pending.popleft())
            if not self._samples_now:
                self._joint_line.push(self._step, self._joint_sample())

    def _sample(self) -> None:
        self._body_line.push(self._step, self._body_sample())
        if self._samples_now:
            self._joint_line.push(self._step, self._joint_sample())

    def _body_sample(self) -> BodySample:
        return self._sensors.read(self.data, self.acceleration)

    def _joint_sample(self) -> _JointSample:
        return self._plant.position.copy(), self._plant.velocity.copy(), self._plant.effort.copy()
