"""Start pose of a robot; and a base that moves freely: the support that holds it, and how it moves."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import gravity_direction, heading, multiply, rotate, rotate_inverse
from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.messages import Mode
from humanoid_sim.mit import BASE_LINEAR_VELOCITY, FloatArray, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.stance import CentreOfMass, Floor, clearance, standing_height

if TYPE_CHECKING:
    from humanoid_sim.simulation.model import JointAddresses

_LIFT_SPEED = 0.1
"""m/s, of a support that lifts the base."""

_SUPPORT = "humanoid_sim_support"
"""Name of the mocap body and of the weld: unlikely enough to be free in any user's MJCF."""


@dataclass(frozen=True, slots=True, eq=False)
class BaseState:
    """Pose and motion of one floating base or a batch: the origin and the axes of its MJCF body."""

    position: FloatArray
    """Shape (..., 3), m, world frame."""
    quaternion: FloatArray
    """Shape (..., 4), w x y z, base frame in the world frame."""
    linear_velocity: FloatArray
    """Shape (..., 3), m/s, world frame."""
    angular_velocity: FloatArray
    """Shape (..., 3), rad/s, base frame."""
    centre_of_mass: FloatArray
    """Shape (..., 3), m, world frame, of the whole robot."""
    floor: FloatArray
    """Shape (...), m, world frame: how high the floor is under the centre of mass."""
    up: FloatArray | None = None
    """Shape (3,), base frame: the axis that points up where the robot stands; None for the z axis."""

    @property
    def height(self) -> FloatArray:
        """Shape (...), m, of the base's origin above the floor."""
        height: FloatArray = self.position[..., 2] - self.floor
        return height

    @property
    def mass_height(self) -> FloatArray:
        """Shape (...), m, of the centre of mass above the floor."""
        height: FloatArray = self.centre_of_mass[..., 2] - self.floor
        return height

    @property
    def gravity(self) -> FloatArray:
        """Shape (..., 3), direction of gravity in the base frame; (0, 0, -1) upright."""
        return gravity_direction(self.quaternion)

    @property
    def tilt(self) -> FloatArray:
        """Shape (...), rad, between the axis that points up where the robot stands and the vertical, 0 to π."""
        if self.up is not None:
            gravity = self.gravity
            down = sum((gravity[..., i] * self.up[i] for i in range(3)), start=np.zeros(()))
            turned: FloatArray = np.arccos(np.clip(-down, -1.0, 1.0))
            return turned
        x, y = self.quaternion[..., 1], self.quaternion[..., 2]
        tilt: FloatArray = 2.0 * np.arcsin(np.minimum(np.sqrt(x * x + y * y), 1.0))
        return tilt

    @property
    def yaw(self) -> FloatArray:
        """Shape (...), rad, heading: of the base's x axis in the horizontal plane, -π to π."""
        return heading(self.quaternion)

    @property
    def planar_velocity(self) -> FloatArray:
        """Shape (..., 3), what a velocity command asks for: m/s, forward and to the left of the heading; the yaw rate.

        The frame is turned by `yaw` only. The yaw rate is about the vertical, rad/s.
        """
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        vx, vy = self.linear_velocity[..., 0], self.linear_velocity[..., 1]
        yaw_rate = rotate(self.quaternion, self.angular_velocity)[..., 2]
        return np.stack([cos * vx + sin * vy, cos * vy - sin * vx, yaw_rate], axis=-1)


def add_support(spec: mujoco.MjSpec, body: str) -> None:
    """Add what can hold the base: a weld, at first inactive, to a mocap body that nothing pushes away."""
    spec.worldbody.add_body(name=_SUPPORT, mocap=True)
    spec.add_equality(
        name=_SUPPORT,
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1=_SUPPORT,
        name2=body,
        # Anchor at the origin, no offset between the two frames, torques weighed as forces at 1 m.
        data=[*[0.0] * 6, 1.0, *[0.0] * 3, 1.0, 0.0],
        active=False,
    )


def base_addresses(model: mujoco.MjModel, description: RobotDescription) -> tuple[slice, slice, slice, slice]:
    """Return where a floating base is in MuJoCo's arrays.

    Position and orientation in `qpos`, m and w x y z, world frame; in `qvel` linear velocity, m/s, world frame, and
    angular velocity, rad/s, base frame.
    """
    joint = int(model.body_jntadr[model.body(description.base.body).id])
    q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    return slice(q, q + 3), slice(q + 3, q + 7), slice(v, v + 3), slice(v + 3, v + 6)


