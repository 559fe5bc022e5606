"""The console's program: from the feed to pages, and from pages to the intake."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from humanoid_sim.command_line import parse
from humanoid_sim.errors import InputError
from humanoid_sim.frontends import require_packages
from humanoid_sim.frontends.attach import Attachment, attached, ready
from humanoid_sim.frontends.console.access import Access, checked_host

__all__ = ["ConsoleConfig", "main"]

_LOCAL = "127.0.0.1"
_LOOK = 0.04
"""s between two looks at the feed: the view moves 25 times a second."""


@dataclass(frozen=True)
class ConsoleConfig:
    """Serve a page for the operator of a running session, to be opened in a browser."""

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    host: str = _LOCAL
    """Address of this machine to serve on. Default: for browsers on this machine only."""
    port: int = 0
    """To serve on. Default: one that is free."""
    dds: bool = False
    """Show a robot on another machine, from its DDS topics alone, for watching only."""
    interface: str = ""
    """With --dds: the network interface at which the robot is, such as eth1."""
    prefix: str = "lite"
    """With --dds: what the robot's joint states are under."""

    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (("", "a page for the only session that runs"),)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends; returns the exit status."""
    config = parse(ConsoleConfig, "console", arguments)
    host = checked_host(config.host)
    _refuse_conflicts(config)
    require_packages("console")
    if config.dds:
        return _watch(config, host)
    with attached(config.session, "console") as attachment:
        asyncio.run(_serve(attachment, host, config.port))
    return 0


def _refuse_conflicts(config: ConsoleConfig) -> None:
    if not config.dds:
        if config.interface:
            raise InputError(f"--interface: is {config.interface}, which means nothing without --dds")
        return
    if config.session is not None:
        raise InputError(f"--session: is {config.session}, which means nothing with --dds, whose robot is elsewhere")
    if not config.interface:
        raise InputError("--interface: is needed with --dds: the one at which the robot is, such as eth1")


def _watch(config: ConsoleConfig, host: str) -> int:
    """Show a robot elsewhere: nothing that a page asks for goes anywhere."""
    require_packages("dds")
    from humanoid_sim.frontends.dds.mirror import mirrored  # noqa: PLC0415

    signals: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, _: signals.append(number))
    with mirrored(config.interface, config.prefix, told=ready, ended=lambda: bool(signals)) as found:
        if found is not None:
            attachment, mirror = found
            asyncio.run(_serve(attachment, host, config.port, mirror.look, lambda: bool(signals)))
    return 0


async def _serve(
    attachment: Attachment,
    host: str,
    port: int,
    refresh: Callable[[], None] | None = None,
    ended: Callable[[], bool] = lambda: False,
) -> None:
    """Serve pages; `refresh` is called before each look at a feed that shows a robot elsewhere."""
    # What the packages of the extra provide is imported where it is known that they are there.
    from humanoid_sim.frontends.console.hub import Hub  # noqa: PLC0415
    from humanoid_sim.frontends.console.scene import Scene  # noqa: PLC0415
    from humanoid_sim.frontends.console.server import serving  # noqa: PLC0415
    from humanoid_sim.frontends.console.showing import Showing  # noqa: PLC0415

    ending = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, ending.set)
    socket = Path(attachment.session.intents).parent / f"{os.getpid()}.viser"
    scene = Scene(socket, attachment.model(), attachment.description, attachment.reference_ghost())
    hub = Hub(attachment, Showing(attachment, scene.ghosts))
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
