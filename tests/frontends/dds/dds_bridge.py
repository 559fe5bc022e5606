"""The bridge as a program, and a DDS domain that nobody else on the machine is in."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager


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
def bridge() -> Iterator[subprocess.Popen[str]]:
    """`python -m humanoid_sim.dds` on the only session, once it is ready; killed at the end."""
    command = [sys.executable, "-u", "-m", "humanoid_sim.dds"]
    with subprocess.Popen(command, text=True, stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("domain ")
            yield process
        finally:
            process.kill()
