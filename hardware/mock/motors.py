"""A robot's motors on their buses, as one simulation of events: frames in and out, with their times.

Nothing here waits or reads a clock: `advance` says how far to go.
"""

from __future__ import annotations

import hashlib
import heapq
import math
import random
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import count
from types import SimpleNamespace
from typing import NamedTuple, TypeAlias, cast

import numpy as np

from humanoid_sim.errors import InputError, require_known
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.mock.faults import BUS_FAULTS, Fault
from humanoid_sim.hardware.mock.motor import ROOM_TEMPERATURE, SUPPLY_VOLTAGE
from humanoid_sim.hardware.mock.plant import MotorPlant
from humanoid_sim.hardware.mock.robstride_motor import RobstrideMotor
from humanoid_sim.hardware.mock.sito_motor import SitoMotor
from humanoid_sim.hardware.robstride.firmware import emulated_version, parse_version
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand, mit_torque
from humanoid_sim.robots.motors import motor_model
from humanoid_sim.robots.schema import RobotDescription

FACTORY_ID = 127  # id with which Robstride motors are delivered
MockMotor: TypeAlias = RobstrideMotor | SitoMotor
Log = Callable[[float, str], None]
"""Receives the time, s on the simulation's clock, and a line for a person."""
_REPLY_DELAY = 0.0003  # s from a command to its reply; frames take 131 to 160 µs, and none waits for another
_CHECK_PERIOD = 0.005  # s between two checks of a motor's own sensors
_OFF_VOLTAGE = 6.0  # V, below which a motor is off
_BUS_OFF = Frame(0x040, bytes(8), is_error=True)  # CAN_ERR_BUSOFF of linux/can/error.h


@dataclass(frozen=True, slots=True)
class MockSettings:
    """Settings of the motors that are not in the robot description."""

    homing_offset: Mapping[str, float] = field(default_factory=dict)
    """rad, motor frame, by joint: the shaft's angle where the joint is at 0, as the motors are assembled; else 0."""
    firmware: Mapping[str, str] = field(default_factory=dict)
    """Versions such as `0.2.3.5`, by joint or by model; else the newest."""
    alone: str = ""
    """Joint whose motor is alone on the bus, as delivered; empty: all are there, with their ids."""
    seed: int = 0
    """Seed of random faults, and of the motors' unique ids."""


class Arrival(NamedTuple):
    """A frame that the computer receives."""

    time: float
    """s, on the simulation's clock."""
    bus: int
    frame: Frame


