"""A robot's motors on their buses, as one simulation of events: frames in and out, with their times.

Nothing here waits or reads a clock: `advance` gets the time to go to.
"""

from __future__ import annotations

import hashlib
import heapq
import math
import random
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from itertools import count
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

import numpy as np

from humanoid_sim.errors import InputError, require_known
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.mock.faults import Fault
from humanoid_sim.hardware.mock.motor import ROOM_TEMPERATURE, SUPPLY_VOLTAGE, Drive
from humanoid_sim.hardware.mock.plant import MotorPlant
from humanoid_sim.hardware.mock.robstride_motor import RobstrideMotor
from humanoid_sim.hardware.mock.sito_motor import SitoMotor
from humanoid_sim.mit import MITCommand, mit_torque
from humanoid_sim.robots.motors import motor_model
from humanoid_sim.robots.schema import RobotDescription

FACTORY_ID = 127  # id with which Robstride motors are delivered
MockMotor: TypeAlias = RobstrideMotor | SitoMotor
Log = Callable[[float, str], None]  # takes s on the motors' clock, and a line for a person
_REPLY_DELAY = 0.0003  # s from a command to its reply; frames take 131 to 160 µs, and none waits for another
_CHECK_PERIOD = 0.002  # s between two checks of the motors' protections, timeouts and reports
_OFF_VOLTAGE = 6.0  # V, below which a motor is off
_BUS_OFF = Frame(0x040, bytes(8), is_error=True)  # CAN_ERR_BUSOFF of linux/can/error.h


class Arrival(NamedTuple):
    """A frame that the computer receives."""

    time: float  # s, on the motors' clock
    bus: int
    frame: Frame


