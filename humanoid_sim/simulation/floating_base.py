"""A base that moves freely: where it starts, the support that may hold it, and how it moves."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import mujoco
import numpy as np

from humanoid_sim.controllers.rotation import gravity_direction, heading, multiply, rotate, rotate_inverse
from humanoid_sim.errors import RobotError
from humanoid_sim.messages import Mode
from humanoid_sim.mit import BASE_LINEAR_VELOCITY, FloatArray, MITState
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.model import SUPPORT, joint_addresses
from humanoid_sim.simulation.stance import Floor, clearance

_LIFT_SPEED = 0.1  # m/s, of a support that lifts the base


@dataclass(frozen=True, slots=True, eq=False)
class BaseState:
    """Pose and motion of one floating base or a batch: the origin and the axes of its MJCF body."""

    position: FloatArray  # shape (..., 3), m, world frame
    quaternion: FloatArray  # shape (..., 4), w x y z, base frame in the world frame
    linear_velocity: FloatArray  # shape (..., 3), m/s, world frame
    angular_velocity: FloatArray  # shape (..., 3), rad/s, base frame
    centre_of_mass: FloatArray  # shape (..., 3), m, world frame, of the whole robot
    floor: FloatArray  # shape (...), m, world frame: level of the floor under the centre of mass
    up: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    """Shape (3,), base frame: the axis that points up where the robot stands."""

    @property
    def height(self) -> FloatArray:
        """Shape (...), m, of the base's origin above the floor."""
        return np.asarray(self.position[..., 2] - self.floor)

    @property
    def mass_height(self) -> FloatArray:
        """Shape (...), m, of the centre of mass above the floor."""
        return np.asarray(self.centre_of_mass[..., 2] - self.floor)

    @property
    def gravity(self) -> FloatArray:
        """Shape (..., 3), direction of gravity in the base frame; (0, 0, -1) upright."""
        return gravity_direction(self.quaternion)

    @property
    def tilt(self) -> FloatArray:
        """Shape (...), rad, between the axis that points up where the robot stands and the vertical, 0 to π."""
        gravity = self.gravity
        along = gravity[..., 0] * self.up[0] + gravity[..., 1] * self.up[1] + gravity[..., 2] * self.up[2]
        return np.asarray(np.arccos(np.clip(-along, -1.0, 1.0)))

    @property
    def yaw(self) -> FloatArray:
        """Shape (...), rad, heading: of the base's x axis in the horizontal plane, -π to π."""
        return heading(self.quaternion)

    @property
    def planar_velocity(self) -> FloatArray:
        """Shape (..., 3): m/s forward and to the left of the heading, and rad/s about the vertical."""
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        vx, vy = self.linear_velocity[..., 0], self.linear_velocity[..., 1]
        yaw_rate = rotate(self.quaternion, self.angular_velocity)[..., 2]
        return np.stack([cos * vx + sin * vy, cos * vy - sin * vx, yaw_rate], axis=-1)


def base_addresses(model: mujoco.MjModel, description: RobotDescription) -> tuple[slice, slice, slice, slice]:
    """Return the addresses of a floating base in MuJoCo's arrays.

    Position and orientation in `qpos`, m and w x y z, world frame; in `qvel` linear velocity, m/s, world frame, and
    angular velocity, rad/s, base frame.
    """
    joint = int(model.body_jntadr[model.body(description.base.body).id])
    q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
    return slice(q, q + 3), slice(q + 3, q + 7), slice(v, v + 3), slice(v + 3, v + 6)


class BaseObserver:
    """Observes a robot's floating base, its centre of mass and the floor under it. Not thread-safe."""

    def __init__(self, model: mujoco.MjModel, description: RobotDescription) -> None:
        self._position, self._quaternion, self._linear, self._angular = base_addresses(model, description)
        self._model, self._data, self._body = model, mujoco.MjData(model), model.body(description.base.body).id
        self._floor = Floor(model)
        self._up = -gravity_direction(model.qpos0[self._quaternion])  # not every base stands on its z axis

    def _mass(self, qpos: FloatArray) -> FloatArray:
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        position: FloatArray = self._data.subtree_com[self._body].copy()
        return position

    def at(self, qpos: FloatArray, qvel: FloatArray, centre_of_mass: FloatArray) -> BaseState:
        """Return the base at MuJoCo's generalised position (..., nq) and velocity (..., nv).

        `centre_of_mass`, shape (..., 3), m, world frame, is of the whole robot.
        """
        quaternion = qpos[..., self._quaternion]
        return BaseState(
            position=qpos[..., self._position].copy(),
            quaternion=quaternion / np.sqrt((quaternion * quaternion).sum(axis=-1, keepdims=True)),
            linear_velocity=qvel[..., self._linear].copy(),
            angular_velocity=qvel[..., self._angular].copy(),
            centre_of_mass=centre_of_mass,
            floor=self._floor.level(centre_of_mass),
            up=self._up,
        )

    def sensed(self, state: MITState, qpos: FloatArray) -> BaseState:
        """Return the base of one simulated robot at `qpos`, (nq,), with the velocities that its sensors measure."""
        base, turning = self.at(qpos, np.zeros(self._model.nv), self._mass(qpos)), state.imu_angular_velocity
        moving = state.extern[BASE_LINEAR_VELOCITY].value
        turning = rotate_inverse(base.quaternion, rotate(state.imu_quaternion, turning))
        return replace(base, linear_velocity=moving, angular_velocity=turning)

    def standing_height(self, qpos: FloatArray) -> float:
        """Return m from the floor to the centre of mass if the robot stood in this pose, shape (nq,)."""
        mass = self._mass(qpos)
        return float(mass[2] - self._floor.level(mass)) - clearance(self._model, qpos)


