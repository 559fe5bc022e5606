"""The DDS bridge: publishes a running session's topics on a network interface, and takes commands there."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from humanoid_sim.cli import parse, run_program
from humanoid_sim.frontends import require_packages
from humanoid_sim.frontends.attach import Attachment, attached, ready
from humanoid_sim.frontends.dds.commands import DEPTH, CommandReader, wanted_inputs
from humanoid_sim.frontends.dds.telemetry import Telemetry, served_topics
from humanoid_sim.ros2.dds.domain import LOOPBACK, Participant, is_wireless
from humanoid_sim.ros2.dds.endpoints import Reader
from humanoid_sim.ros2.topics import COMMAND_TOPIC, SAFETY_TOPIC, TOPICS

_NEWS_PERIOD = 1.0
"""s between two looks at what the session has refused."""


@dataclass(frozen=True)
class DdsConfig:
    """Serve a running session's topics to ROS 2 and other DDS programs on this machine, and take commands for REMOTE.

    The domain is that of ROS_DOMAIN_ID. Nothing leaves the machine unless an interface is named.
    """

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    interface: str = LOOPBACK
    """Serve another computer at this network interface instead, such as eth1, with joint states, IMU, mode, description
    and transforms alone. Whoever is on that network can then command the robot in REMOTE."""

    safety: bool = False
    """Take safety statuses from that network too. Whoever is there can then damp the robot. On this machine they always
    count."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until the session ends; returns the exit status."""
    config = parse(DdsConfig, "dds", arguments)
    require_packages("dds")
    with ExitStack() as stack:
        is_local = config.interface == LOOPBACK
        # On the machine itself nothing goes before commands for REMOTE; a network may be flooded by anybody.
        attachment = stack.enter_context(attached(config.session, "dds", niceness=0 if is_local else 5))
        participant = stack.enter_context(Participant(interface=config.interface))
        topics = served_topics(attachment, is_local=is_local)
        refusals = _Refusals(attachment)
        telemetry = Telemetry(attachment, participant, topics, live=is_local, news=refusals.news)
        commands = Reader(participant, COMMAND_TOPIC, TOPICS[COMMAND_TOPIC], depth=DEPTH)
        # A latched fault from before this program began counts, and so does one that its writer does not latch.
        statuses = [
            Reader(participant, SAFETY_TOPIC, TOPICS[SAFETY_TOPIC], depth=DEPTH, any_writer=any_writer)
            for any_writer in (False, True)
            if is_local or config.safety
        ]
        reader = CommandReader(
            attachment.session,
            attachment.header.joint_names,
            participant,
            commands,
            statuses,
            wanted_inputs(attachment) if is_local else {},
        )
        stack.callback(reader.close)
        reader.start()
        number = attachment.before_present()
        ready(f"domain {participant.domain} on {participant.interface}, for {attachment.session}")
        if not is_local:
            ready(f"warning: whoever is on the network at {config.interface} can command the robot in REMOTE")
        if is_wireless(config.interface):
            ready(f"warning: {config.interface} is wireless, expected a cable: REMOTE may stop at any moment")
        _serve(attachment, telemetry, reader, number)
    return 0


class _Refusals:
    """Lines for what the session has refused of late, from its status: a client elsewhere sees no console."""

    def __init__(self, attachment: Attachment) -> None:
        self._feed = attachment.feed
        self._known = set(self._feed.status().get("refused", ()))
        self._looked = time.monotonic()
        self._text = ""

    def news(self) -> str:
        """Return what happened in the last second, said for the next; empty for nothing."""
        now = time.monotonic()
        if now - self._looked >= _NEWS_PERIOD:
            self._looked = now
            status = self._feed.status()
            refused = status.get("refused", [])
            self._text = "; ".join(line for line in refused if line not in self._known)
            self._known = set(refused)
        return self._text


def _serve(attachment: Attachment, telemetry: Telemetry, reader: CommandReader, number: int) -> None:
    """Publish the ticks after that number until the session ends."""
    for samples in attachment.looks(number, min(max(0.1 * attachment.feed.control_period, 0.001), 0.005)):
        for sample in samples:
            telemetry.publish(sample)
        if reader.error is not None:
            raise reader.error


if __name__ == "__main__":
    sys.exit(run_program(main))
