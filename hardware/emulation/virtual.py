"""Emulated motors in this process: what `--hardware virtual:lite` talks to."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Mapping, Sequence

import can

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.bus.address import BusAddress, open_bus, parse_address
from humanoid_sim.hardware.emulation.emulator import BusLoad, Emulator
from humanoid_sim.hardware.emulation.faults import Fault
from humanoid_sim.hardware.emulation.host import EmulatorHost, FaultyBus
from humanoid_sim.hardware.emulation.motors import Told
from humanoid_sim.hardware.emulation.settings import EmulationSettings
from humanoid_sim.robots.description import RobotDescription


class VirtualMotors(EmulatorHost):
    """A robot's motors on python-can channels, run by a thread of this process until `close`.

    With the interface `virtual` only this process can talk to them; any other works as well. `open_bus` opens the
    computer's end of a channel, with the faults that are made there: give it to `HardwareRobot`.
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
        emulator = Emulator(description, len(self.addresses), settings=settings, faults=faults, told=told)
        with contextlib.ExitStack() as opened:
            buses = [_open(address, opened) for address in self.addresses]
            super().__init__(emulator, buses, addresses=self.addresses, clock=clock)
            self._opened = opened.pop_all()

    @property
    def joints(self) -> tuple[str, ...]:
        """The driven joints, one per motor."""
        return tuple(joint.name for joint in self._emulator.motors.plant.joints)

    def bus_load(self, bus: int = 0) -> float:
        """Part of the time since power-on for which a bus was occupied, 0 to 1; 0 where no bus time is modelled."""
        return self.load(bus).busy / max(self.time, 1e-9)

    def load(self, bus: int = 0) -> BusLoad:
        """Return what a bus has carried since power-on; no time where none is modelled."""
        return self._emulator.load(bus)

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
        """Close the motors and their ends of the channels. May be called twice."""
        with self._opened:
            super().close()


def _open(address: BusAddress, opened: contextlib.ExitStack) -> can.BusABC:
    if address.interface == "virtual":
        # stamps that say when a frame has come over the modelled bus, not when this thread got round to it
        bus: can.BusABC = can.Bus(interface="virtual", channel=address.channel, preserve_timestamps=True)
    else:
        bus = open_bus(address)
    opened.callback(bus.shutdown)
    return bus
