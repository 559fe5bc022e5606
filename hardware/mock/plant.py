"""The robot that mock motors move: MuJoCo under the motors' torques, seen from their shafts."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.simulation import DROP
from humanoid_sim.simulation.floating_base import Support
from humanoid_sim.simulation.model import UNSOUND, SimConfig, build_model
from humanoid_sim.simulation.sensing import Sensors

_JAM = 1e4  # N·m·s/rad of a jammed joint: damping is integrated implicitly, and MuJoCo's friction slips


class MotorPlant:
    """The robot's dynamics. Arrays have shape (m,), motor frame, one motor per joint: motors count their own turns."""

    def __init__(self, description: RobotDescription, homing_offset: Mapping[str, float]) -> None:
        """Build the model, at rest in its initial position; a floating base is held by its support.

        `homing_offset`: rad, motor frame, by joint: the shaft's angle where the joint is at 0; else 0.
        """
        config = SimConfig(drop=DROP)
        self.description = description
        self.motors = [joint.motor for joint in description.joints if joint.motor is not None]
        if len(self.motors) < description.joint_count:
            raise InputError(f"{description.name}: not every joint has a motor")
        self.timestep = config.timestep(description)  # s, of one physics step
        self.model = build_model(description, physics_timestep=self.timestep, sensors=config)
        self.data = mujoco.MjData(self.model)
        self._sensors = Sensors(self.model, description, config)
        self.joints = self._sensors.joints  # addresses in qpos and qvel
        self._direction = np.array([float(motor.direction) for motor in self.motors])
        self._strength = self._direction * description.torque_scale  # torque at the joint over that of the motor
        self._offset = np.array([homing_offset.get(name, 0.0) for name in description.joint_names])
        self._damping = self.model.dof_damping.copy()
        self.data.qpos[self.joints.qpos] = description.initial_position
        self._support = Support(self.model, self.data, description, config.drop)
        self._support.start(held=True)
        mujoco.mj_forward(self.model, self.data)
        self.torque, self.shaft, self.velocity = np.zeros((3, len(self.motors)))
        """N·m of the latest physics step, rad and rad/s now; buffers."""
        self._measure()

    def step(self, torque: FloatArray) -> None:
        """Advance physics by one step under the motors' torques, shape (m,), N·m."""
        self.torque[:] = torque
        self.data.qfrc_applied[self.joints.dof] = self._strength * torque
        self._support.advance(self.timestep)
        mujoco.mj_step2(self.model, self.data)
        mujoco.mj_step1(self.model, self.data)  # so that the sensors are those of the new state
        self._measure()

    def check(self) -> None:
        """Raise `RobotError` if the simulation is not finite any more."""
        if self.data.warning.number[UNSOUND].any():
            raise RobotError(f"{self.description.name}: the simulation is unstable (t = {self.data.time:.3f} s)")

    def jam(self, motor: int, jammed: bool) -> None:
        """Block a motor's joint where it is, or free it."""
        dof = self.joints.dof[motor]
        self.model.dof_damping[dof] = _JAM if jammed else self._damping[dof]

    def set_support(self, held: bool, *, lifts: bool = False) -> None:
        """Hold a floating base where it is, raising it slowly to its start if it `lifts`, or let it go."""
        self._support.move(held, lifts=lifts)

    @property
    def supported(self) -> bool:
        """True while the support holds a floating base."""
        return self._support.holds

    def truth(self, time: float) -> MITState:
        """Return the true state, as no motor or bus changes it, stamped with `time`, s."""
        data = self.data
        effort = self._strength * self.torque
        return self._sensors.state(time, data.qpos.copy(), data.qvel.copy(), data.sensordata.copy(), effort)

    def _measure(self) -> None:
        self.shaft[:] = self._direction * self.data.qpos[self.joints.qpos] + self._offset
        self.velocity[:] = self._direction * self.data.qvel[self.joints.dof]
