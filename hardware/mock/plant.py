"""The robot that mock motors move: MuJoCo under the motors' torques, seen from their shafts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from humanoid_sim.errors import InputError, require_known
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import JointDescription, RobotDescription
from humanoid_sim.simulation import DROP
from humanoid_sim.simulation.floating_base import FloatingBase, move_support
from humanoid_sim.simulation.plant import make_plant
from humanoid_sim.simulation.sensors import BodySensors, ImuSample

_JAM = 1e4
"""N·m·s/rad of a jammed joint: damping is integrated implicitly, and MuJoCo's friction slips."""
_HAND_STIFFNESS, _HAND_DAMPING, _HAND_STRENGTH = 150.0, 4.0, 40.0
"""N·m/rad, N·m·s/rad and N·m with which a hand leads a joint."""


@dataclass(frozen=True, slots=True, eq=False)
class PlantTruth:
    """True state at one instant, as no motor or bus changes it."""

    time: float
    """s, on the clock of its reader."""
    joint_position: FloatArray
    """Shape (n,), rad, joint frame, in the description's order."""
    joint_velocity: FloatArray
    """Shape (n,), rad/s, joint frame."""
    joint_effort: FloatArray
    """Shape (n,), N·m, joint frame: the motors' torque in the latest physics step."""
    qpos: FloatArray
    """Shape (nq,), MuJoCo's generalised position."""
    imu: ImuSample
    live: Mapping[str, FloatArray]
    """Live inputs by name, see `BodySensors`."""


class MotorPlant:
    """The robot's dynamics. Motor arrays are shape (m,), motor frame, one motor per driven joint in order.

    `shaft = direction · joint + homing_offset`; turns and zeros are the motors' own. Other joints are passive.
    """

    def __init__(self, description: RobotDescription, homing_offset: Mapping[str, float]) -> None:
        """Build the model, at rest in its initial position; a floating base is held by its support.

        Args:
            homing_offset: rad, motor frame, by joint: the shaft's angle where the joint is at 0; else 0.
        """
        self._plant = plant = make_plant(description)
        self.description = description
        driven = [(i, joint) for i, joint in enumerate(description.joints) if joint.motor is not None]
        if not driven:
            raise InputError(f"{description.name}: no joint has a motor")
        self.joints: tuple[JointDescription, ...] = tuple(joint for _, joint in driven)
        """The driven joints, one per motor."""
        self.names = [joint.name for joint in self.joints]
        require_known("joint", homing_offset, self.names, "homing_offset: ")
        self._driven = [i for i, _ in driven]
        self._qpos_index = plant.addresses.qpos[self._driven]
        self._dof_index = plant.addresses.dof[self._driven]
        self._direction = np.array([float(joint.motor.direction) for joint in self.joints if joint.motor is not None])
        self._strength = self._direction * description.torque_scale[self._driven]
        """Torque at the joint over the torque that the motor reports."""
        self.delay = description.delay[self._driven]
        """Shape (m,), s from a command's arrival to its effect."""
        self._offset = np.array([homing_offset.get(name, 0.0) for name in self.names])
        self._base: FloatingBase | None = None
        self._is_lifted = False
        if description.is_floating:
            self._base = FloatingBase(plant.model, description, plant.data.qpos, yaw=0.0, height=None, drop=DROP)
            self._base.place(plant.data)
            self._base.hold(plant.data)
        self._senses = BodySensors(plant.model, description, "")
        self._damping = plant.model.dof_damping.copy()
        self._hand: FloatArray | None = None
        """Shape (m,), rad, joint frame: where a hand leads each joint; NaN: nowhere."""
        self.timestep = float(plant.model.opt.timestep)
        """s, of one physics step."""
        self.torque, self.shaft, self.velocity = np.zeros((3, len(self.names)))
        """N·m of the latest physics step, rad and rad/s now; buffers."""
        self._sense()

    def step(self, torque: FloatArray) -> None:
        """Advance physics by one step under the motors' torques, shape (m,), N·m."""
        data = self._plant.data
        self.torque[:] = torque
        joint_torque = self._strength * torque
        if self._hand is not None:
            pull = _HAND_STIFFNESS * (self._hand - data.qpos[self._qpos_index])
            pull -= _HAND_DAMPING * data.qvel[self._dof_index]
            joint_torque += np.nan_to_num(np.clip(pull, -_HAND_STRENGTH, _HAND_STRENGTH), nan=0.0)
        data.qfrc_applied[self._dof_index] = joint_torque
        if self._is_lifted and self._base is not None:
            self._base.lift(data, self.timestep)
        self._plant.physics_step()
        self._sense()

    def fault(self) -> str:
        """Return why the simulation is not sound; empty if it is."""
        return self._plant.fault()

    def jam(self, motor: int, jammed: bool) -> None:
        """Block a motor's joint where it is, or free it."""
        dof = self._dof_index[motor]
        self._plant.model.dof_damping[dof] = _JAM if jammed else self._damping[dof]

    def lead(self, positions: Mapping[str, float] | None) -> None:
        """Lead driven joints by hand towards positions, rad, joint frame, whatever the motors do; None: let go."""
        self._hand = None
        if positions is not None:
            require_known("joint", positions, self.names)
            self._hand = np.array([positions.get(name, np.nan) for name in self.names])

    def set_support(self, held: bool, *, lifts: bool = False) -> None:
        """Hold a floating base where it is, raising it slowly to its start if it `lifts`, or let it go."""
        move_support(self._base, self._plant.data, held, self.description.name)
        self._is_lifted = lifts

    @property
    def supported(self) -> bool:
        """True while the support holds a floating base."""
        return self._base is not None and self._base.is_held(self._plant.data)

    def truth(self, time: float) -> PlantTruth:
        """Return a snapshot, stamped with `time`."""
        plant = self._plant
        effort = np.zeros(self.description.joint_count)
        effort[self._driven] = self._strength * self.torque
        body = self._senses.read(plant.data, plant.acceleration)
        state = plant.position.copy(), plant.velocity.copy(), effort, plant.data.qpos.copy()
        return PlantTruth(time, *state, body.imu, body.live)

    def _sense(self) -> None:
        data = self._plant.data
        self.shaft[:] = self._direction * data.qpos[self._qpos_index] + self._offset
        self.velocity[:] = self._direction * data.qvel[self._dof_index]
