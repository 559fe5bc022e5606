"""The robot that mock motors move: MuJoCo under the motors' torques, seen from their shafts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.joints import Wiring
from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.simulation import DROP
from humanoid_sim.simulation.floating_base import Support
from humanoid_sim.simulation.model import UNSOUND, SimConfig, build_model
from humanoid_sim.simulation.sensing import Sensors

ROOM_TEMPERATURE = 25.0  # °C
SUPPLY_VOLTAGE = 48.0  # V
LOWEST_VOLTAGE = 12.0  # V, below which a motor stops: the Robstride manuals' limit, assumed for Sito motors
_JAM = 1e4  # N·m·s/rad of a jammed joint: damping is integrated implicitly, and MuJoCo's friction slips


@dataclass(slots=True)
class Sensed:
    """Measurements of a motor, in rad, s, N·m, °C and V, motor frame."""

    shaft: float = 0.0  # with all its turns
    velocity: float = 0.0
    torque: float = 0.0
    temperature: float = ROOM_TEMPERATURE
    voltage: float = SUPPLY_VOLTAGE
    overcurrent: bool = False


class Drive(NamedTuple):
    """The MIT command in force, in rad, s and N·m, motor frame; all zero but the last two without power."""

    position: float = 0.0
    velocity: float = 0.0
    effort: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0
    limit: float = 0.0  # bound of the torque
    origin: float = 0.0  # the shaft's angle that counts as position 0


class MotorPlant:
    """The robot's dynamics. Arrays have shape (m,), motor frame, one motor per joint: motors count their own turns."""

    def __init__(self, description: RobotDescription, wiring: Wiring) -> None:
        """Build the model, at rest in its initial position; a floating base is held by its support."""
        config = SimConfig(drop=DROP)
        self._name = description.name
        self.timestep = config.timestep(description)  # s, of one physics step
        self.model = build_model(description, physics_timestep=self.timestep, sensors=config)
        self.data = mujoco.MjData(self.model)
        self._sensors = Sensors(self.model, description, config)
        self.joints = self._sensors.joints  # addresses in qpos and qvel
        self._wiring = wiring
        self._strength = wiring.direction * description.torque_scale  # torque at the joint over that of the motor
        self._damping = self.model.dof_damping.copy()
        self.data.qpos[self.joints.qpos] = description.initial_position
        self.support = Support(self.model, self.data, description, config.drop)
        self.support.start(held=True)
        mujoco.mj_forward(self.model, self.data)
        self.torque, self.shaft, self.velocity = np.zeros((3, len(wiring.motors)))
        """N·m of the latest physics step, rad and rad/s now; buffers."""
        self._measure()

    def step(self, torque: FloatArray) -> None:
        """Advance physics by one step under the motors' torques, shape (m,), N·m."""
        self.torque[:] = torque
        self.data.qfrc_applied[self.joints.dof] = self._strength * torque
        self.support.advance(self.timestep)
        mujoco.mj_step2(self.model, self.data)
        mujoco.mj_step1(self.model, self.data)  # so that the sensors are those of the new state
        self._measure()

    def check(self) -> None:
        """Raise `RobotError` if the simulation is not finite any more."""
        if self.data.warning.number[UNSOUND].any():
            raise RobotError(f"{self._name}: the simulation is unstable (t = {self.data.time:.3f} s)")

    def jam(self, motor: int, jammed: bool) -> None:
        """Block a motor's joint where it is, or free it."""
        dof = self.joints.dof[motor]
        self.model.dof_damping[dof] = _JAM if jammed else self._damping[dof]

    def truth(self, time: float) -> MITState:
        """Return the true state, as no motor or bus changes it, stamped with `time`, s."""
        data = self.data
        effort = self._strength * self.torque
        return self._sensors.state(time, data.qpos.copy(), data.qvel.copy(), data.sensordata.copy(), effort)

    def _measure(self) -> None:
        self.shaft[:] = self._wiring.direction * self.data.qpos[self.joints.qpos] + self._wiring.offset
        self.velocity[:] = self._wiring.direction * self.data.qvel[self.joints.dof]
