"""Motors on their buses, as one simulation of events: frames in, with their times; frames out, with theirs.

Nothing here waits or knows what time it is: `advance` says how far to go. `VirtualMotors` runs it in real time on
python-can channels.
"""

from __future__ import annotations

import heapq
import math
import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import NamedTuple

from humanoid_sim.errors import InputError, require_known
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.motors import Motors, Told
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.robots.description import RobotDescription

_REPLY_DELAY = 0.0003
"""s between a command and its reply, each of which takes 131 to 160 µs; no frame waits for another one."""


class FrameFaults:
    """Loses, delays, doubles, swaps and damages frames. Draws from a generator of its own, so runs can be repeated.

    A motor is an index. Without an active fault nothing is drawn and nothing changes.
    """

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._active: dict[int, dict[str, float]] = {}
        self._held: dict[int, Frame] = {}

    def set(self, kind: str, motor: int, amount: float | None) -> None:
        """Begin a fault of the scope `frames`, `amount` as in `FAULTS`; None: end it."""
        active = {name: value for name, value in self._active.pop(motor, {}).items() if name != kind}
        if amount is not None:
            active[kind] = amount
        if active:
            self._active[motor] = active

    def reaches(self, motor: int) -> bool:
        """Return whether a frame that has come over the bus reaches the motor."""
        active = self._active.get(motor)
        return not active or not self._happens(active.get("lost", 0.0))

    def arrivals(self, motor: int, frame: Frame, time: float) -> list[tuple[float, Frame]]:
        """Return when, s, how often and in what shape a motor's frame arrives that came over the bus at `time`."""
        held = self._held.pop(motor, None)
        late = [] if held is None else [(time, held)]
        active = self._active.get(motor)
        if not active:
            return [(time, frame), *late]
        if self._happens(active.get("lost", 0.0)):
            return late
        if "corrupted_id" in active:
            frame = replace(frame, arbitration_id=frame.arbitration_id ^ 1 << int(active["corrupted_id"]))
        if "corrupted_dlc" in active:
            length = int(active["corrupted_dlc"])
            frame = replace(frame, data=frame.data[:length].ljust(length, b"\0"))
        if held is None and self._happens(active.get("reordered", 0.0)):
            self._held[motor] = frame
            return late
        time += active.get("delayed", 0.0)
        copies = 1 + self._happens(active.get("duplicated", 0.0))
        return [*[(time, frame)] * copies, *late]

    def _happens(self, probability: float) -> bool:
        return probability > 0.0 and self._random.random() < probability


_BUS_OFF = Frame(0x040, bytes(8), is_error=True)
"""CAN_ERR_BUSOFF of linux/can/error.h."""
_VIOLATION = Frame(0x008, bytes(8), is_error=True)
"""CAN_ERR_PROT."""


class Arrival(NamedTuple):
    """A frame that the computer receives."""

    time: float
    """s, emulator's clock: when it had come over the bus, or later where a fault delays it."""
    bus: int
    frame: Frame


@dataclass(slots=True, eq=False)
class _Injected:
    """A fault that has not ended."""

    fault: Fault
    motors: list[int]
    is_active: bool = False


