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
from typing import NamedTuple

import numpy as np

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.joints import make_wiring
from humanoid_sim.hardware.mock.faults import Fault
from humanoid_sim.hardware.mock.plant import ROOM_TEMPERATURE, SUPPLY_VOLTAGE, Drive, MotorPlant
from humanoid_sim.hardware.mock.robstride_motor import RobstrideMotor
from humanoid_sim.hardware.mock.sito_motor import SitoMotor
from humanoid_sim.mit import MITCommand, mit_torque
from humanoid_sim.robots.schema import RobotDescription

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
        bus_count: int = 1,  # all motors on one bus, or the number of the robot's buses
        *,
        homing_offset: Mapping[str, float] = MappingProxyType({}),  # by joint, rad, motor frame; else 0
        log: Log = lambda *_: None,  # receives changes of modes and faults
    ) -> None:
        """Power everything on."""
        self.names = description.joint_names
        wiring = make_wiring(description, bus_count, dict.fromkeys(self.names, 0.0) | dict(homing_offset))
        self.plant = plant = MotorPlant(description, wiring)
        self.bus_of = [motor.channel for motor in wiring.motors]
        self.motors: list[RobstrideMotor | SitoMotor] = []
        for joint, _, motor_id, model, *_ in wiring.motors:
            if model.family == "sito":
                self.motors.append(SitoMotor(model, motor_id))
            else:
                uid = hashlib.sha256(f"{description.name}/{joint}".encode()).digest()[:8]
                self.motors.append(RobstrideMotor(model, motor_id, uid))
        self.has_power = [True] * len(self.motors)
        self.time = 0.0  # s, the time up to which everything has happened
        self._log = log
        self._random = random.Random(0)
        self._faults: list[Fault] = []  # those in force
        self._true_ids = [motor.can_id for motor in self.motors]
        self._due: list[tuple[float, int, Callable[[], None]]] = []  # events to come, each with a serial number
        self._serial, self._arrivals = count(), list[Arrival]()
        self._reported = [(False, "")] * len(self.motors)
        self._jump = np.zeros(len(self.motors))
        self._drives = np.zeros((len(Drive._fields), len(self.motors)))  # rows as `Drive`
        self._range = wiring.position_range
        self._steps = 0
        self._check_steps = max(round(_CHECK_PERIOD / plant.timestep), 1)
        for i, motor in enumerate(self.motors):
            self._measure(i)
            motor.power_on()
            self._changed(i)

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
        start = max(fault.start, self.time)
        self._at(start, partial(self._switch, fault, True))
        if math.isfinite(fault.duration):
            self._at(start + fault.duration, partial(self._switch, fault, False))

    def clear_faults(self) -> None:
        """End the faults in force. What motors have latched stays."""
        for fault in tuple(self._faults):
            self._switch(fault, False)

    def set_power(self, i: int, is_on: bool) -> None:
        """Cut a motor's power, or boot it."""
        self.has_power[i] = is_on
        self._measure(i)
        self.motors[i].power_on()
        self._log(self.time, f"{self.names[i]}: power {'on' if is_on else 'off'}")

    def _buses(self, fault: Fault) -> set[int]:
        return {bus for bus, name in zip(self.bus_of, self.names, strict=True) if fault.affects(name)}

    def _is_off(self, bus: int) -> bool:
        return any(fault.kind == "bus_off" and bus in self._buses(fault) for fault in self._faults)

    def _switch(self, fault: Fault, begins: bool) -> None:
        """Begin or end a fault; those of a motor's frames act in `_send`."""
        if begins:
            self._faults.append(fault)
            for bus in self._buses(fault):
                if fault.kind == "second_master":
                    self._interfere(fault, bus)
                elif fault.kind == "bus_off":
                    self._arrivals.append(Arrival(self.time, bus, _BUS_OFF))
        elif fault in self._faults:
            self._faults.remove(fault)
        else:
            return
        self._log(self.time, f"fault{'' if begins else ' over'}: {fault.kind} of {', '.join(fault.joints) or 'all'}")
        for i, motor in enumerate(self.motors):
            if not fault.affects(self.names[i]):
                continue
            self._measure(i)
            if fault.kind == "stuck":
                self.plant.jam(i, begins)
            elif fault.kind == "wrong_id":
                motor.can_id = int(fault.amount) if begins else self._true_ids[i]
            elif fault.kind == "brown_out" and fault.amount < _OFF_VOLTAGE:
                self.set_power(i, not begins)
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

    def _amount(self, kind: str, i: int, otherwise: float) -> float:
        """Return the value of the latest fault in force on a motor."""
        for fault in reversed(self._faults):
            if fault.kind == kind and fault.affects(self.names[i]):
                return fault.amount
        return otherwise

    # --- physics and motors

    def _step(self) -> None:
        """Do one physics step, and the motors' own work where it is due."""
        plant, (*_, limit, origin) = self.plant, self._drives
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
        self._jump[i] = self._amount("encoder_jump", i, 0.0)
        sensed.shaft = float(plant.shaft[i] + self._jump[i])
        sensed.velocity, sensed.torque = float(plant.velocity[i]), float(plant.torque[i])
        sensed.temperature = self._amount("over_temperature", i, ROOM_TEMPERATURE)
        sensed.voltage = self._amount("brown_out", i, SUPPLY_VOLTAGE)
        sensed.overcurrent = bool(self._amount("motor_fault", i, 0.0))

    def _changed(self, i: int) -> None:
        """Put a motor's command in force, and report changes of its mode and faults."""
        motor = self.motors[i]
        self._drives[:, i] = motor.drive()
        self._command = MITCommand(*self._drives[:5])
        was_running, had = self._reported[i]
        self._reported[i] = is_running, faults = motor.is_running, motor.faults()
        if is_running is not was_running:
            self._log(self.time, f"{self.names[i]}: {'enabled' if is_running else 'disabled'}")
        if faults != had:
            self._log(self.time, f"{self.names[i]}: {faults or 'faults cleared'}")

    # --- frames

    def _at(self, time: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._due, (max(time, self.time), next(self._serial), action))

    def _reach_motors(self, bus: int, frame: Frame) -> None:
        if self._is_off(bus):
            return
        for i, motor in enumerate(self.motors):
            if self.bus_of[i] == bus and self.has_power[i] and motor.is_for(frame):
                self._measure(i)
                self._send(i, motor.receive(frame, self.time), self.time + _REPLY_DELAY)
                self._changed(i)

    def _send(self, i: int, frames: Iterable[Frame], time: float) -> None:
        """Send a motor's frames, unless a fault loses, delays or damages them."""
        late, lost = self._amount("late", i, 0.0), self._amount("silent", i, 0.0)
        length = int(self._amount("garbage", i, 8))
        for frame in frames:
            if self._random.random() >= lost:
                sent = replace(frame, data=frame.data[:length])
                self._at(time + late, partial(self._arrive, self.bus_of[i], sent))

    def _arrive(self, bus: int, frame: Frame) -> None:
        if not self._is_off(bus):
            self._arrivals.append(Arrival(self.time, bus, frame))
