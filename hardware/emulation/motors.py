"""All motors of a robot with what they move: firmwares, control loops and physics, step by step."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.emulated_motor import Drive, Firmware, Reaction, Sensed
from humanoid_sim.hardware.emulation.firmware import RobstrideFirmware, wrapped
from humanoid_sim.hardware.emulation.plant import MotorPlant
from humanoid_sim.hardware.emulation.settings import EmulationSettings, motor_identities
from humanoid_sim.hardware.families import DRIVERS
from humanoid_sim.mit import FloatArray, MITCommand, mit_torque
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.motors import MotorModel, motor_model


class Drives:
    """The motors' control loops side by side: arrays of shape (m,), motor frame. Follows what the firmwares decide.

    The MIT law's error is taken from the position as the motor reports it, that is wrapped: a motor that crosses the
    end of the range sees its error jump by the whole range, which the manuals neither state nor exclude.
    """

    def __init__(self, models: Sequence[MotorModel]) -> None:
        """All motors without power, at the temperature of the room."""
        count = len(models)
        self.position, self.velocity, self.effort, self.stiffness, self.damping = np.zeros((5, count))
        """The command in force, as of an `MITCommand`; a motor that does not run has gains and effort of zero."""
        self._limit = np.array([model.peak_torque for model in models])
        self._origin = np.zeros(count)
        self._range = np.array([model.position for model in models])
        self._rated = np.array([model.rated_torque for model in models])
        self._torque, self._scratch = np.empty((2, count))
        self.rise = np.zeros(count)
        """Shape (m,), K above the room."""

    def follow(self, motor: int, drive: Drive) -> None:
        """Do from the next period on what a motor's firmware says."""
        self.position[motor], self.velocity[motor], self.effort[motor] = drive.position, drive.velocity, drive.effort
        self.stiffness[motor], self.damping[motor] = drive.stiffness, drive.damping
        self._limit[motor], self._origin[motor] = drive.limit, drive.origin

    def torque(self, shaft: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return the torque of one control period, shape (m,), N·m: a buffer that is valid until the next call.

        Both arguments have shape (m,): what the encoders read, rad, and the velocity, rad/s.
        """
        position = wrapped(shaft - self._origin, self._range)
        command = cast("MITCommand", self)  # it has the five fields, as buffers
        return mit_torque(command, position, velocity, self._limit, out=self._torque, scratch=self._scratch)

    def warm(self, torque: FloatArray, duration: float) -> None:
        """Let the windings warm up, or cool down, for a time at a torque of shape (m,)."""
        self.rise = heat(self.rise, torque, self._rated, duration)


RATED_RISE = 60.0
"""K above the room at rated torque, in the long run."""
TIME_CONSTANT = 240.0
"""s"""


def heat(rise: FloatArray, torque: FloatArray, rated_torque: npt.ArrayLike, duration: float) -> FloatArray:
    """Return the temperature rise after some time at a torque: exact for a constant one.

    No source states a motor's thermal data. Assumed is one heat capacity, heated by the current squared, cooled towards
    the room: 60 K above it in the long run at rated torque, with a time constant of four minutes; copper losses grow
    with the square of the current, and the current is proportional to the torque. A motor without a rated torque stays
    as it is.

    Args:
        rise: shape (..., m), K above the room, at the beginning.
        torque: shape (..., m), N·m.
        rated_torque: shape (m,), N·m, of continuous duty.
        duration: s.

    Returns:
        Shape (..., m), K; a new array.
    """
    final = RATED_RISE * np.square(torque / np.asarray(rated_torque))
    warmed: FloatArray = final + (rise - final) * np.exp(-duration / TIME_CONSTANT)
    return warmed


FACTORY_ID = 127
"""Id with which Robstride motors come."""
Told = Callable[[float, str], None]
"""Is told the time, s on the emulator's clock, and a line for a person."""

_CHECK_PERIOD = 0.005
"""s between two looks of a firmware at its own sensors."""


@dataclass(slots=True)
class Conditions:
    """Conditions that a fault imposes on a motor; as long as there is none, its sensors are right."""

    temperature: float | None = None
    """°C"""
    voltage: float | None = None
    """V"""
    encoder_fault: bool = False
    overcurrent: bool = False
    overloaded: bool = False
    is_silent: bool = False
    has_power: bool = True


class Motors:
    """The motors of one robot, each known by its index among the driven joints. Not thread-safe."""

    def __init__(self, description: RobotDescription, settings: EmulationSettings, told: Told | None = None) -> None:
        """Power all motors on, the robot at rest in its initial position; `told` takes changes of modes and faults."""
        self.firmwares = _make_firmwares(description, settings)
        """One per motor."""
        self.plant = MotorPlant(description, settings)
        self._settings = settings
        self._told = told
        self._drives = Drives([firmware.model for firmware in self.firmwares])
        self._late: list[tuple[float, int, int, Drive]] = []
        """Drives of motors that react late: when they take effect, s, their order, motor and drive."""
        self._serial = count()
        self._jump = np.zeros(len(self.firmwares))
        self._read = np.empty(len(self.firmwares))
        self.conditions = [Conditions(has_power=settings.alone in ("", joint.name)) for joint in self.plant.joints]
        """One per motor, as faults have it."""
        self._steps = 0
        self._steps_between_checks = max(round(_CHECK_PERIOD / self.plant.timestep), 1)
        self._look_at = 0.0
        self.states: list[Any] = []
        """One per motor, of its firmware's own type."""
        for i, firmware in enumerate(self.firmwares):
            self.states.append(firmware.power_on(None, self.sensed(i)))
            self._drives.follow(i, firmware.drive(self.states[i]))

    @property
    def time(self) -> float:
        """s, of the latest physics step."""
        return self._steps * self.plant.timestep

    @property
    def next_time(self) -> float:
        """s, of the next physics step."""
        return (self._steps + 1) * self.plant.timestep

    def sensed(self, motor: int) -> Sensed:
        """Return what a motor's sensors say now."""
        conditions, settings = self.conditions[motor], self._settings
        temperature, voltage = conditions.temperature, conditions.voltage
        return Sensed(
            float(self.plant.shaft[motor] + self._jump[motor]),
            float(self.plant.velocity[motor]),
            float(self.plant.torque[motor]),
            float(settings.room_temperature + self._drives.rise[motor]) if temperature is None else temperature,
            settings.supply_voltage if voltage is None else voltage,
            conditions.encoder_fault,
            conditions.overcurrent,
            conditions.overloaded,
        )

    def is_for(self, motor: int, frame: Frame) -> bool:
        """Return whether a frame names a motor."""
        return self.firmwares[motor].is_for(self.states[motor], frame)

    def receive(self, motor: int, frame: Frame, time: float) -> tuple[Frame, ...]:
        """Return a frame reaches a motor; what it answers."""
        if not self.conditions[motor].has_power:
            return ()
        reaction = self.firmwares[motor].receive(self.states[motor], frame, self.sensed(motor), time)
        if reaction.refusal:
            self._tell(motor, time, reaction.refusal)
        return self._take(motor, reaction, time)

    def step(self) -> list[tuple[int, Frame]]:
        """Advance control loops and physics by a period; returns what motors send of themselves at its end.

        Raises `RobotError` if the simulation is no longer sound.
        """
        plant, drives = self.plant, self._drives
        while self._late and self._late[0][0] <= self.next_time:
            drives.follow(*heapq.heappop(self._late)[2:])
        np.add(plant.shaft, self._jump, out=self._read)
        plant.step(drives.torque(self._read, plant.velocity))
        self._steps += 1
        time = self.time
        if self._steps % self._steps_between_checks == 0:
            if problem := plant.fault():
                raise RobotError(f"{plant.description.name}: {problem} (t = {time:.3f} s)")
            drives.warm(plant.torque, self._steps_between_checks * plant.timestep)
            self._look_at = time
        if time < self._look_at:
            return []
        sent = []
        for motor, state in enumerate(self.states):
            if self.conditions[motor].has_power:
                reaction = self.firmwares[motor].advance(state, self.sensed(motor), time)
                sent += [(motor, frame) for frame in self._take(motor, reaction, time)]
        pairs = zip(self.firmwares, self.states, strict=True)
        self._look_at = min((firmware.next_time(state) for firmware, state in pairs), default=math.inf)
        return sent

    def set_fault(self, motor: int, kind: str, amount: float, begins: bool) -> tuple[Frame, ...]:
        """Begin or end a fault of the scope `motor`, see `FAULTS`; returns what the motor sends about it.

        Its value is in `amount`. At the end only the cause ends: what the firmware has latched stays.
        """
        conditions = self.conditions[motor]
        announcement: tuple[Frame, ...] = ()
        match kind:
            case "silent":
                conditions.is_silent = begins
            case "unplugged":
                announcement = self.set_power(motor, not begins)
            case "reset" if begins:
                self._take(motor, Reaction(self.firmwares[motor].reset(self.states[motor])), self.time)
            case "over_temperature":
                conditions.temperature = amount if begins else None
            case "under_voltage" | "over_voltage":
                conditions.voltage = amount if begins else None
            case "overcurrent":
                conditions.overcurrent = begins
            case "stalled":
                conditions.overloaded = begins
                self.plant.jam(motor, begins)
            case "blocked":
                self.plant.jam(motor, begins)
            case "encoder_fault":
                conditions.encoder_fault = begins
            case "encoder_jump":
                self._jump[motor] += amount if begins else -amount
        self._look_at = 0.0
        return announcement

    def set_power(self, motor: int, is_on: bool) -> tuple[Frame, ...]:
        """Cut a motor's power, or boot it: it then announces itself, as drivers report of real ones.

        The position target, the turns and everything that was not saved are lost.
        """
        conditions = self.conditions[motor]
        if conditions.has_power == is_on:
            return ()
        firmware = self.firmwares[motor]
        conditions.has_power = is_on
        fresh = firmware.power_on(self.states[motor], self.sensed(motor))
        self._tell(motor, self.time, "power on" if is_on else "power off")
        self._take(motor, Reaction(fresh), self.time)
        return firmware.announcement(fresh) if is_on else ()

    def _take(self, motor: int, reaction: Reaction[Any], time: float) -> tuple[Frame, ...]:
        before, state = self.states[motor], reaction.state
        if state is not before:
            firmware = self.firmwares[motor]
            self.states[motor] = state
            drive, delay = firmware.drive(state), float(self.plant.delay[motor])
            if delay:
                heapq.heappush(self._late, (time + delay, next(self._serial), motor, drive))
            else:
                self._drives.follow(motor, drive)
            self._look_at = min(self._look_at, firmware.next_time(state))
            for text in firmware.changes(before, state):
                self._tell(motor, time, text)
        return () if self.conditions[motor].is_silent else reaction.frames

    def _tell(self, motor: int, time: float, text: str) -> None:
        if self._told is not None:
            self._told(time, f"{self.plant.joints[motor].name}: {text}")


def _make_firmwares(description: RobotDescription, settings: EmulationSettings) -> tuple[Firmware[Any], ...]:
    """Return one per driven joint, in order."""
    identities = iter(motor_identities(description, settings))
    made: list[Firmware[Any]] = []
    for joint in description.joints:
        motor = joint.motor
        if motor is None:
            continue
        model = motor_model(motor.model)
        emulated = DRIVERS[model.family].emulated
        if emulated is None:
            made.append(RobstrideFirmware(next(identities), FACTORY_ID if settings.alone else motor.can_id))
        else:
            made.append(emulated(model, motor.can_id, settings.deaf_until_enabled))
    return tuple(made)
