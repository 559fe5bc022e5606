"""Reports of a batch's robots: their true state, and the same with noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import mujoco
import numpy as np

from humanoid_sim import mit
from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.controllers.rotation import conjugate, multiply, rotate, rotate_inverse, seen_from
from humanoid_sim.mit import Extern, FloatArray, IndexArray, IntArray, MITState, point_velocity
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.simulation.batch.draws import Draws
from humanoid_sim.simulation.batch.physics import BatchPhysics, PhysicalStates, gravity_turns
from humanoid_sim.simulation.floating_base import BaseState
from humanoid_sim.simulation.height_scan import HeightScanner
from humanoid_sim.simulation.keys import PianoKeys
from humanoid_sim.simulation.model import JointAddresses, body_ids, build_model
from humanoid_sim.simulation.sensors import Imu, live_inputs

_SENSOR = mujoco.mjtSensor.__members__
_BASE = "humanoid_sim_base"
"""Name of the base in the model that measures, if the MJCF gives it none."""

_ARMATURE = 2.0**60
"""kg, or kg·m². The robot's own inertia vanishes beside it: a force of `_ARMATURE · qacc` accelerates by `qacc`."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorDifferences:
    """Differences between the sensors of N robots."""

    delay: IntArray
    """Shape (N,), physics steps from a state to its report."""
    joint_position: FloatArray
    """Shape (N, n), rad, too much."""
    turn: FloatArray
    """Shape (N, 4), w x y z, of the IMU as it is mounted in the frame that it should have."""
    angular_velocity: FloatArray
    """Shape (N, 3), rad/s, IMU frame, too much."""
    linear_acceleration: FloatArray
    """Shape (N, 3), m/s², IMU frame, too much."""
    gravity_turn: FloatArray
    """Shape (N, 4), w x y z, world frame, from the vertical to gravity's direction."""

    @classmethod
    def none(cls, count: int, joints: int) -> Self:
        """Those of sensors that are as they should be."""
        straight, nothing = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), np.zeros((count, 3))
        delay = np.zeros(count, dtype=np.int64)
        return cls(delay, np.zeros((count, joints)), straight, nothing, nothing.copy(), straight.copy())

    def draw(self, indices: IndexArray, draws: Draws, timestep: float) -> None:
        """Take over what is drawn for these environments' episodes; `timestep` is of the physics, s."""
        self.delay[indices] = np.rint(draws.ranged("state_delay", indices)[:, 0] / timestep)
        self.joint_position[indices] = draws.symmetric("joint_position_bias", indices)
        self.turn[indices] = _small_turn(draws.symmetric("orientation_bias", indices))
        self.angular_velocity[indices] = draws.symmetric("angular_velocity_bias", indices)
        self.linear_acceleration[indices] = draws.symmetric("linear_acceleration_bias", indices)
        self.gravity_turn[indices] = gravity_turns(draws, indices)