class BaseObserver:
    """Sees pose and motion of a robot's floating base, its centre of mass and the floor under it. Not thread-safe."""

    def __init__(self, model: mujoco.MjModel, description: RobotDescription) -> None:
        """Look at a robot in a model made by `build_model`."""
        self._position, self._quaternion, self._linear, self._angular = base_addresses(model, description)
        self._model, self._body = model, description.base.body
        self._floor = Floor(model)
        up = -gravity_direction(model.qpos0[self._quaternion])
        axis = int(np.abs(up).argmax())
        self._up: FloatArray | None = None
        if axis != 2 or up[2] < 0.0:  # not every designer's bases stand on their z axes
            self._up = np.where(np.arange(3) == axis, np.sign(up), 0.0)

    @cached_property
    def _centre_of_mass(self) -> CentreOfMass:
        return CentreOfMass(self._model, self._body)

    def at(self, qpos: FloatArray, qvel: FloatArray | None, centre_of_mass: FloatArray | None = None) -> BaseState:
        """As MuJoCo's generalised position (..., nq) and velocity (..., nv) say, which is None at rest; copies.

        `centre_of_mass`, shape (..., 3), m, world frame, is computed where it is None, for one robot.
        """
        still = np.zeros((*qpos.shape[:-1], 3))
        linear = still if qvel is None else qvel[..., self._linear].copy()
        angular = still if qvel is None else qvel[..., self._angular].copy()
        quaternion = qpos[..., self._quaternion]
        quaternion = quaternion / np.sqrt((quaternion * quaternion).sum(axis=-1, keepdims=True))
        mass = self._centre_of_mass(qpos) if centre_of_mass is None else centre_of_mass
        return BaseState(
            qpos[..., self._position].copy(),
            quaternion,
            linear,
            angular,
            mass,
            self._floor.level(mass),
            self._up,
        )

    def sensed(self, state: MITState, qpos: FloatArray) -> BaseState:
        """Return the base of one simulated robot, with the velocities that its sensors measure; `qpos` as for `at`."""
        base, turning = self.at(qpos, None), rotate(state.imu_quaternion, state.imu_angular_velocity)
        moving = state.extern[BASE_LINEAR_VELOCITY].value
        return replace(base, linear_velocity=moving, angular_velocity=rotate_inverse(base.quaternion, turning))

    def standing_height(self, qpos: FloatArray) -> float:
        """m, of the centre of mass above the floor if the robot stood in this pose, shape (nq,)."""
        return standing_height(self._model, self._body, qpos)


class FloatingBase:
    """The free joint of a robot's base in a model made by `build_model`, and the support that may hold it."""

    def __init__(
        self,
        model: mujoco.MjModel,
        description: RobotDescription,
        joint_qpos: FloatArray,
        *,
        position: tuple[float, float] = (0.0, 0.0),
        yaw: float = 0.0,
        height: float | None = None,
        drop: float = 0.0,
    ) -> None:
        """Choose where the base starts. Raises `InputError` if a value is not finite, or `drop` is negative.

        Args:
            model: with the robot and its support.
            description: the robot, with a floating base.
            joint_qpos: shape (nq,), MuJoCo's generalised position with the joints in the initial position.
            position: m, world frame, x and y.
            yaw: rad, about the vertical, on top of the base's orientation in the MJCF.
            height: m, of the base's origin; None for the description's, and if that has none, such that the lowest
                part of the robot is as far above the floor as `drop` says.
            drop: m; a support that lifts the base lifts it back to its start, unless this is 0.
        """
        for name, value in (
            ("base_position[0]", position[0]),
            ("base_position[1]", position[1]),
            ("base_yaw", yaw),
            ("base_height", 0.0 if height is None else height),
        ):
            if not math.isfinite(value):
                raise InputError(f"{name}: is {value}, expected a finite number")
        if not (math.isfinite(drop) and drop >= 0.0):
            raise InputError(f"drop: is {drop}, expected a finite number >= 0")
        self._position, self._quaternion, *_ = base_addresses(model, description)
        self._mocap = int(model.body(_SUPPORT).mocapid[0])
        self._weld = model.equality(_SUPPORT).id
        self._model = model

        turn = np.array([math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)])
        qpos = np.array(joint_qpos)
        self._start = np.empty(7)
        mujoco.mju_mulQuat(self._start[3:], turn, model.qpos0[self._quaternion])
        self._start[:2] = position
        self._start[2] = qpos[self._position][2]
        if height is None:
            height = description.base.height
        if height is None:
            qpos[self._position], qpos[self._quaternion] = self._start[:3], self._start[3:]
            height = float(self._start[2]) - clearance(model, qpos) + drop
        self._start[2] = height
        self._lifts = drop > 0.0

    def place(self, data: mujoco.MjData) -> None:
        """Put the base of data that are at rest where it starts."""
        data.qpos[self._position] = self._start[:3]
        data.qpos[self._quaternion] = self._start[3:]

    def is_held(self, data: mujoco.MjData) -> bool:
        """Return whether the support holds the base."""
        return bool(data.eq_active[self._weld])

    def hold(self, data: mujoco.MjData) -> None:
        """Let the support take the base where it now is."""
        data.mocap_pos[self._mocap] = data.qpos[self._position]
        data.mocap_quat[self._mocap] = data.qpos[self._quaternion]
        data.eq_active[self._weld] = 1

    def release(self, data: mujoco.MjData) -> None:
        """Let the base go."""
        data.eq_active[self._weld] = 0

    def lift(self, data: mujoco.MjData, time: float) -> None:
        """Let the support raise a base that it holds, for `time` s, at most to the height of its start."""
        position = data.mocap_pos[self._mocap]
        if self._lifts and self.is_held(data) and position[2] < self._start[2]:
            position[2] = min(position[2] + _LIFT_SPEED * time, self._start[2])


