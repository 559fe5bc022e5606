"""The host's end of Robstride motors on open channels: what is heard of them, and questions to them."""

from __future__ import annotations

from collections.abc import Sequence

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.bus.open_channels import OpenChannels
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.hardware.motors import ChannelNotes, MotorGroup, check_intruders
from humanoid_sim.hardware.robstride.motor_table import MotorTable
from humanoid_sim.hardware.robstride.requests import Requests


class RobstrideLink:
    """Motors on some channels. Give it every frame that is no other family's."""

    def __init__(self, line: OpenChannels, motors: MotorGroup, host_id: int) -> None:
        """Talk to motors."""
        self.line = line
        self.channels, self.sources, self.opened = line.channels, line.sources, line.opened
        self.host_id = host_id
        self.expect(motors)

    def receive(self, channel: int, frame: Frame, time: float) -> bool:
        """Take a frame, whatever it is; True."""
        self.table.receive(channel, frame, time)
        return True

    def expect(self, motors: MotorGroup) -> None:
        """Talk to these motors from here on; what was heard of others is forgotten."""
        self.table = MotorTable(motors, self.host_id, len(self.channels))
        self.requests = Requests(motors, self.table, self.channels, self.host_id)

    @property
    def motors(self) -> MotorGroup:
        """That are talked to."""
        return self.requests.motors

    @property
    def notes(self) -> Sequence[ChannelNotes]:
        """Return what else was heard, by channel."""
        return self.table.channels

    @property
    def unanswered(self) -> int:
        """Commands that no status has answered yet; those that never left are left out."""
        unsent = sum(channel.counters.superseded + channel.counters.stale for channel in self.channels)
        return sum(slot.commanded - slot.acknowledged for slot in self.table.slots) - unsent

    def check_intruders(self, checks: CheckList) -> None:
        """Another master is a problem."""
        check_intruders(self.sources, self.notes, checks)

    def check(self, checks: CheckList) -> None:
        """Another master, and a channel that is down, are problems."""
        self.check_intruders(checks)
        self.line.check(checks)
