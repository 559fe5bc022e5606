"""The DDS bridge: publishes a running session's topics on a network interface, and takes commands there."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

from humanoid_sim.cli import parse, run_program
from humanoid_sim.client import SessionError
from humanoid_sim.frontends.attach import attached
from humanoid_sim.frontends.dds.commands import CommandReader
from humanoid_sim.frontends.dds.telemetry import Telemetry
from humanoid_sim.ros2.dds.domain import LOOPBACK, Participant

_POLL = 0.002  # s that a command is waited for between two polls of the session


@dataclass(frozen=True)
class DdsConfig:
    """Serve a running session's topics to ROS 2 and other DDS programs on this machine, and take commands for REMOTE.

    The domain is that of ROS_DOMAIN_ID. Nothing leaves the machine unless an interface is named.
    """

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    interface: str = LOOPBACK
    """Serve another computer at this network interface instead, such as eth1, with joint states, IMU, mode, description
    and transforms alone. Anybody on that network can then command the robot in REMOTE."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until the session ends; returns the exit status."""
    config = parse(DdsConfig, "dds", arguments)
    is_local = config.interface == LOOPBACK
    with ExitStack() as stack:
        # On the machine itself nothing goes before commands for REMOTE; a network may be flooded by anybody.
        attachment = stack.enter_context(attached(config.session, "dds", niceness=0 if is_local else 5))
        participant = stack.enter_context(Participant(interface=config.interface))
        reader = CommandReader(attachment, participant, is_local=is_local)
        stack.callback(reader.close)
        telemetry = Telemetry(attachment, participant, is_local=is_local, received=reader.live_topics)
        print(f"domain {participant.domain} on {participant.interface}, for {attachment}", flush=True)
        if not is_local:
            print(f"warning: anybody on the network at {config.interface} can command the robot in REMOTE", flush=True)
        while attachment.is_running():
            try:
                reader.poll(_POLL)
            except SessionError:  # it has ended
                break
            for tick in attachment.ticks():
                telemetry.publish(tick)
    return 0


if __name__ == "__main__":
    sys.exit(run_program(main))
