"""A page for the operator of a running session: viser's, behind a gate of its own."""

from __future__ import annotations

import signal
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep

from humanoid_sim.cli import parse, run_program
from humanoid_sim.frontends.attach import Attachment, Source
from humanoid_sim.frontends.dds.mirror import Watched

_LOCAL = "127.0.0.1"
_TICK = 0.02  # s that a tick is waited for: commands leave that often
_FRAME = 0.04  # s between two pictures
_PANEL = 0.1  # s between two updates of the panel


@dataclass(frozen=True)
class ConsoleConfig(Watched):
    """Serve a page for the operator of a running session, to be opened in a browser."""

    host: str = _LOCAL
    """Address of this machine to serve on. Default: for browsers on this machine only."""
    port: int = 0
    """To serve on. Default: one that is free."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the session ends; returns the exit status."""
    config = parse(ConsoleConfig, "console", arguments)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with config.source("console") as source:
        _serve(source, config)
    return 0


def _serve(source: Source, config: ConsoleConfig) -> None:
    # What the packages of the extra provide is imported where it is known that they are there.
    from humanoid_sim.frontends.console.gate import Gate, checked_host  # noqa: PLC0415
    from humanoid_sim.frontends.console.operator import Operator  # noqa: PLC0415
    from humanoid_sim.frontends.console.panel import Panel  # noqa: PLC0415
    from humanoid_sim.frontends.console.scene import Scene  # noqa: PLC0415

    host = checked_host(config.host)
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="humanoid_sim-"))
        socket = Path(folder) / "viser"
        scene = Scene(socket, source)
        stack.callback(scene.close)
        operator = Operator(source) if isinstance(source, Attachment) else None
        gate = Gate(host, config.port, socket, operator.damp if operator else lambda: None)
        stack.callback(gate.close)
        if operator is not None:
            operator.gate = gate
            stack.callback(operator.close)
        panel = Panel(source, scene, operator)
        if operator is not None:
            print(f"console on {gate.control}", flush=True)
        print(f"to watch only: {gate.watch}", flush=True)
        if host != _LOCAL:
            print(f"warning: what goes over the network to and from {host}, tokens too, is not encrypted", flush=True)
        drawn = shown = 0.0
        while source.is_running():
            for tick in source.ticks(_TICK):
                panel.take(tick.record)
            if operator is not None:
                operator.step()
            if source.latest is not None and monotonic() - drawn > _FRAME:
                drawn = monotonic()
                scene.show(source.latest.record)
            if monotonic() - shown > _PANEL:
                shown = monotonic()
                gate.shown = panel.show()
        gate.shown = {**gate.shown, "ended": True}
        sleep(0.2)  # s, until every page has received that


if __name__ == "__main__":
    sys.exit(run_program(main))
