"""Front ends as programs, the bridge among them, and a DDS domain that nobody else on the machine is in."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


def free_domain() -> int:
    """A domain whose port for discovery (DDSI-RTPS 9.6.2) nobody has."""
    for step in range(100):
        domain = 1 + (os.getpid() + step) % 100
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", 7400 + 250 * domain))
            except OSError:
                continue
            return domain
    raise AssertionError("all DDS domains are taken")


@contextmanager
def program(name: str, *options: str, says: str, **streams: Any) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`python -m humanoid_sim.NAME`, once its first line begins so, and that line; killed at the end."""
    command = [sys.executable, "-u", "-m", f"humanoid_sim.{name}", *options]
    with subprocess.Popen(command, text=True, **{"stdout": subprocess.PIPE, **streams}) as process:
        try:
            line = process.stdout.readline()
            assert line.startswith(says), line
            yield process, line
        finally:
            process.kill()


@contextmanager
def bridge() -> Iterator[subprocess.Popen[str]]:
    """`python -m humanoid_sim.dds` on the only session, once it is ready."""
    with program("dds", says="domain ") as (process, _):
        yield process
