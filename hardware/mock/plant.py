"""The robot that mock motors move: MuJoCo under the motors' torques, seen from their shafts."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, RobotError, require_known
from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.robots.schema import JointDescription, RobotDescription
from humanoid_sim.simulation import DROP
from humanoid_sim.simulation.floating_base import FloatingBase, move_support
from humanoid_sim.simulation.model import SimConfig, build_model
from humanoid_sim.simulation.sensing import Sensors

_JAM = 1e4  # N·m·s/rad of a jammed joint: damping is integrated implicitly, and MuJoCo's friction slips
_HAND_STIFFNESS, _HAND_DAMPING, _HAND_STRENGTH = 150.0, 4.0, 40.0
"""N·m/rad, N·m·s/rad and N·m with which a hand leads a joint."""


class MotorPlant:
    """The robot's dynamics. Motor arrays are shape (m,), motor frame, one motor per driven joint in order.

    `shaft = direction · joint + homing_offset`; turns and zeros are the motors' own. Other joints are passive.
    """

    def __init__(self, description: RobotDescription, homing_offset: Mapping[str, float]) -> None:
        """Build the model, at rest in its initial position; a floating base is held by its support.

        Args:
            homing_offset: rad, motor frame, by joint: the shaft's angle where the joint is at 0; else 0.
        """
        config = SimConfig(drop=DROP)
        self.description = description
        driven = [(i, joint) for i, joint in enumerate(description.joints) if joint.motor is not None]
        if not driven:
            raise InputError(f"{description.name}: no joint has a motor")
        self.joints: tuple[JointDescription, ...] = tuple(joint for _, joint in driven)
        """The driven joints, one per motor."""
        self.names = [joint.name for joint in self.joints]
        require_known("joint", homing_offset, self.names, "homing_offset: ")
        self.timestep = config.timestep(description)  # s, of one physics step
        self._model = build_model(description, physics_timestep=self.timestep, sensors=config)
        self._data = mujoco.MjData(self._model)
        self._sensors = Sensors(self._model, description, config)
        self._driven = [i for i, _ in driven]
        self._qpos_index = self._sensors.joints.qpos[self._driven]
        self._dof_index = self._sensors.joints.dof[self._driven]
        self._direction = np.array([float(joint.motor.direction) for joint in self.joints if joint.motor is not None])
        self._strength = self._direction * description.torque_scale[self._driven]
        """Torque at the joint over the torque that the motor reports."""
        self.delay = description.delay[self._driven]  # shape (m,), s from a command's arrival to its effect
        self._offset = np.array([homing_offset.get(name, 0.0) for name in self.names])
        self._damping = self._model.dof_damping.copy()
        self._hand: FloatArray | None = None
        """Shape (m,), rad, joint frame: where a hand leads each joint; NaN: nowhere."""
        self._data.qpos[self._sensors.joints.qpos] = description.initial_position
        self._base: FloatingBase | None = None
        self._is_lifted = False
        if description.is_floating:
            self._base = FloatingBase(self._model, description, self._data.qpos, config.drop)
            self._base.place(self._data)
            self._base.hold(self._data)
        mujoco.mj_forward(self._model, self._data)
        self.torque, self.shaft, self.velocity = np.zeros((3, len(self.names)))
        """N·m of the latest physics step, rad and rad/s now; buffers."""
        self._sense()

    def step(self, torque: FloatArray) -> None:
        """Advance physics by one step under the motors' torques, shape (m,), N·m."""
        data = self._data
        self.torque[:] = torque
        joint_torque = self._strength * torque
        if self._hand is not None:
            pull = _HAND_STIFFNESS * (self._hand - data.qpos[self._qpos_index])
            pull -= _HAND_DAMPING * data.qvel[self._dof_index]
            joint_torque += np.nan_to_num(np.clip(pull, -_HAND_STRENGTH, _HAND_STRENGTH), nan=0.0)
        data.qfrc_applied[self._dof_index] = joint_torque
        if self._is_lifted and self._base is not None:
            self._base.lift(data, self.timestep)
        mujoco.mj_step2(self._model, data)
        mujoco.mj_step1(self._model, data)  # so that the sensors are those of the new state
        self._sense()

    def check(self) -> None:
        """Raise `RobotError` if the simulation is not finite any more."""
        bad = mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC
        if any(self._data.warning[int(kind)].number for kind in bad):
            raise RobotError(f"{self.description.name}: the simulation is unstable (t = {self._data.time:.3f} s)")

    def jam(self, motor: int, jammed: bool) -> None:
        """Block a motor's joint where it is, or free it."""
        dof = self._dof_index[motor]
        self._model.dof_damping[dof] = _JAM if jammed else self._damping[dof]

    def lead(self, positions: Mapping[str, float] | None) -> None:
        """Lead driven joints by hand towards positions, rad, joint frame, whatever the motors do; None: let go."""
        self._hand = None
        if positions is not None:
            require_known("joint", positions, self.names)
            self._hand = np.array([positions.get(name, np.nan) for name in self.names])

    def set_support(self, held: bool, *, lifts: bool = False) -> None:
        """Hold a floating base where it is, raising it slowly to its start if it `lifts`, or let it go."""
        move_support(self._base, self._data, held, self.description.name)
        self._is_lifted = lifts

    @property
    def supported(self) -> bool:
        """True while the support holds a floating base."""
        return self._base is not None and self._base.is_held(self._data)

    @property
    def qpos(self) -> FloatArray:
        """Shape (nq,), a copy of MuJoCo's generalised position."""
        qpos: FloatArray = self._data.qpos.copy()
        return qpos

    def truth(self, time: float) -> MITState:
        """Return the true state, as no motor or bus changes it, stamped with `time`, s."""
        effort = np.zeros(self.description.joint_count)
        effort[self._driven] = self._strength * self.torque
        data = self._data
        return self._sensors.state(time, data.qpos.copy(), data.qvel.copy(), data.sensordata.copy(), effort)

    def _sense(self) -> None:
        self.shaft[:] = self._direction * self._data.qpos[self._qpos_index] + self._offset
        self.velocity[:] = self._direction * self._data.qvel[self._dof_index]
