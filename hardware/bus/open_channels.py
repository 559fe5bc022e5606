"""The channels that a robot's or a tool's motors are on: locked, and open."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Sequence

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import BusAddress, bus_hints, open_bus
from humanoid_sim.hardware.bus.channel import Channel, OpenBus
from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.bus.lock import ChannelLock
from humanoid_sim.hardware.checks import CheckList

Listener = Callable[[int, Frame, float], bool]
"""Takes a frame with its channel's index and its time (s, robot's clock), on the receiver's thread; whether it knows
the frame, which is then nobody else's."""

_POLL = 0.001
"""s"""
_PATIENCE = 0.8
"""Share of a control period after which a queue that refused a frame must be empty again."""


class Locks:
    """Some channels for this program alone: a robot's from its first activation until it is closed."""

    def __init__(self) -> None:
        self._held: list[ChannelLock] = []

    def take(self, addresses: Sequence[BusAddress], checks: CheckList) -> None:
        """Lock every channel, or none; a channel that another session holds becomes a problem."""
        if self._held:
            return
        for address in addresses:
            try:
                self._held.append(ChannelLock(address))
            except RobotError as error:
                checks.problem(str(address), str(error).removeprefix(f"{address}: "))
        if len(self._held) < len(addresses):
            self.release()

    @property
    def descriptors(self) -> tuple[int, ...]:
        """Return the locks' open files, see `ChannelLock.descriptor`; locks without a file are left out."""
        return tuple(lock.descriptor for lock in self._held if lock.descriptor >= 0)

    def release(self) -> None:
        """Let others have the channels. May be called twice."""
        for lock in self._held:
            lock.release()
        self._held.clear()


class OpenChannels:
    """Channels that are open; a frame goes to the first listener that knows it."""

    def __init__(
        self,
        addresses: Sequence[BusAddress],
        bursts: Sequence[int],
        checks: CheckList,
        *,
        clock: Callable[[], float] = time.monotonic,
        open_bus: OpenBus = open_bus,
        period: float = 0.02,
    ) -> None:
        """Open every channel, if nothing was wrong before.

        Args:
            bursts: frames that a control period puts into each channel's queue at once.
            clock: the robot's clock, s.
            period: s between commands.

        Raises:
            RobotError: with everything that is wrong; no channel is open then.
        """
        checks.refuse()
        self.clock = clock
        """s, the robot's."""
        self.opened = clock()
        self.listeners: list[Listener] = []
        """In the order in which they are asked."""
        self.sources = tuple(str(address) for address in addresses)
        opened: list[Channel] = []
        for index, (address, burst) in enumerate(zip(addresses, bursts, strict=True)):
            try:
                receive = functools.partial(self._receive, index)
                opened.append(Channel(address, receive, open_bus=open_bus, clock=clock, patience=_PATIENCE * period))
            except RobotError as error:
                checks.problem(str(address), str(error).removeprefix(f"{address}: "))
                continue
            for hint in bus_hints(address, burst):
                checks.warn(str(address), hint)
        self.channels = tuple(opened)
        if checks.problems:
            self.close()
            checks.refuse()

    def _receive(self, channel: int, frame: Frame, when: float) -> None:
        any(listener(channel, frame, when) for listener in self.listeners)

    def check(self, checks: CheckList) -> None:
        """Report each channel that is down as a problem."""
        for source, channel in zip(self.sources, self.channels, strict=True):
            if channel.down:
                checks.problem(source, f"down: {channel.down}")

    def wait(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Wait for what the receivers hear, `timeout` s at most; whether it came."""
        deadline = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > deadline:
                return False
            time.sleep(_POLL)
        return True

    def forget_queues(self) -> None:
        """Drop what waits to be sent: after a jam, what comes next must not stand behind what is no longer wanted."""
        for channel in self.channels:
            channel.forget_queue()

    def forget_events(self) -> None:
        """Drop past events of every channel."""
        for channel in self.channels:
            channel.forget_events()

    def close(self) -> None:
        """Close all channels. May be called twice."""
        for channel in self.channels:
            channel.close()
