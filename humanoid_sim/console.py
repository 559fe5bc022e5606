"""A page for the operator of a running session: viser's, behind a gate of its own."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from time import monotonic, sleep

from humanoid_sim.cli import parse, run_program
from humanoid_sim.frontends.attach import Attachment
from humanoid_sim.frontends.console.gate import Gate
from humanoid_sim.frontends.console.operator import Operator
from humanoid_sim.frontends.console.panel import Panel
from humanoid_sim.frontends.console.scene import Scene
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
    with config.source("console") as source, ExitStack() as stack:
        gate = Gate(config.host, config.port)
        scene = Scene(gate.serve(), source)
        stack.callback(scene.close)
        operator = Operator(source, gate) if isinstance(source, Attachment) else None
        if operator is not None:
            stack.callback(operator.close)
        panel = Panel(source, scene, operator)
        print(f"console on {gate.address}", flush=True)
        if config.host != _LOCAL:
            print("warning: what goes over the network, the token too, is not encrypted", flush=True)
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
    return 0


if __name__ == "__main__":
    sys.exit(run_program(main))