class MockMotors:
    """A robot's motors on one bus, or on as many as the robot has. Not thread-safe."""

    def __init__(
        self,
        description: RobotDescription,
        bus_count: int = 1,
        *,
        homing_offset: Mapping[str, float] = MappingProxyType({}),
        alone: str = "",
        log: Log | None = None,
    ) -> None:
        """Power everything on.

        Args:
            bus_count: 1, all motors on one bus, or the number of the robot's buses.
            homing_offset: rad, motor frame, by joint: the shaft's angle where the joint is at 0; else 0.
            alone: joint whose motor alone has power, as delivered; empty: all have, with their ids.
            log: receives changes of modes and faults.
        """
        self.plant = plant = MotorPlant(description, homing_offset)
        self.names = description.joint_names
        buses = 1 + max(motor.bus for motor in plant.motors)
        if bus_count not in (1, buses):
            raise InputError(f"{description.name}: {bus_count} channels, expected 1 or {buses}")
        self.bus_count = bus_count
        self.bus_of = [motor.bus if bus_count > 1 else 0 for motor in plant.motors]
        self.motors = _make_motors(plant, alone)
        self.has_power = [alone in ("", name) for name in self.names]
        self.time = 0.0  # s, the time up to which everything has happened
        self._log = log
        self._random = random.Random(0)
        self._faults: list[Fault] = []  # those in force
        self._off: set[int] = set()  # buses that are off
        self._true_ids = [motor.can_id for motor in self.motors]
        self._serial = count()
        self._due: list[tuple[float, int, Callable[[], None]]] = []  # events to come
        self._arrivals: list[Arrival] = []
        self._reported = [(False, "")] * len(self.motors)
        self._jump = np.zeros(len(self.motors))
        self._drives = np.zeros((len(Drive._fields), len(self.motors)))  # rows as `Drive`: the commands in force
        self._command: MITCommand | None = None  # their first five rows; None: changed since
        self._range = np.array([motor.model.position for motor in self.motors])
        self._steps = 0
        self._check_steps = max(round(_CHECK_PERIOD / plant.timestep), 1)
        for i, motor in enumerate(self.motors):
            self._measure(i)
            motor.power_on()
            self._drives[:, i] = motor.drive()

    def submit(self, bus: int, frame: Frame, time: float) -> None:
        """Take a frame that the computer sends at `time`, s; the past counts as now."""
        self._at(time, partial(self._reach_motors, bus, frame))

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
        arrivals, self._arrivals = self._arrivals, []
        return arrivals

    # --- faults

    def inject(self, fault: Fault) -> None:
        """Schedule a fault; one whose start is past begins now."""
        require_known("joint", fault.joints, self.names, f"fault '{fault.kind}': ")
        start = max(fault.start, self.time)
        self._at(start, partial(self._switch, fault, True))
        if math.isfinite(fault.duration):
            self._at(start + fault.duration, partial(self._switch, fault, False))

    def clear_faults(self) -> None:
        """End the faults in force. What motors have latched stays."""
        for fault in tuple(self._faults):
            self._switch(fault, False)

    def host_fault(self, bus: int) -> str:
        """Return the fault of the computer's end of a bus: `bus_off`, `tx_full` or none (empty)."""
        if bus in self._off:
            return "bus_off"
        return "tx_full" if any(fault.kind == "tx_full" and bus in self._buses(fault) for fault in self._faults) else ""

    def set_power(self, i: int, is_on: bool) -> None:
        """Cut a motor's power, or boot it: it then announces itself, as drivers report of real ones."""
        self.has_power[i] = is_on
        self._measure(i)
        frames = self.motors[i].power_on()
        self._report(f"{self.names[i]}: power {'on' if is_on else 'off'}")
        if is_on:
            self._send(i, frames, self.time)

    def _buses(self, fault: Fault) -> set[int]:
        return {bus for bus, name in zip(self.bus_of, self.names, strict=True) if fault.affects(name)}

    def _switch(self, fault: Fault, begins: bool) -> None:
        """Begin or end a fault; those of a motor's frames act in `_send`, `tx_full` in `host_fault`."""
        if begins:
            self._faults.append(fault)
        elif fault in self._faults:
            self._faults.remove(fault)
        else:
            return
        self._report(f"fault{'' if begins else ' over'}: {fault.kind} of {', '.join(fault.joints) or 'all'}")
        for i, name in enumerate(self.names):
            if fault.affects(name):
                self._switch_motor(fault, i, begins)
        for bus in self._buses(fault):
            match fault.kind:
                case "second_master" if begins:
                    self._interfere(fault, bus)
                case "bus_off" if begins:
                    self._arrive(bus, _BUS_OFF)
                    self._off.add(bus)
                case "bus_off":
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

    def _interfere(self, fault: Fault, bus: int) -> None:
        """Send another computer's commands to every motor of a bus, again and again."""
        if fault not in self._faults:
            return
        for i, motor in enumerate(self.motors):
            if self.bus_of[i] == bus:
                for frame in motor.zero_torque():
                    self._arrive(bus, frame)
                    self._reach_motors(bus, frame)
        self._at(self.time + 1.0 / fault.amount, partial(self._interfere, fault, bus))

    def _amount(self, kind: str, i: int) -> float | None:
        """Return the value of a fault in force on a motor; None without one."""
        found = [fault.amount for fault in self._faults if fault.kind == kind and fault.affects(self.names[i])]
        return found[-1] if found else None

    # --- physics and motors

    def _step(self) -> None:
        """Do one physics step, and the motors' own work where it is due."""
        plant, (*rows, limit, origin) = self.plant, self._drives
        if self._command is None:
            self._command = MITCommand(*rows)
        position = (plant.shaft + self._jump - origin + self._range) % (2.0 * self._range) - self._range
        plant.step(mit_torque(self._command, position, plant.velocity, limit))
        self._steps += 1
        if self._steps % self._check_steps:
            return
        plant.check()
        for i, motor in enumerate(self.motors):
            if self.has_power[i]:
                self._measure(i)
                frames = motor.advance(self.time)
                if frames or motor.is_running is not self._reported[i][0]:
                    self._send(i, frames, self.time)
                    self._changed(i)

    def _measure(self, i: int) -> None:
        plant, sensed = self.plant, self.motors[i].sensed
        sensed.shaft = float(plant.shaft[i] + self._jump[i])
        sensed.velocity, sensed.torque = float(plant.velocity[i]), float(plant.torque[i])

    def _changed(self, i: int) -> None:
        """Put a motor's command in force, and report changes of its mode and faults."""
        motor = self.motors[i]
        self._drives[:, i] = motor.drive()
        self._command = None
        was_running, had = self._reported[i]
        self._reported[i] = is_running, faults = motor.is_running, motor.faults()
        if is_running is not was_running:
            self._report(f"{self.names[i]}: {'enabled' if is_running else 'disabled'}")
        if faults != had:
            self._report(f"{self.names[i]}: {faults or 'faults cleared'}")

    def _report(self, text: str) -> None:
        if self._log is not None:
            self._log(self.time, text)

    # --- frames

    def _at(self, time: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._due, (max(time, self.time), next(self._serial), action))

    def _reach_motors(self, bus: int, frame: Frame) -> None:
        for i, motor in enumerate(self.motors):
            if self.bus_of[i] == bus and bus not in self._off and self.has_power[i] and motor.is_for(frame):
                self._measure(i)
                self._send(i, motor.receive(frame, self.time), self.time + _REPLY_DELAY)
                self._changed(i)

    def _send(self, i: int, frames: Iterable[Frame], time: float) -> None:
        """Send a motor's frames, unless a fault loses, delays or damages them."""
        for frame in frames:
            lost, late, length = (self._amount(kind, i) for kind in ("silent", "late", "garbage"))
            if lost is None or self._random.random() >= lost:
                sent = frame if length is None else replace(frame, data=frame.data[: int(length)])
                self._at(time + (late or 0.0), partial(self._arrive, self.bus_of[i], sent))

    def _arrive(self, bus: int, frame: Frame) -> None:
        if bus not in self._off:
            self._arrivals.append(Arrival(self.time, bus, frame))


def _make_motors(plant: MotorPlant, alone: str) -> list[MockMotor]:
    """Return one motor per joint, in order."""
    robot, motors = plant.description, list[MockMotor]()
    require_known("joint", [alone] if alone else [], robot.joint_names)
    for joint, motor in zip(robot.joint_names, plant.motors, strict=True):
        model = motor_model(motor.model)
        if model.family == "sito":
            motors.append(SitoMotor(model, motor.can_id))
        else:
            uid = hashlib.sha256(f"{robot.name}/{joint}".encode()).digest()[:8]
            motors.append(RobstrideMotor(model, FACTORY_ID if alone else motor.can_id, uid))
    return motors