class BatchSensors:
    """Reads joints, IMU, the velocity of floating bases and the poses of bodies, all of states at one instant.

    MuJoCo's sensors are those of a physics step's first state. So a step is taken from that one, in a model that has
    these sensors and that nothing moves but the acceleration of the physics step before.
    """

    def __init__(
        self,
        physics: BatchPhysics,
        description: RobotDescription,
        addresses: JointAddresses,
        draws: Draws,
        *,
        anchor_body: str,
        velocity_at: Sequence[str] = (),
        height_scan: HeightScan | None = None,
        bodies: Sequence[str],
    ) -> None:
        """Build the model that measures, of `bodies` the poses; the rest as `live_inputs` takes it.

        Raises `InputError` if a body is not in the model.
        """
        self._addresses = addresses
        self._draws = draws
        self.differences = SensorDifferences.none(len(physics.time), len(addresses.dof))
        """Differences of the N robots' sensors."""
        self._physics = physics
        self._is_anchored = bool(anchor_body)
        self._keys = PianoKeys(physics.model) if description.piano is not None else None
        self.widths = live_inputs(physics.model, description, anchor_body, velocity_at, height_scan)
        """Names and widths of the live inputs."""
        body_ids(physics.model, bodies)
        fixed = Imu(physics.model, description.imu).constant
        # An accelerometer on what does not move at all measures nothing in MuJoCo, not even gravity.
        self._constant = (
            None
            if fixed is None
            else np.concatenate([fixed.quaternion, fixed.angular_velocity, fixed.linear_acceleration])
        )
        frames = [*bodies, anchor_body] if anchor_body else list(bodies)
        self._body_count = len(bodies)
        self._scan = None if height_scan is None else _BatchScan(physics, description, height_scan)
        scanned = None if self._scan is None else self._scan.site_or_body
        velocity_at = velocity_at if description.is_floating else ()
        self._points = [point_velocity(point) for point in velocity_at]
        sites = [description.imu if point == mit.IMU else point for point in velocity_at]
        self._model = build_model(
            description, scene=False, edit=lambda spec: _add_sensors(spec, description, frames, sites, scanned)
        )
        self._model.dof_armature[:] = _ARMATURE
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        self._data = [mujoco.MjData(self._model) for _ in range(physics.threads)]

    def measure(self, states: PhysicalStates) -> FloatArray:
        """Return what `read` and `poses` take, of states of the N robots; shape (N, …), a new array."""
        return self._physics.measure(self._model, self._data, states.full, _ARMATURE * states.acceleration)

    def read(
        self, states: PhysicalStates, measured: FloatArray, effort: FloatArray, base: BaseState | None
    ) -> MITState:
        """Return the true state of N robots at these states, of which `measured` is what `measure` gave.

        Args:
            effort: shape (N, n), N·m.
            base: pose and motion of floating bases then.
        """
        position = states.qpos[:, self._addresses.qpos]
        live = {}
        if base is not None:
            live[mit.BASE_LINEAR_VELOCITY] = Extern(base.linear_velocity, 0.0)
        if self._is_anchored:
            anchor = 20 + 7 * self._body_count
            live[mit.ANCHOR_POSE] = Extern(measured[:, anchor : anchor + 7], 0.0)
        first = 20 + 7 * (self._body_count + self._is_anchored)
        for i, name in enumerate(self._points):
            live[name] = Extern(measured[:, first + 3 * i : first + 3 * i + 3], 0.0)
        if self._keys is not None:
            live[mit.KEY_PRESSED] = Extern(self._keys.pressed(states.qpos), 0.0)
        if self._scan is not None:
            live[mit.HEIGHT_SCAN] = Extern(self._scan.read(self._physics, measured[:, -7:]), 0.0)
        imu = measured[:, :10]
        if self._constant is not None:
            imu = np.broadcast_to(self._constant, imu.shape)
        orientation, acceleration = _as_from_matrix(imu[:, :4]), imu[:, 7:10]
        if self._draws.randomisation.has("gravity_tilt"):
            orientation, acceleration = self._felt(orientation, acceleration)
        return MITState(
            time=states.time,
            joint_position=position,
            joint_velocity=states.qvel[:, self._addresses.dof],
            joint_effort=effort,
            joint_age=np.zeros_like(position),
            imu_quaternion=orientation,
            imu_angular_velocity=imu[:, 4:7],
            imu_linear_acceleration=acceleration,
            extern=live,
        )

    def _felt(self, orientation: FloatArray, acceleration: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what an IMU makes of gravity that does not point down: it knows the vertical from nothing else."""
        gravity, turn = np.array(self._physics.model.opt.gravity), self.differences.gravity_turn
        acceleration = acceleration + rotate_inverse(orientation, gravity - rotate(turn, gravity))
        return _as_from_matrix(multiply(conjugate(turn), orientation)), acceleration

    def poses(self, measured: FloatArray, *, in_base: bool) -> tuple[FloatArray, FloatArray]:
        """Positions (N, b, 3), m, and quaternions (N, b, 4), w x y z, of the bodies, in the world or in the base."""
        base = measured[:, 13:20]
        poses = measured[:, 20 : 20 + 7 * self._body_count].reshape(len(measured), self._body_count, 7)
        position, quaternion = poses[..., :3], poses[..., 3:]
        if in_base:
            return seen_from(base[:, :3], base[:, 3:], position, quaternion)
        return position.copy(), quaternion.copy()

    def centre_of_mass(self, measured: FloatArray) -> FloatArray:
        """Return the whole robot's centre of mass, shape (N, 3), m, world frame; a new array."""
        return measured[:, 10:13].copy()

    def disturb(self, state: MITState, step: IntArray) -> MITState:
        """Return what the sensors make of the true state; `step`, shape (N,), counts reports since each start."""
        own, noise = self.differences, self._draws.randomisation
        if noise.is_biased:
            state = replace(
                state,
                joint_position=state.joint_position + own.joint_position,
                imu_quaternion=multiply(state.imu_quaternion, own.turn),
                imu_angular_velocity=rotate_inverse(own.turn, state.imu_angular_velocity) + own.angular_velocity,
                imu_linear_acceleration=rotate_inverse(own.turn, state.imu_linear_acceleration)
                + own.linear_acceleration,
            )
        if not noise.is_noisy:
            return state
        n = state.joint_count
        drawn = self._draws.normal("noise", step, 2 * n + 9)

        tilt = noise.orientation_noise * drawn[:, 2 * n : 2 * n + 3]
        spin, shake = drawn[:, 2 * n + 3 : 2 * n + 6], drawn[:, 2 * n + 6 :]
        return replace(
            state,
            joint_position=state.joint_position + noise.joint_position_noise * drawn[:, :n],
            joint_velocity=state.joint_velocity + noise.joint_velocity_noise * drawn[:, n : 2 * n],
            imu_quaternion=multiply(state.imu_quaternion, _small_turn(tilt)),
            imu_angular_velocity=state.imu_angular_velocity + noise.angular_velocity_noise * spin,
            imu_linear_acceleration=state.imu_linear_acceleration + noise.linear_acceleration_noise * shake,
        )


class _BatchScan:
    """Height scans of N robots."""

    def __init__(self, physics: BatchPhysics, description: RobotDescription, scan: HeightScan) -> None:
        self._scanner = HeightScanner(physics.model, description, scan)
        self._data = [mujoco.MjData(self._scanner.model) for _ in range(physics.threads)]
        kind, i = self._scanner.frame
        frame = physics.model.site(i) if kind == mujoco.mjtObj.mjOBJ_SITE else physics.model.body(i)
        self.site_or_body = kind, str(frame.name)
        """Kind and name of the frame in the middle of the grid; a base may have no name."""

    def read(self, physics: BatchPhysics, pose: FloatArray) -> FloatArray:
        """Shape (N, rays), m, around poses of shape (N, 7)."""
        resting, spec = np.zeros((len(pose), 1)), mujoco.mjtState
        placed = int(spec.mjSTATE_MOCAP_POS) | int(spec.mjSTATE_MOCAP_QUAT)
        distance = physics.measure(self._scanner.model, self._data, resting, self._scanner.place(pose), placed)
        return self._scanner.heights(distance)


def _small_turn(vector: FloatArray) -> FloatArray:
    """Rotations, shape (k, 4), w x y z, about small rotation vectors (k, 3), rad."""
    turn = np.concatenate([np.ones((len(vector), 1)), 0.5 * vector], axis=1)
    turn /= np.sqrt((turn * turn).sum(axis=1, keepdims=True))
    return turn


def _add_sensors(
    spec: mujoco.MjSpec,
    description: RobotDescription,
    bodies: Sequence[str],
    sites: Sequence[str],
    scanned: tuple[mujoco.mjtObj, str] | None,
) -> None:
    """Add what is measured, in this order.

    IMU: orientation, gyroscope, accelerometer. The centre of mass in the world. Base, then bodies: position and
    orientation in the world. Sites, one of which may be the IMU: velocity in the world. The frame of a height scan:
    position and orientation in the world.
    """
    for sensor in list(spec.sensors):
        spec.delete(sensor)
    imu = description.imu
    if spec.site(imu) is None:
        spec.body(imu).add_site(name=imu)
    for kind in ("FRAMEQUAT", "GYRO", "ACCELEROMETER"):
        spec.add_sensor(type=_SENSOR[f"mjSENS_{kind}"], objtype=mujoco.mjtObj.mjOBJ_SITE, objname=imu)
    base = spec.joint(description.joints[0].name).parent
    while base.parent.name != spec.worldbody.name:
        base = base.parent
    base.name = base.name or _BASE
    whole = description.base.body if description.is_floating else base.name
    spec.add_sensor(type=_SENSOR["mjSENS_SUBTREECOM"], objtype=mujoco.mjtObj.mjOBJ_BODY, objname=whole)
    for name in (base.name, *bodies):
        for kind in ("FRAMEPOS", "FRAMEQUAT"):
            spec.add_sensor(type=_SENSOR[f"mjSENS_{kind}"], objtype=mujoco.mjtObj.mjOBJ_XBODY, objname=name)
    for site in sites:
        spec.add_sensor(type=_SENSOR["mjSENS_FRAMELINVEL"], objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site)
    if scanned is not None:
        for kind in ("FRAMEPOS", "FRAMEQUAT"):
            spec.add_sensor(type=_SENSOR[f"mjSENS_{kind}"], objtype=scanned[0], objname=scanned[1] or base.name)


def _as_from_matrix(quaternion: FloatArray) -> FloatArray:
    """Return the one of a rotation's two quaternions that `mju_mat2Quat` gives, as for one robot; shape (N, 4).

    Its scalar part is positive where the matrix's trace is (|w| > 1/2), otherwise its largest component is.
    """
    w, x, y, z = quaternion.T
    xx, yy, zz = x * x, y * y, z * z
    leading = np.where((xx > yy) & (xx > zz), x, np.where(yy > zz, y, z))
    leading = np.where(4.0 * w * w > 1.0, w, leading)
    return np.where((leading < 0.0)[:, None], -quaternion, quaternion)
