"""Emulated motors in real time on python-can channels: what `--hardware virtual:lite` talks to.

A thread takes frames, lets time pass, and sends frames. The computer's end of such a channel has faults of its own:
what a driver answers when frames cannot leave.
"""

from __future__ import annotations

import contextlib
import errno
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Self

import can

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.bus.address import (
    BusAddress,
    Echoes,
    PassingBus,
    frame_of,
    message_of,
    open_bus,
    parse_address,
)
from humanoid_sim.hardware.emulation.emulator import Emulator
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.motors import Told
from humanoid_sim.hardware.emulation.plant import PlantTruth
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.robots.description import RobotDescription

_POLL_PERIOD = 0.0005
"""s between two looks at the channels. Frames are emulated at the times of their stamps, not of these looks."""
_TRUTH_PERIOD = 0.002
"""s between two snapshots of the truth: 500 Hz, the rate of a common IMU."""
_MOST_AT_ONCE = 256
"""Frames taken from one channel before time goes on: a flood must not stop the motors."""
_MOST_ECHOES = 1024
"""Frames of motors that are remembered until they are heard again."""
_OLDEST = 2.0
"""s between a frame's stamp and its reading that are believed."""
_MOST_BEHIND = 0.05
"""s that the motors may be behind the clock before the time that is missing is left out."""
_JOIN = 5.0
"""s that closing waits for the thread."""