class Emulator:
    """A robot's motors on one bus, or on as many as the robot has. Not thread-safe."""

    def __init__(
        self,
        description: RobotDescription,
        bus_count: int = 1,
        *,
        settings: EmulationSettings | None = None,
        faults: Iterable[Fault] = (),
        told: Told | None = None,
    ) -> None:
        """Power everything on. Raises `InputError` if the number of buses does not fit the robot, or as `Motors` does.

        Args:
            bus_count: 1, all motors on one bus, or the number of the robot's buses.
            told: is called with the time, s, and a line for a person when a motor or a fault changes.
        """
        settings = settings or EmulationSettings()
        self.motors = Motors(description, settings, told)
        self.time = 0.0
        """s, how far the simulation has come."""
        driven = [joint.motor for joint in self.motors.plant.joints if joint.motor is not None]
        buses = 1 + max(motor.bus for motor in driven)
        if bus_count not in (1, buses):
            accepted = "1" if buses == 1 else f"1 or {buses}"
            raise InputError(f"{description.name}: {bus_count} channels, but its motors are on {accepted}")
        self._bus_of = [motor.bus if bus_count > 1 else 0 for motor in driven]
        self._on_bus = [[i for i, bus in enumerate(self._bus_of) if bus == b] for b in range(bus_count)]
        self.frames = [0] * bus_count
        """Frames that each bus has carried."""
        self._is_off = [False] * bus_count
        self._frame_faults = FrameFaults(settings.seed)
        self._host_faults: list[list[str]] = [[] for _ in range(bus_count)]
        self._arrivals: list[tuple[float, int, Arrival]] = []
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._injected: list[_Injected] = []
        self._serial = count()
        self._told = told
        for fault in faults:
            self.inject(fault)

    @property
    def bus_count(self) -> int:
        """Channels."""
        return len(self._on_bus)

    def host_fault(self, bus: int) -> str:
        """Return what is wrong with the computer's end of a bus: `bus_off`, `enobufs`, or nothing (empty).

        To be asked for each frame that is sent: what happens once has then happened.
        """
        if self._is_off[bus]:
            return "bus_off"
        faults = self._host_faults[bus]
        if "enobufs_once" in faults:
            faults.remove("enobufs_once")
            return "enobufs"
        return faults[-1] if faults else ""

    def submit(self, bus: int, frame: Frame, time: float) -> None:
        """Take a frame that the computer sends at `time`, s; the past counts as now. A bus that is off takes none."""
        if not self._is_off[bus]:
            self._at(max(time, self.time), partial(self._reach_motors, bus, frame))

    def advance(self, until: float) -> list[Arrival]:
        """Go on to `until`, s; what the computer has received until then, in order."""
        motors, due = self.motors, self._due
        while True:
            due_at = due[0][0] if due else math.inf
            now = min(motors.next_time, due_at)
            if now > until:
                break
            self.time = max(self.time, now)
            if due_at == now:
                heapq.heappop(due)[2]()
            else:
                for motor, frame in motors.step():
                    self._send(motor, frame, now)
        self.time = max(self.time, until)
        received = []
        while self._arrivals and self._arrivals[0][0] <= until:
            received.append(heapq.heappop(self._arrivals)[2])
        return received

    def inject(self, fault: Fault) -> None:
        """Schedule a fault; one whose start is past begins now. An `InputError` if it names a joint without a motor."""
        injected = _Injected(fault, self._motors_of(fault))
        self._injected.append(injected)
        start = max(fault.start, self.time)
        self._at(start, lambda: self._begin(injected))
        if not math.isinf(fault.duration):
            self._at(start + fault.duration, lambda: self._end(injected))

    def clear_faults(self) -> None:
        """End every fault that has begun, and forget those to come. What firmwares have latched stays."""
        for injected in tuple(self._injected):
            self._end(injected)

    def _tell(self, text: str) -> None:
        if self._told is not None:
            self._told(self.time, text)

    def _at(self, time: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._due, (time, next(self._serial), action))

    def _motors_of(self, fault: Fault) -> list[int]:
        names = [joint.name for joint in self.motors.plant.joints]
        require_known("joint", fault.joints, names, f"fault '{fault.kind}': ")
        return [i for i, name in enumerate(names) if not fault.joints or name in fault.joints]

    def _begin(self, injected: _Injected) -> None:
        if injected in self._injected:  # else it was forgotten before it began
            injected.is_active = True
            self._tell(f"fault: {injected.fault}")
            self._switch(injected)

    def _end(self, injected: _Injected) -> None:
        if injected not in self._injected:
            return
        self._injected.remove(injected)
        if injected.is_active:
            injected.is_active = False
            self._tell(f"fault over: {injected.fault}")
            self._switch(injected)

    def _switch(self, injected: _Injected) -> None:
        """Do what a fault is, or undo it, as it is active or not."""
        fault, begins = injected.fault, injected.is_active
        if fault.info.scope == "frames":
            for motor in injected.motors:
                self._frame_faults.set(fault.kind, motor, fault.amount if begins else None)
        elif fault.info.scope == "motor":
            for motor in injected.motors:
                for frame in self.motors.set_fault(motor, fault.kind, fault.amount, begins):
                    self._send(motor, frame, self.time)
        else:
            for bus in sorted({self._bus_of[motor] for motor in injected.motors}):
                if begins:
                    self._begin_on_bus(injected, bus)
                elif fault.kind == "bus_off":
                    self._is_off[bus] = False
                elif fault.kind in self._host_faults[bus]:
                    self._host_faults[bus].remove(fault.kind)

    def _begin_on_bus(self, injected: _Injected, bus: int) -> None:
        kind = injected.fault.kind
        if kind == "bus_off":
            self._is_off[bus] = True
            self._arrive(self.time, bus, _BUS_OFF)
        elif kind in {"other_master", "foreign_host", "error_frames"}:
            self._interfere(injected, bus)
        else:
            self._host_faults[bus].append(kind)

    def _interfere(self, injected: _Injected, bus: int) -> None:
        """Disturb a bus again and again: with another computer's frames to every motor, or with an error frame."""
        if not injected.is_active:
            return
        kind = injected.fault.kind
        if kind == "error_frames":
            self._arrive(self.time, bus, _VIOLATION)
        for motor in () if self._is_off[bus] or kind == "error_frames" else self._on_bus[bus]:
            firmware, state = self.motors.firmwares[motor], self.motors.states[motor]
            for frame in firmware.zero_torque(state) if kind == "other_master" else firmware.question(state):
                self._arrive(self.time, bus, frame)
                self._reach_motors(bus, frame)
        self._at(self.time + 1.0 / injected.fault.amount, lambda: self._interfere(injected, bus))

    def _send(self, motor: int, frame: Frame, time: float) -> None:
        self._at(time, partial(self._reach_computer, motor, frame))

    def _reach_computer(self, motor: int, frame: Frame) -> None:
        bus = self._bus_of[motor]
        if not self._is_off[bus]:
            self.frames[bus] += 1
            for arrival, received in self._frame_faults.arrivals(motor, frame, self.time):
                self._arrive(arrival, bus, received)

    def _reach_motors(self, bus: int, frame: Frame) -> None:
        if self._is_off[bus]:
            return
        self.frames[bus] += 1
        for motor in self._on_bus[bus]:
            if self.motors.is_for(motor, frame) and self._frame_faults.reaches(motor):
                for reply in self.motors.receive(motor, frame, self.time):
                    self._send(motor, reply, self.time + _REPLY_DELAY)

    def _arrive(self, time: float, bus: int, frame: Frame) -> None:
        heapq.heappush(self._arrivals, (time, next(self._serial), Arrival(time, bus, frame)))