def move_support(base: FloatingBase | None, data: mujoco.MjData, held: bool, robot: str) -> None:
    """Let the support take a floating base where it now is, or let the base go.

    Raises `RobotError` if the base is fixed.
    """
    if base is None:
        raise RobotError(f"{robot}: has a fixed base, which needs no support")
    if not held:
        base.release(data)
    elif not base.is_held(data):
        base.hold(data)


class Supported(Protocol):
    """A robot whose floating base may hang on a support."""

    @property
    def supported(self) -> bool:
        """Return whether the support holds the base."""

    def set_support(self, held: bool, *, lifts: bool = False) -> None:
        """Let the support take the base where it now is, or let the base go.

        If it `lifts`, it then raises the base, slowly, to the height of its start.
        """


def support_in_mode(robot: Supported, mode: Mode) -> str:
    """Let the robot go when a policy takes over, hold it again when none balances it; says what it did, if anything.

    In STANDBY it is lifted back to where it hung at the start, so that it starts again as it did first.
    """
    held, was_held = not mode.is_free, robot.supported
    robot.set_support(held, lifts=mode is Mode.STANDBY)
    if held == was_held:
        return ""
    return "support holds the base where it is" if held else "support released"


class StartPose:
    """A robot that stands on its feet, or hangs on its fixed base, with its joints anywhere, in MuJoCo's arrays."""

    def __init__(self, model: mujoco.MjModel, description: RobotDescription, joints: JointAddresses) -> None:
        """Find the description's own start; the model is from `build_model`."""
        data = mujoco.MjData(model)
        data.qpos[joints.qpos] = description.initial_position
        self._joints = joints
        self._dof_count = int(model.nv)
        self._base: tuple[slice, slice, slice, slice] | None = None
        self._model, self._base_body = model, description.base.body
        if description.is_floating:
            FloatingBase(model, description, data.qpos).place(data)
            self._base = base_addresses(model, description)
        self._qpos: FloatArray = data.qpos.copy()

    @cached_property
    def standing_height(self) -> float:
        """m, of the centre of mass above the floor; 0 for a fixed base."""
        return 0.0 if self._base is None else standing_height(self._model, self._base_body, self._qpos)

    def arrays(
        self,
        batch: tuple[int, ...] = (),
        /,
        *,
        joint_position: FloatArray | None = None,
        joint_velocity: FloatArray | None = None,
        base_yaw: FloatArray | None = None,
        base_pose: FloatArray | None = None,
        base_velocity: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """MuJoCo's generalised position (..., nq) and velocity (..., nv), new arrays.

        Args:
            batch: what (...) is.
            joint_position: shape (..., n), rad; None for the description's initial position.
            joint_velocity: shape (..., n), rad/s; None for rest.
            base_yaw: shape (...), rad, about the vertical, by which a floating base is turned; None for not at all.
            base_pose: shape (..., 7), m and w x y z, world frame, of a floating base instead; None, or rows of NaN,
                where it stands as above.
            base_velocity: shape (..., 6), m/s, world frame, and rad/s, base frame, where `base_pose` says where it is.
        """
        qpos = np.broadcast_to(self._qpos, (*batch, len(self._qpos))).copy()
        qvel = np.zeros((*batch, self._dof_count))
        if joint_position is not None:
            qpos[..., self._joints.qpos] = joint_position
        if joint_velocity is not None:
            qvel[..., self._joints.dof] = joint_velocity
        if base_yaw is not None and self._base is not None:
            quaternion = self._base[1]
            half, none = 0.5 * np.asarray(base_yaw), np.zeros(batch)
            turn = np.stack([np.cos(half), none, none, np.sin(half)], axis=-1)
            qpos[..., quaternion] = multiply(turn, self._qpos[quaternion])
        if self._base is not None:
            place, orientation, linear, angular = self._base
            if base_pose is not None and base_velocity is not None:
                is_given = np.isfinite(base_pose).all(axis=-1, keepdims=True)
                for array, part, given in (
                    (qpos, place, base_pose[..., :3]),
                    (qpos, orientation, base_pose[..., 3:]),
                    (qvel, linear, base_velocity[..., :3]),
                    (qvel, angular, base_velocity[..., 3:]),
                ):
                    array[..., part] = np.where(is_given, given, array[..., part])
        return qpos, qvel
