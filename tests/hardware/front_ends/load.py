"""Processor time that processes take, and others that take as much for nothing."""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

TICKS = os.sysconf("SC_CLK_TCK")
BURN = """
import sys, time
share, period, data = float(sys.argv[1]), 0.01, bytes(400_000)
begin, spent = time.monotonic(), time.process_time()
while True:
    due = share * (time.monotonic() - begin)
    while time.process_time() - spent < due:
        data[::7]
    behind = due - (time.process_time() - spent)
    if time.monotonic() - begin > 1.0:  # what was not had in a second is not made up for
        begin, spent = time.monotonic(), time.process_time()
    time.sleep(period)
"""
MOST = 0.8
"""Of one processor that one burning process takes."""


def descendants(process: int) -> list[int]:
    """Process ids: this one, and all that it and its children have started."""
    found = [process]
    for pid in found:
        for task in Path(f"/proc/{pid}/task").glob("*/children"):
            try:
                found += [int(name) for name in task.read_text().split()]
            except OSError:
                continue
    return found


def processor_time(processes: Sequence[int]) -> float:
    """s that these processes have taken so far, their ended children included."""
    total = 0
    for pid in processes:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        total += sum(map(int, fields[11:15]))
    return total / TICKS


@contextmanager
def burning(shares: dict[int, float]) -> Iterator[None]:
    """Processes that take these shares of a processor, by niceness."""
    with ExitStack() as stack:
        for niceness, share in shares.items():
            count = max(round(share / MOST + 0.5), 1)
            for _ in range(count):
                command = ["nice", "-n", str(niceness), sys.executable, "-c", BURN, f"{share / count}"]
                process = stack.enter_context(subprocess.Popen(command))
                stack.callback(process.kill)
        yield
