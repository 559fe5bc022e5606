"""The robot that emulated motors move: MuJoCo under the torque of every motor, and what a motor can feel of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from humanoid_sim.errors import InputError, known_names, require_known
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.schema import JointDescription
from humanoid_sim.simulation import DROP
from humanoid_sim.simulation.floating_base import FloatingBase, move_support
from humanoid_sim.simulation.plant import make_plant
from humanoid_sim.simulation.sensors import BodySensors, ImuSample

_JAM = 1e4
"""N·m·s/rad of a jammed joint, which then creeps by mrad per second at most. Dry friction would be a soft
constraint in MuJoCo, and slip; viscous damping is integrated implicitly, and so cannot make the simulation unstable."""
_HAND_STIFFNESS = 150.0
"""N·m/rad with which a hand leads a joint."""
_HAND_DAMPING = 4.0
"""N·m·s/rad"""
_HAND_STRENGTH = 40.0
"""N·m"""


@dataclass(frozen=True, slots=True, eq=False)
class PlantTruth:
    """True state at one instant, untouched by any motor or bus."""

    time: float
    """s, on the clock of whoever publishes it: the emulator's own, or that of its host."""
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
    """Live inputs that only a simulation or an estimator knows, by name; see `BodySensors`."""


class MotorPlant:
    """The robot's dynamics; motor arrays are shape (m,), in the motor frame, one motor per driven joint in order.

    The motor frame is that of a motor's shaft as the robot is assembled: `shaft = direction · joint + homing_offset`.
    What a motor makes of its shaft's angle (turns, zero) is the firmware's. Joints without a motor stay passive.
    Not thread-safe.
    """

    def __init__(self, description: RobotDescription, settings: EmulationSettings) -> None:
        """Build the model, at rest in its initial position; an `InputError` if motors, offsets or MJCF do not fit."""
        plant = make_plant(description, physics_timestep=settings.physics_timestep)
        self._plant = plant
        self.description = description
        driven = [(i, joint) for i, joint in enumerate(description.joints) if joint.motor is not None]
        if not driven:
            raise InputError(f"{description.name}: no joint has a motor, so there is nothing to emulate")
        self.joints: tuple[JointDescription, ...] = tuple(joint for _, joint in driven)
        """The driven joints, one per motor."""
        names = [joint.name for joint in self.joints]
        offsets = settings.homing_offset
        require_known("joint", offsets, names, "homing_offset: ")
        self._driven = [i for i, _ in driven]
        self._qpos_index = plant.addresses.qpos[self._driven]
        self._dof_index = plant.addresses.dof[self._driven]
        self._direction = np.array([float(joint.motor.direction) for joint in self.joints if joint.motor is not None])
        self._strength = self._direction * description.torque_scale[self._driven]
        """Torque at the joint over the motor's own, which is what the motor reports."""
        self.delay = description.delay[self._driven]
        """Shape (m,), s from a command's arrival to its effect."""
        self._offset = np.array([offsets.get(name, 0.0) for name in names])
        self._base: FloatingBase | None = None
        self._is_lifted = False
        if description.is_floating:
            self._base = FloatingBase(
                plant.model,
                description,
                plant.data.qpos,
                yaw=settings.base_yaw,
                height=settings.base_height,
                drop=DROP if settings.support else 0.0,
            )
            self._base.place(plant.data)
            if settings.support:
                self._base.hold(plant.data)
        self._senses = BodySensors(plant.model, description, settings.anchor_body)
        self._damping = plant.model.dof_damping.copy()
        self._hand: FloatArray | None = None
        """Shape (m,), rad, joint frame: where a hand leads each joint; NaN for those that it leaves alone."""
        self.timestep = float(plant.model.opt.timestep)
        """s, of one physics step."""
        self.torque = np.zeros(len(names))
        """Shape (m,), N·m, motor frame: of the latest physics step. A buffer: copy it to keep it."""
        self.shaft = np.empty(len(names))
        """Shape (m,), rad, motor frame: the present angle of each shaft. A buffer."""
        self.velocity = np.empty(len(names))
        """Shape (m,), rad/s, motor frame. A buffer."""
        self._sense()

    def step(self, torque: FloatArray) -> None:
        """Advance physics by one step under these torques, shape (m,), N·m, motor frame."""
        data = self._plant.data
        self.torque[:] = torque
        joint_torque = self._strength * torque
        if self._hand is not None:
            joint_torque += self._hand_torque(self._hand)
        data.qfrc_applied[self._dof_index] = joint_torque
        if self._is_lifted and self._base is not None:
            self._base.lift(data, self.timestep)
        self._plant.physics_step()
        self._sense()

    def fault(self) -> str:
        """Return what is wrong with the simulation; empty if it is sound."""
        return self._plant.fault()

    def jam(self, motor: int, jammed: bool) -> None:
        """Block a motor's joint where it is, or free it."""
        dof = self._dof_index[motor]
        self._plant.model.dof_damping[dof] = _JAM if jammed else self._damping[dof]

    def lead(self, positions: Mapping[str, float] | None) -> None:
        """Let a hand lead driven joints towards positions, rad, joint frame, whatever the motors do; None: let go."""
        if positions is None:
            self._hand = None
            return
        names = [joint.name for joint in self.joints]
        hand = np.full(len(names), np.nan)
        for name, position in positions.items():
            if name not in names:
                raise InputError(known_names("joint", name, names))
            hand[names.index(name)] = position
        self._hand = hand

    def set_support(self, held: bool, *, lifts: bool = False) -> None:
        """Hold a floating base where it now is, and raise it slowly to its start if it `lifts`, or let it go.

        Raises `RobotError` if the base is fixed.
        """
        move_support(self._base, self._plant.data, held, self.description.name)
        self._is_lifted = lifts

    @property
    def supported(self) -> bool:
        """Return whether the support holds a floating base."""
        return self._base is not None and self._base.is_held(self._plant.data)

    def truth(self, time: float) -> PlantTruth:
        """Return a snapshot, stamped with `time`."""
        plant = self._plant
        effort = np.zeros(self.description.joint_count)
        effort[self._driven] = self._strength * self.torque
        body = self._senses.read(plant.data, plant.acceleration)
        return PlantTruth(
            time, plant.position.copy(), plant.velocity.copy(), effort, plant.data.qpos.copy(), body.imu, body.live
        )

    def _sense(self) -> None:
        data = self._plant.data
        np.multiply(self._direction, data.qpos[self._qpos_index], out=self.shaft)
        np.add(self.shaft, self._offset, out=self.shaft)
        np.multiply(self._direction, data.qvel[self._dof_index], out=self.velocity)

    def _hand_torque(self, target: FloatArray) -> FloatArray:
        data = self._plant.data
        pull = _HAND_STIFFNESS * (target - data.qpos[self._qpos_index]) - _HAND_DAMPING * data.qvel[self._dof_index]
        led: FloatArray = np.nan_to_num(np.clip(pull, -_HAND_STRENGTH, _HAND_STRENGTH), nan=0.0)
        return led
