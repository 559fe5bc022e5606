"""State and command of a robot's joints, and between the two the MIT control law and its limit.

Simulator, emulated motors and real motors share these types and this law. Arrays are read-only copies; change a value
with `dataclasses.replace`. Every per-joint array is `(..., n)`: one robot, or a batch of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import FieldError

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
IndexArray = npt.NDArray[np.intp]

_FLOAT64 = np.dtype(np.float64)
COMMAND_FIELDS = ("position", "velocity", "effort", "stiffness", "damping")  # in their frozen order


def frozen_array(owner: str, name: str, value: npt.ArrayLike) -> FloatArray:
    """Return a read-only float64 copy of `value`, shape unchanged; raises `FieldError` if it holds no numbers."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise FieldError(f"{owner}.{name}: is no array of numbers: {error}") from None
    array.setflags(write=False)
    return array


def _freeze(instance: object, shape: tuple[int, ...], *names: str) -> None:
    """Make fields read-only float64 arrays, all of one shape: copies, unless they are such and own their data."""
    for name in names:
        array = getattr(instance, name)
        is_plain = type(array) is np.ndarray and array.dtype is _FLOAT64
        if not is_plain or (flags := array.flags).writeable or not flags.owndata:
            array = array.copy() if is_plain else np.array(array, dtype=np.float64)  # a third of the time
            array.setflags(write=False)
            object.__setattr__(instance, name, array)
        if array.shape != shape:
            raise FieldError(f"{type(instance).__name__}.{name}: shape is {array.shape}, expected {shape}")


@dataclass(frozen=True, slots=True, eq=False)
class Extern:
    """A named live input that is not a joint state: pressed piano keys, a velocity command."""

    value: FloatArray  # shape (k,), in the term's own unit
    arrival_time: float  # s, robot's clock, when the value was received
    timeout: float = float("inf")  # s after `arrival_time` from which the value counts as zero

    def __post_init__(self) -> None:
        _freeze(self, np.shape(self.value), "value")

    def at(self, time: float | FloatArray) -> FloatArray:
        """Return the value, shape (k,), or zeros where it is not fresh: (..., k) for clocks of shape (...), in s."""
        return np.where(self.is_fresh(time)[..., None], self.value, 0.0)

    def is_fresh(self, time: float | FloatArray) -> BoolArray:
        """Return whether the value is not older than `timeout` at `time`, s, shape (...); False for no number."""
        with np.errstate(invalid="ignore"):  # infinity - infinity is not a number, and so is that age
            return np.asarray(np.maximum(np.subtract(time, self.arrival_time), 0.0) <= self.timeout)


# Names of live inputs:
VELOCITY_COMMAND = "velocity_command"  # vx, vy in m/s and yaw rate in rad/s, heading frame
BASE_LINEAR_VELOCITY = "base_linear_velocity"  # m/s, world frame; ground truth in simulation, or an estimator's
ANCHOR_POSE = "anchor_pose"  # x, y, z in m and w, x, y, z of the contract's anchor body, world frame
ANCHOR_ORIENTATION = "anchor_orientation"  # w, x, y, z of it, of a robot that does not know its position
KEY_PRESSED = "key_pressed"  # 1 for each of a piano's keys that is down, else 0, the lowest key first
HEIGHT_SCAN = "height_scan"  # m, height of a body above the ground at each point of a grid, as the policy's term has it
EXTERN_WIDTHS: Mapping[str, int] = {VELOCITY_COMMAND: 3, BASE_LINEAR_VELOCITY: 3, ANCHOR_POSE: 7}
BASE, IMU = "base", "imu"  # points of a robot by what they are; any other point is named by its site


def point_velocity(point: str) -> str:
    """Return the live input of the velocity of a point, m/s, world frame: the base's origin, the IMU, or a site."""
    return BASE_LINEAR_VELOCITY if point == BASE else f"{BASE_LINEAR_VELOCITY}_at_{point}"


@dataclass(frozen=True, slots=True, eq=False)
class MITState:
    """State that a robot reports at one instant; the layout is frozen, because trained policies depend on it."""

    time: float | FloatArray  # s, robot's clock. Scalar for one robot; shape (...) for a batch whose clocks differ
    joint_position: FloatArray  # shape (..., n), rad, joint frame. NaN: nothing was ever received of this joint
    joint_velocity: FloatArray  # shape (..., n), rad/s, joint frame
    joint_effort: FloatArray  # shape (..., n), N·m, measured or simulated
    joint_age: FloatArray
    """Shape (..., n), s since the joint last reported; a silent joint keeps its last values and ages."""
    imu_quaternion: FloatArray  # shape (..., 4), w x y z, body frame in the world frame
    imu_angular_velocity: FloatArray  # shape (..., 3), rad/s, body frame
    imu_linear_acceleration: FloatArray
    """Shape (..., 3), m/s², body frame, gravity included: (0, 0, +9.81) at rest and upright."""
    extern: Mapping[str, Extern] = field(default_factory=dict)  # named live arrays with their arrival time and timeout

    def __post_init__(self) -> None:
        shape = np.shape(self.joint_position)
        batch = shape[:-1]
        _freeze(self, shape, "joint_position", "joint_velocity", "joint_effort", "joint_age")
        _freeze(self, (*batch, 4), "imu_quaternion")
        _freeze(self, (*batch, 3), "imu_angular_velocity", "imu_linear_acceleration")
        if type(self.time) is not float:
            time = frozen_array("MITState", "time", self.time)
            if time.ndim and time.shape != batch:
                raise FieldError(f"MITState.time: shape is {time.shape}, expected () or {batch}")
            object.__setattr__(self, "time", time if time.ndim else float(time))

    @property
    def joint_count(self) -> int:
        return int(self.joint_position.shape[-1])

    @classmethod
    def unknown(cls, joint_count: int, time: float = 0.0) -> Self:
        """Return the state before anything was received: NaN positions, infinite age, an upright IMU at rest."""
        zeros = np.zeros(joint_count)
        return cls(
            time=time,
            joint_position=np.full(joint_count, np.nan),
            joint_velocity=zeros,
            joint_effort=zeros,
            joint_age=np.full(joint_count, np.inf),
            imu_quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
            imu_angular_velocity=np.zeros(3),
            imu_linear_acceleration=np.array([0.0, 0.0, 9.81]),
        )


