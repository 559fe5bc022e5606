"""The channels that motors are on: locked, open, and what is heard on them."""

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
from humanoid_sim.hardware.robstride.motor_table import MotorGroup, MotorTable
from humanoid_sim.hardware.robstride.requests import Requests

__all__ = ["Locks", "OpenChannels"]

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

    def release(self) -> None:
        """Let others have the channels. May be called twice."""
        for lock in self._held:
            lock.release()
        self._held.clear()


class OpenChannels:
    """Channels that are open, their frames going into one table."""

    def __init__(
        self,
        addresses: Sequence[BusAddress],
        motors: MotorGroup,
        host_id: int,
        checks: CheckList,
        *,
        clock: Callable[[], float] = time.monotonic,
        open_bus: OpenBus = open_bus,
        period: float = 0.02,
    ) -> None:
        """Open every channel, if nothing was wrong before.

        Args:
            addresses: the channels.
            motors: that are talked to.
            host_id: our own id.
            checks: takes what is wrong with a channel.
            clock: the robot's clock, s.
            open_bus: opens a channel.
            period: s between commands.

        Raises:
            RobotError: with everything that is wrong; no channel is open then.
        """
        checks.refuse()
        self.opened = clock()
        self.sources = tuple(str(address) for address in addresses)
        self.host_id = host_id
        self.table = MotorTable(motors, host_id, len(addresses))
        opened: list[Channel] = []
        for index, address in enumerate(addresses):
            try:
                receive = functools.partial(self._receive, index)
                opened.append(Channel(address, receive, open_bus=open_bus, clock=clock, patience=_PATIENCE * period))
            except RobotError as error:
                checks.problem(str(address), str(error).removeprefix(f"{address}: "))
                continue
            for hint in bus_hints(address, len(motors.on_channel(index))):
                checks.warn(str(address), hint)
        self.channels = tuple(opened)
        self.requests = Requests(motors, self.table, self.channels, host_id)
        if checks.problems:
            self.close()
            checks.refuse()

    def _receive(self, channel: int, frame: Frame, when: float) -> None:
        self.table.receive(channel, frame, when)

    def expect(self, motors: MotorGroup) -> None:
        """Talk to these motors from here on; what was heard of others is forgotten."""
        self.table = MotorTable(motors, self.host_id, len(self.channels))
        self.requests = Requests(motors, self.table, self.channels, self.host_id)

    @property
    def motors(self) -> MotorGroup:
        """That are talked to."""
        return self.requests.motors

    @property
    def intruders(self) -> tuple[tuple[str, str], ...]:
        """Channel and sign of every other host that commands these motors."""
        return tuple(
            (source, notes.intruder.text)
            for source, notes in zip(self.sources, self.table.channels, strict=True)
            if notes.intrusions
        )

    @property
    def unanswered(self) -> int:
        """Commands that no status has answered yet; those that never left are left out."""
        unsent = sum(channel.counters.superseded + channel.counters.stale for channel in self.channels)
        return sum(slot.commanded - slot.acknowledged for slot in self.table.slots) - unsent

    def check_intruders(self, checks: CheckList) -> None:
        """Another master is a problem."""
        for source, text in self.intruders:
            checks.problem(source, f"another master drives these motors: {text}")

    def check(self, checks: CheckList) -> None:
        """Another master, and a channel that is down, are problems."""
        self.check_intruders(checks)
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