class VirtualMotors:
    """A robot's motors on python-can channels, run by a thread of this process until `close`.

    With the interface `virtual` only this process can talk to them; any other works as well. `open_bus` opens the
    computer's end of a channel, with the faults that are made there: give it to `HardwareRobot`. `inject` and the like
    may be called from any thread.

    A frame is emulated at the time of its stamp, so that a thread that is late changes nothing but when the answers can
    be read; their stamps again say when they came over the bus, where the interface keeps them.

    On a computer that cannot run them in real time the motors' world stands still for a while now and then, rather than
    answer later and later. `slipped` says for how long.
    """

    def __init__(
        self,
        description: RobotDescription,
        addresses: Sequence[BusAddress | str],
        *,
        settings: EmulationSettings | None = None,
        faults: Iterable[Fault] = (),
        told: Told | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Power the motors on.

        Args:
            addresses: one channel for all motors, or one for each of the robot's buses, in order.
            faults: to come; their times count from now.
            told: is called on the motors' thread, see `Emulator`.
            clock: s; one that goes slower than real time shows everything in slow motion. The robot that talks to the
                motors must have the same.

        Raises:
            InputError: an address is none, the number of channels does not fit the robot, or see `Emulator`.
            RobotError: a channel cannot be opened.
        """
        self.addresses = tuple(
            address if isinstance(address, BusAddress) else parse_address(address) for address in addresses
        )
        if not self.addresses:
            raise InputError(f"{description.name}: no channel is named")
        self._emulator = emulator = Emulator(
            description, len(self.addresses), settings=settings, faults=faults, told=told
        )
        with contextlib.ExitStack() as opened:
            self._buses = tuple(_open(address, opened) for address in self.addresses)
            self._opened = opened.pop_all()
        self._clock = clock
        self._begin = clock()
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._echoes = tuple(Echoes(address, _MOST_ECHOES) for address in self.addresses)
        self._truth = emulator.motors.plant.truth(self._begin)
        self.slipped = 0.0
        """s for which the motors' world stood still because this computer was too slow."""
        self.send_errors = 0
        """Frames that a channel did not take."""
        self.failure: Exception | None = None
        """Exception that ended the thread; None while it runs."""
        self._thread = threading.Thread(target=self._run, name="emulated motors", daemon=True)
        self._thread.start()

    @property
    def truth(self) -> PlantTruth:
        """The latest snapshot, at most a few ms old; its time is on the host's clock."""
        return self._truth

    @property
    def time(self) -> float:
        """Seconds since the motors were powered on: the clock of faults."""
        return self._clock() - self._begin

    def inject(self, fault: Fault) -> None:
        """Schedule a fault on the clock of `time`, see `Emulator.inject`."""
        with self._lock:
            self._emulator.inject(fault)

    def call(self, action: Callable[[Emulator], None]) -> None:
        """Do something with the emulator between two of its events."""
        with self._lock:
            action(self._emulator)

    @property
    def joints(self) -> tuple[str, ...]:
        """The driven joints, one per motor."""
        return tuple(joint.name for joint in self._emulator.motors.plant.joints)

    def frames(self, bus: int = 0) -> int:
        """Return the number of frames that a bus has carried since power-on."""
        return self._emulator.frames[bus]

    def clear_faults(self) -> None:
        """End every fault that has begun, and forget those to come. What firmwares have latched stays."""
        self.call(lambda emulator: emulator.clear_faults())

    def move_by_hand(self, positions: Mapping[str, float] | None) -> None:
        """Lead joints by hand, see `MotorPlant.lead`."""
        self.call(lambda emulator: emulator.motors.plant.lead(positions))

    def set_support(self, held: bool, *, lifts: bool = False) -> None:
        """Support a floating base or let it go, see `MotorPlant.set_support`."""
        self.call(lambda emulator: emulator.motors.plant.set_support(held, lifts=lifts))

    @property
    def supported(self) -> bool:
        """Return whether the support holds a floating base."""
        return self._emulator.motors.plant.supported

    def open_bus(self, address: BusAddress) -> can.BusABC:
        """Open the computer's end of a channel; a channel of these motors with the faults of that end."""
        bus = open_bus(address)
        if address not in self.addresses:
            return bus
        index = self.addresses.index(address)
        return FaultyBus(bus, str(address), lambda: self._emulator.host_fault(index))

    def close(self) -> None:
        """Stop the thread and close the motors' ends of the channels; twice is once. Raises what ended the thread."""
        if self._closing.is_set():
            return
        self._closing.set()
        with self._opened:
            self._thread.join(_JOIN)
            if self.failure is not None:
                raise self.failure

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        next_look = time.monotonic()
        next_truth = self._clock()
        try:
            while not self._closing.is_set():
                with self._lock:
                    now = self._clock()
                    self._look(now)
                    if now >= next_truth:
                        self._truth = self._emulator.motors.plant.truth(now)
                        next_truth = now + _TRUTH_PERIOD
                next_look = max(next_look + _POLL_PERIOD, time.monotonic())
                time.sleep(max(next_look - time.monotonic(), 0.0))
        except Exception as error:
            self.failure = error

    def _look(self, now: float) -> None:
        """Take what has come, let time pass, send what is due."""
        until = now - self._begin
        behind = until - self._emulator.time
        if behind > _MOST_BEHIND:
            self._begin += behind
            self.slipped += behind
            until = self._emulator.time
        # What python-can stamps is the system's wall clock, or whatever a driver counts: see `_arrival`.
        wall = time.time()
        for index, bus in enumerate(self._buses):
            for _ in range(_MOST_AT_ONCE):
                message = _received(bus)
                if message is None:
                    break
                # `is_rx` is not asked: on SocketCAN what other processes of this machine send comes without it.
                if message.is_error_frame or message.is_fd:
                    continue
                frame = frame_of(message)
                if not self._echoes[index].take(frame):
                    self._emulator.submit(index, frame, self._arrival(message.timestamp, wall, until))
        for arrival in self._emulator.advance(until):
            self._echoes[arrival.bus].expect(arrival.frame)
            try:
                self._buses[arrival.bus].send(message_of(arrival.frame, wall - until + arrival.time))
            except can.CanError:
                self.send_errors += 1

    def _arrival(self, stamp: float, wall: float, now: float) -> float:
        """Return the emulator's time of a stamp: between the last look, which the emulator sees to itself, and now."""
        return min(now - (wall - stamp), now) if wall - stamp < _OLDEST else now


def _open(address: BusAddress, opened: contextlib.ExitStack) -> can.BusABC:
    if address.interface == "virtual":
        # stamps that say when a frame has come over the bus, not when this thread got round to it
        bus: can.BusABC = can.Bus(interface="virtual", channel=address.channel, preserve_timestamps=True)
    else:
        bus = open_bus(address)
    opened.callback(bus.shutdown)
    return bus


def _received(bus: can.BusABC) -> can.Message | None:
    try:
        return bus.recv(0.0)
    except can.CanError as error:
        raise RobotError(f"{bus.channel_info}: receiving fails: {error}") from None


class FaultyBus(PassingBus):
    """Passes everything on to another bus, unless a fault says otherwise.

    The errors are those that SocketCAN raises: ENOBUFS where the queue is full, ENETDOWN after bus-off.
    """

    def __init__(self, bus: can.BusABC, channel: str, fault: Callable[[], str]) -> None:
        """Take over a bus; `fault` says what is wrong now: `bus_off`, `enobufs`, or nothing (empty)."""
        self._fault = fault
        super().__init__(bus, channel)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send, or raise `can.CanOperationError` with the error number of the fault."""
        fault = self._fault()
        if fault == "enobufs":
            raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
        if fault == "bus_off":
            raise can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)
        super().send(msg, timeout)