@dataclass(frozen=True, slots=True, eq=False)
class MITCommand:
    """A controller's command to every joint, every tick. Field names and order are frozen."""

    position: FloatArray  # shape (..., n), rad, joint frame
    velocity: FloatArray  # shape (..., n), rad/s, joint frame
    effort: FloatArray  # shape (..., n), N·m, feed-forward
    stiffness: FloatArray  # shape (..., n), N·m/rad, K_p
    damping: FloatArray  # shape (..., n), N·m·s/rad, K_d

    def __post_init__(self) -> None:
        _freeze(self, np.shape(self.position), *COMMAND_FIELDS)

    @property
    def joint_count(self) -> int:
        return int(self.position.shape[-1])

    @classmethod
    def zeros(cls, *shape: int) -> Self:
        """Return a command of zeros in every field, shape (..., n)."""
        zeros = np.zeros(shape)
        return cls(zeros, zeros, zeros, zeros, zeros)

    def is_finite(self) -> bool:
        return all(bool(np.isfinite(getattr(self, name)).all()) for name in COMMAND_FIELDS)


def mit_torque(
    command: MITCommand, position: FloatArray, velocity: FloatArray, effort_limit: npt.ArrayLike
) -> FloatArray:
    """Return N·m, (..., n), of the MIT law: `clip(K_p (q_cmd - q) + K_d (qd_cmd - qd) + tau_ff, ±effort_limit)`.

    `position` in rad and `velocity` in rad/s are those of the joints, shape (..., n); the limit is positive, infinite
    for none. The same law runs in the motors' firmware (Katz 2018, "A low cost modular actuator for dynamic robots").
    """
    torque = command.stiffness * (command.position - position) + command.damping * (command.velocity - velocity)
    torque += command.effort
    return np.maximum(np.minimum(torque, effort_limit), np.negative(effort_limit))


def bind_torque(
    command: MITCommand, position: FloatArray, velocity: FloatArray, effort_limit: FloatArray, out: FloatArray
) -> Callable[[], None]:
    """Return a function that writes `mit_torque` of what `position` and `velocity` then hold into `out`: all (n,).

    For many physics steps under one command: nothing is allocated, and where the command asks for no velocity or no
    effort these are left out, which changes no bit.
    """
    goal, speed, effort = command.position, command.velocity, command.effort
    stiffness, damping = command.stiffness, command.damping
    moves, pushes = np.count_nonzero(speed) > 0, np.count_nonzero(effort) > 0
    lowest, term = -effort_limit, np.empty_like(out)
    subtract, multiply, add, minimum, maximum = np.subtract, np.multiply, np.add, np.minimum, np.maximum

    def update() -> None:
        subtract(goal, position, out)
        multiply(stiffness, out, out)
        if moves:
            subtract(speed, velocity, term)
            multiply(damping, term, term)
            add(out, term, out)
        else:
            multiply(damping, velocity, term)
            subtract(out, term, out)
        if pushes:
            add(out, effort, out)
        minimum(out, effort_limit, out=out)
        maximum(out, lowest, out=out)

    return update


def bounded_position(
    command: MITCommand, position: FloatArray, velocity: FloatArray, effort_limit: FloatArray, lead: float
) -> FloatArray:
    """Return commanded positions, (n,) rad, moved towards the joints where the law asks for more than the effort limit.

    No manual says that the firmware's torque limit covers the sum of the MIT law, so the host bounds it as well. What
    it knows is as old as the last status and holds for a period, together `lead` in s: K_p |velocity| lead of room
    keeps a joint on its way from being slowed down. A `position` of NaN has no bound. Where damping and feed-forward
    are beyond the limit by themselves, at most the spring's part is removed; it never changes sign.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # no stiffness, no position, absurd commands
        spring = command.stiffness * (command.position - position)
        rest = command.damping * (command.velocity - velocity) + command.effort
        room = command.stiffness * np.abs(velocity) * lead
        lowest = np.minimum(-effort_limit - rest - room, 0.0)
        highest = np.maximum(effort_limit - rest + room, 0.0)
        bounded = np.clip(spring, lowest, highest)
        moved = position + bounded / command.stiffness
    return np.where((bounded != spring) & np.isfinite(moved), moved, command.position)
