"""A page for the operator of a running session: from the feed to pages, and from pages to the intake."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from humanoid_sim.cli import parse, run_program
from humanoid_sim.frontends.attach import Attachment, ready
from humanoid_sim.frontends.console.access import Access, checked_host
from humanoid_sim.frontends.dds.mirror import RobotElsewhere

_LOCAL = "127.0.0.1"
_LOOK = 0.04
"""s between two looks at the feed: the view moves 25 times a second."""


@dataclass(frozen=True)
class ConsoleConfig(RobotElsewhere):
    """Serve a page for the operator of a running session, to be opened in a browser."""

    host: str = _LOCAL
    """Address of this machine to serve on. Default: for browsers on this machine only."""
    port: int = 0
    """To serve on. Default: one that is free."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends; returns the exit status."""
    config = parse(ConsoleConfig, "console", arguments)
    host = checked_host(config.host)
    with config.shown("console") as found:
        if found is not None:
            asyncio.run(_serve(*found, host, config.port))
    return 0


async def _serve(
    attachment: Attachment, refresh: Callable[[], None] | None, ended: Callable[[], bool], host: str, port: int
) -> None:
    """Serve pages. Nothing that a page asks for goes to a robot elsewhere, which `refresh` shows."""
    # What the packages of the extra provide is imported where it is known that they are there.
    from humanoid_sim.frontends.console.hub import Hub  # noqa: PLC0415
    from humanoid_sim.frontends.console.scene import Scene  # noqa: PLC0415
    from humanoid_sim.frontends.console.server import serving  # noqa: PLC0415
    from humanoid_sim.frontends.console.showing import Showing  # noqa: PLC0415

    ending = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, ending.set)
    socket = attachment.session.path / f"{os.getpid()}.viser"
    scene = Scene(socket, attachment.model(), attachment.description, attachment.reference_ghost())
    hub = Hub(attachment, Showing(attachment, scene))
    try:
        async with serving(host, port, socket, hub.page) as gate:
            if refresh is None:
                ready(f"console on {gate.address(Access.CONTROL)}")
            ready(f"to watch only: {gate.address(Access.READ_ONLY)}")
            if host != _LOCAL:
                ready(f"warning: what goes over the network to and from {host}, tokens too, is not encrypted")
            while attachment.feed.is_running() and not ending.is_set() and not ended():
                if refresh is not None:
                    refresh()
                record = hub.look()
                if record is not None:
                    scene.show(record)
                await asyncio.sleep(_LOOK)
            await hub.say_goodbye()
    finally:
        hub.close()
        scene.close()


if __name__ == "__main__":
    sys.exit(run_program(main))
