"""The channels of a robot: locked, open, and what is heard on them."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.channel import Channel, OpenBus
from humanoid_sim.hardware.bus.lock import ChannelLock
from humanoid_sim.hardware.bus.opening import bus_hints
from humanoid_sim.hardware.imu.interface import Imu
from humanoid_sim.hardware.robot.checks import CheckList
from humanoid_sim.hardware.robot.requests import Requests
from humanoid_sim.hardware.robot.settings import AdapterSettings
from humanoid_sim.hardware.robot.table import MotorTable

__all__ = ["Link", "Locks", "open_link", "reopen"]

_POLL = 0.001
"""s"""


class Locks:
    """All channels of a robot for this session alone, from its first activation until it is closed."""

    def __init__(self) -> None:
        self._held: list[ChannelLock] = []

    def take(self, settings: AdapterSettings, checks: CheckList) -> None:
        """Lock every channel, or none; a channel that another session holds becomes a problem."""
        if self._held:
            return
        for address in settings.addresses:
            try:
                self._held.append(ChannelLock(address))
            except RobotError as error:
                checks.problem(str(address), str(error).removeprefix(f"{address}: "))
        if len(self._held) < len(settings.addresses):
            self.release()

    def release(self) -> None:
        """Let others have the channels. May be called twice."""
        for lock in self._held:
            lock.release()
        self._held.clear()


class Link:
    """All channels open, their frames going into one table."""

    def __init__(
        self, settings: AdapterSettings, *, clock: Callable[[], float], open_bus: OpenBus, checks: CheckList
    ) -> None:
        """Open every channel; one that cannot be opened becomes a problem.

        Args:
            settings: the robot's.
            clock: the robot's clock, s.
            open_bus: opens a channel.
            checks: takes what is wrong with a channel.
        """
        wiring, addresses = settings.wiring, settings.addresses
        self.opened = clock()
        self.sources = tuple(str(address) for address in addresses)
        self.table = MotorTable(wiring, settings.host_id, len(addresses))
        opened = []
        for index, address in enumerate(addresses):
            try:
                receive = functools.partial(self.table.receive, index)
                opened.append(Channel(address, receive, open_bus=open_bus, clock=clock))
            except RobotError as error:
                checks.problem(str(address), str(error).removeprefix(f"{address}: "))
                continue
            for hint in bus_hints(address, len(wiring.on_channel(index))):
                checks.warn(str(address), hint)
        self.channels = tuple(opened)
        self.requests = Requests(wiring, self.table, self.channels, settings.host_id)
        self.table.inbox = self.requests.collect

    @property
    def is_complete(self) -> bool:
        """Whether every channel is open."""
        return len(self.channels) == len(self.sources)

    @property
    def intruders(self) -> tuple[tuple[str, str], ...]:
        """Channel and sign of every other host that commands the robot's motors."""
        return tuple(
            (source, notes.intruder.text)
            for source, notes in zip(self.sources, self.table.channels, strict=True)
            if notes.intrusions
        )

    @property
    def unanswered(self) -> int:
        """Commands that no status has answered yet; those that a newer one replaced unsent are left out."""
        superseded = sum(channel.counters.superseded for channel in self.channels)
        return sum(slot.commanded - slot.acknowledged for slot in self.table.slots) - superseded

    def listen(self, duration: float) -> None:
        """Wait for what others say, s."""
        time.sleep(duration)

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

    def begin(self) -> None:
        """The motors are enabled: questions are over, and from here on only what happens next counts."""
        self.table.inbox = None
        for channel in self.channels:
            channel.forget_events()

    def close(self) -> None:
        """Close all channels. May be called twice."""
        self.table.inbox = None
        for channel in self.channels:
            channel.close()


def reopen(imu: Imu, checks: CheckList) -> None:
    """Open an IMU afresh; one that cannot be opened is a problem."""
    imu.close()
    try:
        imu.open()
    except RobotError as error:
        checks.problem("imu", str(error))


def open_link(settings: AdapterSettings, *, clock: Callable[[], float], open_bus: OpenBus, checks: CheckList) -> Link:
    """All channels open, if nothing was wrong before; the arguments are those of `Link`.

    Raises:
        RobotError: with everything that is wrong; no channel is open then.
    """
    if not checks.problems:
        link = Link(settings, clock=clock, open_bus=open_bus, checks=checks)
        if link.is_complete:
            return link
        link.close()
    raise RobotError(checks.refusal(settings.name))
