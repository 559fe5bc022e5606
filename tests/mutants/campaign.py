"""Sends mutants to a worker one by one, ends it where it hangs, and starts another where it died."""

import contextlib
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["Count", "Worker", "run_campaign", "table"]

CPU_LIMIT = 10.0
"""s of processor time that a mutant may take: a busy machine does not count."""
WALL_LIMIT = 60.0
"""s of wall time."""
_START_LIMIT = 120.0


@dataclass(slots=True)
class Count:
    """What came of a reader's mutants."""

    mutants: int = 0
    refused: int = 0
    accepted: int = 0
    slowest: float = 0.0
    """s of processor time."""
    found: list[str] = field(default_factory=list)


class Worker:
    """A process that reads mutants."""

    def __init__(self, folder: Path, seed: int, module: str = "targets", cpu_limit: float = CPU_LIMIT) -> None:
        self._cpu_limit = cpu_limit
        self._log = folder = Path(tempfile.mkdtemp(dir=folder))
        reading, writing = os.pipe()
        words = [str(Path(__file__).with_name("worker.py")), str(folder), str(seed), module, str(writing)]
        self._process = subprocess.Popen(
            [sys.executable, *words], stdin=subprocess.PIPE, stderr=subprocess.PIPE, pass_fds=(writing,)
        )
        os.close(writing)
        self._answers = os.fdopen(reading, "rb", buffering=0)
        self._pending = b""
        if self._line(_START_LIMIT, _START_LIMIT) != "ready":
            self._process.kill()
            problem = self._process.communicate()[1].decode()
            self.close()
            raise AssertionError(f"the worker did not start: {problem[-3000:]}{_tail(folder / 'printed')}")

    def read(self, name: str, number: int) -> tuple[dict[str, object], float]:
        """What came of a mutant, and its processor time in s."""
        assert self._process.stdin is not None
        start = self._cpu()
        try:
            self._process.stdin.write(f"{name} {number}\n".encode())
            self._process.stdin.flush()
        except BrokenPipeError:
            return {"came": "died", "text": self.last_words()}, 0.0
        line = self._line(self._cpu_limit, WALL_LIMIT)
        if line in ("died", "hangs"):
            return {"came": line, "text": self.last_words()}, self._cpu_limit
        answer: dict[str, object] = json.loads(line)
        return answer, self._cpu() - start

    def last_words(self) -> str:
        """What it printed last, and how it ended."""
        self._process.kill()
        self._process.wait()
        return f"status {self._process.returncode} {_tail(self._log / 'printed')}"

    def _line(self, cpu_limit: float, wall_limit: float) -> str:
        start, cpu = time.monotonic(), self._cpu()
        while b"\n" not in self._pending:
            if select.select([self._answers], [], [], 0.2)[0]:
                data = self._answers.read(65536)
                if not data:
                    return "died"
                self._pending += data
            elif self._cpu() - cpu > cpu_limit or (time.monotonic() - start > wall_limit and not self._is_starved()):
                return "hangs"
        line, _, self._pending = self._pending.partition(b"\n")
        return line.decode()

    def _is_starved(self) -> bool:
        """Whether it would run, if the machine let it: it is then bounded by its processor time alone."""
        try:
            state = Path(f"/proc/{self._process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]
        except OSError:
            return False
        return state == "R"

    def _cpu(self) -> float:
        try:
            fields = Path(f"/proc/{self._process.pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        self._answers.close()
        for stream in (self._process.stdin, self._process.stderr):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):
                    stream.close()


def _tail(path: Path) -> str:
    return path.read_text(errors="replace")[-3000:] if path.is_file() else ""


def run_campaign(
    folder: Path, seed: int, mutants: Mapping[str, int], module: str = "targets", cpu_limit: float = CPU_LIMIT
) -> dict[str, Count]:
    """Read so many mutants of each reader's file; what came of them by reader.

    Args:
        folder: to work in.
        seed: of the mutants.
        mutants: how many, by the reader's name.
        module: whose `TARGETS` the readers are.
        cpu_limit: s of processor time for one mutant.
    """
    counts = {name: Count() for name in mutants}
    worker = Worker(folder, seed, module, cpu_limit)
    try:
        for name, number in _numbered(mutants):
            count = counts[name]
            answer, seconds = worker.read(name, number)
            came = answer["came"]
            count.mutants += 1
            count.slowest = max(count.slowest, seconds)
            if came in ("died", "hangs"):
                worker.close()
                count.found.append(f"mutant {number}: the process {came}: {answer['text']}")
                worker = Worker(folder, seed, module, cpu_limit)
                continue
            problems = [str(answer["text"])] if came == "found" else []
            problems += [f"printed {answer['printed']!r}"] if answer["printed"] else []
            problems += [f"left {answer['left']}"] if answer["left"] else []
            if problems:
                count.found.append(f"mutant {number}: {'; '.join(problems)}")
            elif came == "refused":
                count.refused += 1
            else:
                count.accepted += 1
    finally:
        worker.close()
    return counts


def _numbered(mutants: Mapping[str, int]) -> Iterator[tuple[str, int]]:
    for name, count in mutants.items():
        for number in range(count):
            yield name, number


def table(counts: Mapping[str, Count]) -> str:
    """The counts, a line for each reader, and what was found, each finding once."""
    lines = [f"{'reader':<22}{'mutants':>9}{'refused':>9}{'accepted':>9}{'found':>7}  slowest"]
    for name, count in counts.items():
        numbers = f"{count.mutants:>9}{count.refused:>9}{count.accepted:>9}{len(count.found):>7}"
        lines.append(f"{name:<22}{numbers}  {count.slowest:.2f} s of processor time")
        lines += [f"    {text}" for text in count.found[:5]]
    return "\n".join(lines)


if __name__ == "__main__":  # python campaign.py SEED MUTANTS [part of a reader's name]
    from targets import TARGETS

    chosen = [name for name in TARGETS if len(sys.argv) < 4 or sys.argv[3] in name]
    with tempfile.TemporaryDirectory() as place:
        wanted = {name: max(1, round(int(sys.argv[2]) * TARGETS[name].weight)) for name in chosen}
        print(table(run_campaign(Path(place), int(sys.argv[1]), wanted)))
