"""Emulated motors in this process: what `--hardware virtual:lite` talks to."""

from __future__ import annotations

import contextlib
import errno
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Self

import can

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.bus.address import BusAddress, parse_address
from humanoid_sim.hardware.bus.opening import open_bus
from humanoid_sim.hardware.emulation.emulator import BusLoad, Emulator
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.host import EmulatorHost
from humanoid_sim.hardware.emulation.motors import Told
from humanoid_sim.hardware.emulation.plant import PlantTruth
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.robots.description import RobotDescription

__all__ = ["FaultyBus", "VirtualMotors"]


_HEARS_ITSELF = "udp_multicast"
"""The interface of python-can on which a sender receives its own frames."""


class VirtualMotors:
    """A robot's motors on python-can channels, run by a thread of this process until `close`.

    With the interface `virtual` only this process can talk to them; any other works as well. `open_bus` opens the
    computer's end of a channel, with the faults that are made there: give it to `RobstrideRobot`.
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
            description: the robot.
            addresses: one channel for all motors, or one for each of the robot's buses, in order.
            settings: how motors and buses are; None for the defaults.
            faults: to come; their times count from now.
            told: is called on the motors' thread, see `Emulator`.
            clock: s, see `EmulatorHost`; the robot that talks to the motors must have the same.

        Raises:
            InputError: an address is none, the number of channels does not fit the robot, or see `Emulator`.
            RobotError: a channel cannot be opened.
        """
        self.addresses = tuple(
            address if isinstance(address, BusAddress) else parse_address(address) for address in addresses
        )
        if not self.addresses:
            raise InputError(f"{description.name}: no channel is named")
        self._emulator = Emulator(description, len(self.addresses), settings=settings, faults=faults, told=told)
        with contextlib.ExitStack() as opened:
            self._buses = [self._open(address, opened) for address in self.addresses]
            has_echoes = any(address.interface == _HEARS_ITSELF for address in self.addresses)
            self._host = EmulatorHost(self._emulator, self._buses, clock=clock, echoes=has_echoes)
            opened.callback(self._host.close)
            self._resources = opened.pop_all()

    @property
    def truth(self) -> PlantTruth:
        """What is really so, at most a few ms old; its time is on the clock, that of `time.monotonic` by default."""
        return self._host.truth

    @property
    def live_widths(self) -> Mapping[str, int]:
        """Names and widths of the truth's live inputs."""
        return self._emulator.motors.plant.live_widths

    @property
    def time(self) -> float:
        """Seconds since power-on: the clock of faults."""
        return self._host.time

    @property
    def failure(self) -> Exception | None:
        """Why the motors have died; None while they run."""
        return self._host.failure

    @property
    def slipped(self) -> float:
        """Seconds for which the motors' world stood still because this computer was too slow, see `EmulatorHost`."""
        return self._host.slipped

    @property
    def send_errors(self) -> int:
        """Frames of motors that a channel did not take."""
        return self._host.send_errors

    @property
    def joints(self) -> tuple[str, ...]:
        """The driven joints, one per motor."""
        return tuple(joint.name for joint in self._emulator.motors.plant.joints)

    def bus_load(self, bus: int = 0) -> float:
        """Part of the time since power-on for which a bus was occupied, 0 to 1; 0 where no bus time is modelled."""
        return self.load(bus).busy / max(self.time, 1e-9)

    def load(self, bus: int = 0) -> BusLoad:
        """What a bus has carried since power-on; no time where none is modelled."""
        return self._emulator.load(bus)

    def inject(self, fault: Fault) -> None:
        """A fault begins at its start on the clock of `time`, or now if that is past.

        Raises:
            InputError: it names a joint without a motor.
        """
        self._host.inject(fault)

    def clear_faults(self) -> None:
        """End every fault that has begun, and forget those to come. What firmwares have latched stays."""
        self._host.call(lambda emulator: emulator.clear_faults())

    def call(self, action: Callable[[Emulator], None]) -> None:
        """Do something with the emulator between two of its events: an observer's or a test's way in."""
        self._host.call(action)

    def move_by_hand(self, positions: Mapping[str, float] | None) -> None:
        """A hand leads joints towards positions, rad, joint frame; None lets go.

        Raises:
            InputError: a name is not that of a driven joint.
        """
        self._host.call(lambda emulator: emulator.motors.plant.lead(positions))

    def set_support(self, held: bool) -> None:
        """Let the support take a floating base where it now is, or let the base go.

        Raises:
            RobotError: the base is fixed.
        """
        self._host.call(lambda emulator: emulator.motors.plant.set_support(held))

    @property
    def supported(self) -> bool:
        """Whether the support holds a floating base."""
        return self._emulator.motors.plant.supported

    def open_bus(self, address: BusAddress) -> can.BusABC:
        """Open the computer's end of a channel; a channel of these motors with the faults of that end.

        Raises:
            RobotError: it cannot be opened.
        """
        bus = open_bus(address)
        if address not in self.addresses:
            return bus
        index = self.addresses.index(address)
        return FaultyBus(bus, str(address), lambda: self._emulator.host_fault(index))

    def close(self) -> None:
        """The motors and their ends of the channels are gone. May be called twice."""
        self._resources.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @staticmethod
    def _open(address: BusAddress, opened: contextlib.ExitStack) -> can.BusABC:
        if address.interface == "virtual":
            # stamps that say when a frame has come over the modelled bus, not when this thread got round to it
            bus: can.BusABC = can.Bus(interface="virtual", channel=address.channel, preserve_timestamps=True)
        else:
            bus = open_bus(address)
        opened.callback(bus.shutdown)
        return bus


class FaultyBus(can.BusABC):
    """Passes everything on to another bus, unless a fault says otherwise.

    The errors are those that SocketCAN raises: ENOBUFS where the queue is full, ENETDOWN after bus-off.
    """

    def __init__(self, bus: can.BusABC, channel: str, fault: Callable[[], str]) -> None:
        """Take over a bus.

        Args:
            bus: open; it is shut down with this one.
            channel: its name.
            fault: what is wrong now: `bus_off`, `enobufs`, or nothing (empty).
        """
        self._bus = bus
        self._fault = fault
        super().__init__(channel)
        self._can_protocol = bus.protocol
        self.channel_info = bus.channel_info

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send, or raise.

        Raises:
            can.CanOperationError: with the error number of the fault.
        """
        fault = self._fault()
        if fault == "enobufs":
            raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
        if fault == "bus_off":
            raise can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)
        self._bus.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self._bus._recv_internal(timeout)

    def fileno(self) -> int:
        """Of the other bus."""
        return self._bus.fileno()

    def shutdown(self) -> None:
        """Shut both down."""
        super().shutdown()
        self._bus.shutdown()