class MockMotors:
    """A robot's motors on one bus, or on as many as the robot has. Not thread-safe."""

    def __init__(
        self,
        description: RobotDescription,
        bus_count: int = 1,
        settings: MockSettings | None = None,
        log: Log | None = None,
    ) -> None:
        """Power everything on.

        Args:
            bus_count: 1, all motors on one bus, or the number of the robot's buses.
            log: receives changes of modes and faults.
        """
        settings = settings or MockSettings()
        self.plant = plant = MotorPlant(description, settings.homing_offset)
        self.names = plant.names  # the driven joints, one per motor
        driven = [joint.motor for joint in plant.joints if joint.motor is not None]
        buses = 1 + max(motor.bus for motor in driven)
        if bus_count not in (1, buses):
            raise InputError(f"{description.name}: {bus_count} channels, expected 1 or {buses}")
        self.bus_count = bus_count
        self.bus_of = [motor.bus if bus_count > 1 else 0 for motor in driven]  # by motor
        self.motors = _make_motors(description, settings)
        self.has_power = [settings.alone in ("", name) for name in self.names]
        self.time = 0.0  # s, the time up to which everything has happened
        self._log = log
        self._random = random.Random(settings.seed)
        self._scheduled: list[Fault] = []
        self._faults: list[Fault] = []  # those in force
        self._off: set[int] = set()  # buses that are off
        self._true_ids = [motor.can_id for motor in self.motors]
        self._serial = count()
        self._arrivals: list[tuple[float, int, Arrival]] = []
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        """Events to come, and among them drives of motors that react late."""
        self._reported = [(False, "")] * len(self.motors)
        self._jump, self._shaft = np.zeros((2, len(self.motors)))
        self._drive = np.zeros((7, len(self.motors)))  # rows as `Drive`, by motor: the commands in force
        rows = dict(zip(COMMAND_FIELDS, self._drive, strict=False))
        self._command = cast("MITCommand", SimpleNamespace(**rows))  # the first five rows, which no physics step copies
        self._range = np.array([motor.model.position for motor in self.motors])
        self._steps = 0
        self._steps_between_checks = max(round(_CHECK_PERIOD / plant.timestep), 1)
        self._check_at = 0.0
        for i, motor in enumerate(self.motors):
            self._sense(i)
            motor.power_on()
            self._drive[:, i] = motor.drive()

    def submit(self, bus: int, frame: Frame, time: float) -> None:
        """Take a frame that the computer sends at `time`, s; the past counts as now."""
        if bus not in self._off:
            self._at(max(time, self.time), partial(self._reach_motors, bus, frame))

    def advance(self, until: float) -> list[Arrival]:
        """Go on to `until`, s; returns the frames that the computer receives until then, in order."""
        while True:
            step_at = (self._steps + 1) * self.plant.timestep
            due_at = self._due[0][0] if self._due else math.inf
            if min(step_at, due_at) > until:
                break
            self.time = max(self.time, min(step_at, due_at))
            if due_at <= step_at:
                heapq.heappop(self._due)[2]()
            else:
                self._step()
        self.time = max(self.time, until)
        received = []
        while self._arrivals and self._arrivals[0][0] <= until:
            received.append(heapq.heappop(self._arrivals)[2])
        return received

    # --- faults

    def inject(self, fault: Fault) -> None:
        """Schedule a fault; one whose start is past begins now."""
        require_known("joint", fault.joints, self.names, f"fault '{fault.kind}': ")
        self._scheduled.append(fault)
        start = max(fault.start, self.time)
        self._at(start, partial(self._begin, fault))
        if math.isfinite(fault.duration):
            self._at(start + fault.duration, partial(self._end, fault))

    def clear_faults(self) -> None:
        """End the faults in force and forget those to come. What motors have latched stays."""
        self._scheduled.clear()
        for fault in tuple(self._faults):
            self._end(fault)

    def host_fault(self, bus: int) -> str:
        """Return the fault of the computer's end of a bus: `bus_off`, `tx_full` or none (empty)."""
        if bus in self._off:
            return "bus_off"
        return "tx_full" if any(f.kind == "tx_full" and bus in self._buses(f) for f in self._faults) else ""

    def _begin(self, fault: Fault) -> None:
        if fault not in self._scheduled:
            return
        self._scheduled.remove(fault)
        self._faults.append(fault)
        self._report(f"fault: {fault}")
        self._switch(fault, True)

    def _end(self, fault: Fault) -> None:
        if fault in self._faults:
            self._faults.remove(fault)
            self._report(f"fault over: {fault}")
            self._switch(fault, False)

    def _motors(self, fault: Fault) -> list[int]:
        return [i for i, name in enumerate(self.names) if not fault.joints or name in fault.joints]

    def _buses(self, fault: Fault) -> set[int]:
        return {self.bus_of[i] for i in self._motors(fault)}

    def _switch(self, fault: Fault, begins: bool) -> None:
        """Begin or end a fault; those of a motor's frames act in `_send`, `tx_full` in `host_fault`."""
        if fault.kind in BUS_FAULTS:
            for bus in self._buses(fault):
                self._switch_bus(fault, bus, begins)
        else:
            for i in self._motors(fault):
                self._switch_motor(fault, i, begins)
        self._check_at = 0.0

    def _switch_bus(self, fault: Fault, bus: int, begins: bool) -> None:
        if fault.kind == "second_master":
            self._interfere(fault, bus)
        elif fault.kind == "bus_off" and begins:
            self._off.add(bus)
            self._arrive(self.time, bus, _BUS_OFF)
        elif fault.kind == "bus_off":
            self._off.discard(bus)

    def _switch_motor(self, fault: Fault, i: int, begins: bool) -> None:
        motor, amount = self.motors[i], fault.amount
        match fault.kind:
            case "over_temperature":
                motor.sensed.temperature = amount if begins else ROOM_TEMPERATURE
            case "motor_fault":
                motor.sensed.overcurrent = begins
            case "brown_out":
                motor.sensed.voltage = amount if begins else SUPPLY_VOLTAGE
                if amount < _OFF_VOLTAGE:
                    self.set_power(i, not begins)
            case "stuck":
                self.plant.jam(i, begins)
            case "encoder_jump":
                self._jump[i] += amount if begins else -amount
            case "wrong_id":
                motor.can_id = int(amount) if begins else self._true_ids[i]
            case "reset" if begins:
                motor.reset()
        self._changed(i)

    def set_power(self, i: int, is_on: bool) -> None:
        """Cut a motor's power, or boot it: it then announces itself, as drivers report of real ones."""
        self.has_power[i] = is_on
        self._sense(i)
        frames = self.motors[i].power_on()
        self._report(f"{self.names[i]}: power {'on' if is_on else 'off'}")
        if is_on:
            self._send(i, frames, self.time)

    def _interfere(self, fault: Fault, bus: int) -> None:
        """Send another computer's commands to every motor of a bus, again and again."""
        if fault not in self._faults:
            return
        for i, motor in enumerate(self.motors):
            if self.bus_of[i] == bus and bus not in self._off:
                for frame in motor.zero_torque():
                    self._arrive(self.time, bus, frame)
                    self._reach_motors(bus, frame)
        self._at(self.time + 1.0 / fault.amount, partial(self._interfere, fault, bus))

    def _amount(self, kind: str, i: int) -> float | None:
        """Return the value of a fault in force on a motor; None without one."""
        for fault in reversed(self._faults):
            if fault.kind == kind and (not fault.joints or self.names[i] in fault.joints):
                return fault.amount
        return None

    # --- physics and motors

    def _step(self) -> None:
        """Do one physics step, and the motors' own work where it is due."""
        plant, drive = self.plant, self._drive
        np.add(plant.shaft, self._jump, out=self._shaft)
        position = (self._shaft - drive[6] + self._range) % (2.0 * self._range) - self._range
        plant.step(mit_torque(self._command, position, plant.velocity, drive[5]))
        self._steps += 1
        if self._steps % self._steps_between_checks == 0:
            plant.check()
            self._check_at = 0.0
        if self.time < self._check_at:
            return
        for i, motor in enumerate(self.motors):
            if self.has_power[i]:
                self._sense(i)
                self._send(i, motor.advance(self.time), self.time)
                self._changed(i)
        self._check_at = min(motor.next_time() for motor in self.motors)

    def _sense(self, i: int) -> None:
        """Let a motor read its sensors."""
        plant, sensed = self.plant, self.motors[i].sensed
        sensed.shaft = float(plant.shaft[i] + self._jump[i])
        sensed.velocity, sensed.torque = float(plant.velocity[i]), float(plant.torque[i])

    def _changed(self, i: int) -> None:
        """Put a motor's command in force, late if it reacts late, and report changes of its mode and faults."""
        motor, delay = self.motors[i], float(self.plant.delay[i])
        drive = motor.drive()
        if delay:
            self._at(self.time + delay, partial(self._drive.__setitem__, np.s_[:, i], drive))
        else:
            self._drive[:, i] = drive
        self._check_at = min(self._check_at, motor.next_time())
        was_running, had = self._reported[i]
        faults = motor.faults()
        self._reported[i] = motor.is_running, faults
        if motor.is_running is not was_running:
            self._report(f"{self.names[i]}: {'enabled' if motor.is_running else 'disabled'}")
        if faults != had:
            self._report(f"{self.names[i]}: {faults or 'faults cleared'}")

    def _report(self, text: str) -> None:
        if self._log is not None:
            self._log(self.time, text)

    # --- frames

    def _at(self, time: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._due, (time, next(self._serial), action))

    def _reach_motors(self, bus: int, frame: Frame) -> None:
        for i, motor in enumerate(self.motors):
            if self.bus_of[i] == bus and bus not in self._off and self.has_power[i] and motor.is_for(frame):
                self._sense(i)
                self._send(i, motor.receive(frame, self.time), self.time + _REPLY_DELAY)
                self._changed(i)

    def _send(self, i: int, frames: Iterable[Frame], time: float) -> None:
        """Send a motor's frames, unless a fault loses, delays or damages them."""
        lost, late, length = (self._amount(kind, i) for kind in ("silent", "late", "garbage"))
        for frame in frames:
            if lost is None or self._random.random() >= lost:
                sent = frame if length is None else replace(frame, data=frame.data[: int(length)])
                self._at(time, partial(self._reach_computer, i, sent, late or 0.0))

    def _reach_computer(self, i: int, frame: Frame, late: float) -> None:
        if self.bus_of[i] not in self._off:
            self._arrive(self.time + late, self.bus_of[i], frame)

    def _arrive(self, time: float, bus: int, frame: Frame) -> None:
        heapq.heappush(self._arrivals, (time, next(self._serial), Arrival(time, bus, frame)))


def _make_motors(description: RobotDescription, settings: MockSettings) -> list[MockMotor]:
    """Return one motor per driven joint, in order."""
    driven = {joint.name: joint.motor for joint in description.joints if joint.motor is not None}
    models = {name: motor_model(motor.model) for name, motor in driven.items()}
    robstride = {name: model for name, model in models.items() if model.family == "robstride"}
    require_known("joint with a Robstride motor", [settings.alone] if settings.alone else [], robstride)
    known = [*robstride, *dict.fromkeys(model.name for model in robstride.values())]
    require_known("joint or motor model", settings.firmware, known, "firmware: ")
    motors: list[MockMotor] = []
    for name, model in models.items():
        can_id = driven[name].can_id
        if name not in robstride:
            motors.append(SitoMotor(model, can_id))
            continue
        text = settings.firmware.get(name, settings.firmware.get(model.name))
        version = emulated_version(model) if text is None else parse_version(text)
        uid = hashlib.sha256(f"{description.name}/{name}/{settings.seed}".encode()).digest()[:8]
        motors.append(RobstrideMotor(model, FACTORY_ID if settings.alone else can_id, version, uid))
    return motors