class Support:
    """Where a floating base starts, and what may hold it; inert where the base is fixed. Of `build_model`'s models."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, description: RobotDescription, drop: float = 0.0
    ) -> None:
        """Choose the start, at the description's height or `drop`, m, above the feet; `data` has the joints' pose."""
        self._robot, self._data, self._is_floating = description.name, data, description.is_floating
        self._can_lift, self._is_lifted = drop > 0.0, False
        if not self._is_floating:
            return
        position, quaternion, *_ = base_addresses(model, description)
        self._pose = slice(position.start, quaternion.stop)
        self._mocap = int(model.body(SUPPORT).mocapid[0])
        self._weld = model.equality(SUPPORT).id
        qpos = np.array(data.qpos)
        qpos[self._pose] = model.qpos0[self._pose]
        qpos[self._pose][:2] = 0.0
        if description.base.height is None:
            qpos[self._pose][2] += drop - clearance(model, qpos)
        else:
            qpos[self._pose][2] = description.base.height
        self._start = qpos[self._pose]

    @property
    def holds(self) -> bool:
        return self._is_floating and bool(self._data.eq_active[self._weld])

    def start(self, *, held: bool) -> None:
        """Put the base of a robot at rest where it starts, held or not."""
        self._is_lifted = False
        if self._is_floating:
            self._data.qpos[self._pose] = self._start
            self.move(held)

    def move(self, held: bool, *, lifts: bool = False) -> None:
        """Hold the base where it now is, or let it go. If it `lifts`, `advance` raises it to the height of its start.

        Never without a `drop`. Raises `RobotError` if the base is fixed.
        """
        if not self._is_floating:
            raise RobotError(f"{self._robot}: has a fixed base, which needs no support")
        self._is_lifted = lifts and self._can_lift
        if held and not self.holds:
            pose = self._data.qpos[self._pose]
            self._data.mocap_pos[self._mocap], self._data.mocap_quat[self._mocap] = pose[:3], pose[3:]
        self._data.eq_active[self._weld] = held

    def advance(self, time: float) -> None:
        """Raise a base that it lifts for `time`, s, slowly."""
        if self._is_lifted and self.holds:
            position = self._data.mocap_pos[self._mocap]
            position[2] = max(position[2], min(position[2] + _LIFT_SPEED * time, self._start[2]))


class Supported(Protocol):
    """A robot whose floating base may hang on a support."""

    @property
    def supported(self) -> bool: ...

    def set_support(self, held: bool, *, lifts: bool = False) -> None: ...


def support_in_mode(robot: Supported, mode: Mode) -> str:
    """Release the robot when a policy takes over, hold it when none balances it; returns what changed, if anything.

    In STANDBY it is lifted back to where it hung at the start, so that it starts again as it did first.
    """
    held, was_held = not mode.is_free, robot.supported
    robot.set_support(held, lifts=mode is Mode.STANDBY)
    if held == was_held:
        return ""
    return "support holds the base where it is" if held else "support released"


class StartPose:
    """A robot that stands on its feet, or hangs on its fixed base, in MuJoCo's arrays."""

    def __init__(self, model: mujoco.MjModel, description: RobotDescription) -> None:
        """Find the description's own start; the model is from `build_model`."""
        data = mujoco.MjData(model)
        data.qpos[joint_addresses(model, description.joint_names).qpos] = description.initial_position
        Support(model, data, description).start(held=False)
        self._qpos: FloatArray = data.qpos.copy()
        self._quaternion: slice | None = None
        self.standing_height = 0.0  # m, of the centre of mass above the floor; 0 for a fixed base
        if description.is_floating:
            self._quaternion = base_addresses(model, description)[1]
            self.standing_height = BaseObserver(model, description).standing_height(self._qpos)

    def qpos(self, batch: tuple[int, ...] = (), yaw: FloatArray | None = None) -> FloatArray:
        """Return MuJoCo's generalised position (..., nq) for a `batch` of (...).

        `yaw`, (...), rad, turns a floating base about the vertical.
        """
        qpos = np.broadcast_to(self._qpos, (*batch, len(self._qpos))).copy()
        if yaw is not None and self._quaternion is not None:
            half, none = 0.5 * yaw, np.zeros(batch)
            turn = np.stack([np.cos(half), none, none, np.sin(half)], axis=-1)
            qpos[..., self._quaternion] = multiply(turn, self._qpos[self._quaternion])
        return qpos
