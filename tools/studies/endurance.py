"""Run something for long, and tell whether its processes' memory, open files or threads grow.

python -m tools.studies.endurance --scenario play --robot lite_biped --seconds 7200
python -m tools.studies.endurance --scenario vector --seconds 1800
python -m tools.studies.endurance --scenario hardware --seconds 3600
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Self, TypeAlias

import gymnasium
import numpy as np

from humanoid_sim.cli import run_program
from humanoid_sim.command_line import parse
from humanoid_sim.errors import InputError, known_names

_CHANNEL = f"udp_multicast:239.74.164.{1 + os.getpid() % 250}"
_CYCLE = "damp; hold 1; load_a; wait; start_locomotion; hold 60; "
_SHORTEST = 60.0
"""s of a cycle, at least."""
_PAGE = 30.0
"""s after which a page is closed and opened again."""
_MEGABYTES = 4.0
"""Growth of the memory that is none: the index of a recording, the modes of its summary, what the allocator keeps."""
_PAGE_SIZE = os.sysconf("SC_PAGE_SIZE")
_ENVIRONMENTS = 64
_STEPS, _BEGUN = 100, "begun"
"""Steps of an episode, and the line that says that the second one is over."""
_RANDOMISATION = {
    "mass": (0.9, 1.1),
    "friction": (0.7, 1.3),
    "command_delay": (0.0, 0.02),
    "joint_position_noise": 0.01,
}

Programs: TypeAlias = "list[Program]"


@dataclass(frozen=True)
class EnduranceConfig:
    """Run a scenario, look at its processes now and then, and tell what grew; exit status 1 if something did.

    The first quarter warms up. Of the rest the first third's least is compared with the last third's: an open file or
    a thread more is growth, and so are 4 MB resident; PSS depends on who shares them. Ctrl-C ends the scenario sooner.
    """

    scenario: str = "play"
    """play: a robot follows its sample policy and is damped, again and again, recorded; one with a piano is not damped.
    vector: 64 randomised environments, their episodes short. hardware: emulated motors, driven in real time with page
    and DDS bridge."""
    robot: str = "lite"
    """Robot of play."""
    seconds: float = 7200.0
    """To run for: of play on the robot's clock, of the others on the wall."""
    period: float = 5.0
    """s between two looks."""
    steps: bool = False
    """Be the environments of vector."""

    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (
        ("--robot lite_biped", "two hours on the robot's clock"),
        ("--scenario vector --seconds 1800", "half an hour of environments"),
        ("--scenario hardware --seconds 3600", "an hour on emulated motors"),
    )


@dataclass
class Watched:
    """A process, and what was seen of it."""

    name: str
    rows: list[tuple[float, float, float, float, float]] = field(default_factory=list)
    """s on the wall, MB resident, MB of its own (PSS), open files, threads."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until the scenario ends; returns the exit status."""
    config = parse(EnduranceConfig, "tools.studies.endurance", arguments)
    if config.scenario not in _SCENARIOS:
        raise InputError(f"--scenario: {known_names('scenario', config.scenario, _SCENARIOS)}")
    if config.steps:
        return _step(config.seconds)
    seen: dict[int, Watched] = {}
    with tempfile.TemporaryDirectory() as folder, _SCENARIOS[config.scenario](config, Path(folder)) as programs:
        begin = time.monotonic()
        with contextlib.suppress(KeyboardInterrupt):
            while all(program.process.poll() is None for program in programs):
                _look(time.monotonic() - begin, programs, seen)
                time.sleep(config.period)
        failed = [f"FAILED: {program.name}: {program.process.poll()}" for program in programs if program.process.poll()]
    grown = [line for watched in seen.values() for line in growth(watched)]
    print(*failed, *grown, sep="\n", end="\n" if failed or grown else "")
    return 1 if grown or failed or not seen else 0


def _look(now: float, programs: Programs, seen: dict[int, Watched]) -> None:
    waiting = [program.process.pid for program in programs]
    while waiting:
        number = waiting.pop()
        place = Path(f"/proc/{number}")
        with contextlib.suppress(OSError):  # it may end meanwhile
            for task in (place / "task").iterdir():
                waiting += map(int, (task / "children").read_text().split())
            resident = 1e-6 * _PAGE_SIZE * int((place / "statm").read_text().split()[1])
            own = re.search(r"^Pss: +(\d+) kB", (place / "smaps_rollup").read_text(), re.MULTILINE)
            files, threads = (sum(1 for _ in (place / kind).iterdir()) for kind in ("fd", "task"))
            if number not in seen:
                words = (place / "cmdline").read_text().split("\0")
                is_module = "-m" in words
                seen[number] = Watched(" ".join(words[words.index("-m") + 1 :][:2] if is_module else words[:2])[-40:])
            seen[number].rows.append((now, resident, 1.024e-3 * int(own[1]) if own else resident, files, threads))


def growth(watched: Watched) -> list[str]:
    """Print a process's table; returns what grew."""
    rows = np.array(watched.rows[len(watched.rows) // 4 : -2])  # at the last two it may have been ending
    third = len(rows) // 3
    if third < 1:
        return []
    print(f"{watched.name}: {len(rows)} looks in {rows[-1, 0] - rows[0, 0]:.0f} s")
    print(f"    {'':10} {'first':>8} {'last':>8} {'maximum':>8} {'per hour':>9}")
    grown = []
    for column, name in enumerate(("RSS, MB", "PSS, MB", "open files", "threads"), 1):
        values = rows[:, column]
        slope = 3600.0 * float(np.polyfit(rows[:, 0], values, 1)[0])
        print(f"    {name:10} {values[0]:8.1f} {values[-1]:8.1f} {values.max():8.1f} {slope:+9.2f}")
        growth = float(values[-third:].min() - values[:third].min())
        if name != "PSS, MB" and growth > (_MEGABYTES if name == "RSS, MB" else 0.5):
            grown.append(f"GROWS: {watched.name}: {name} by {growth:.1f}")
    return grown


class Program:
    """A program that runs, with what it has printed; ended as by Ctrl-C. No other program finds its session."""

    def __init__(self, folder: Path, *command: str) -> None:
        self.name = " ".join(command[:2])
        self.lines: list[str] = []
        self.process = subprocess.Popen(
            [sys.executable, "-m", *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "XDG_RUNTIME_DIR": str(folder)},
        )
        self._reader = threading.Thread(target=lambda: self.lines.extend(self.process.stdout or ()))
        self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.process.send_signal(signal.SIGINT)
        self.process.wait()
        self._reader.join()
        if self.process.stdout is not None:
            self.process.stdout.close()

    def until(self, said: str) -> str:
        """Wait for a line; returns the group in it."""
        while not (found := re.search(said, "".join(self.lines))):
            if self.process.poll() is not None:
                raise InputError(f"{self.name} ended: {''.join(self.lines[-3:])}")
            time.sleep(0.1)
        return found[1]


def _script(seconds: float) -> tuple[str, ...]:
    return "--duration", str(seconds), "--script", f"hold 0.5; {_CYCLE * int(seconds / _SHORTEST + 1)}"


@contextlib.contextmanager
def _play(config: EnduranceConfig, folder: Path) -> Iterator[Programs]:
    output = ("--record", str(folder / "run.mcap"), "--viewer", "none", "--video", "none")
    script = _script(config.seconds)
    if "piano" in config.robot:  # its limp hands lie on keys, from where no STANDBY is to lift them
        script = (*script[:3], f"hold 0.5; damp; hold 1; load_a; wait; start_locomotion; hold {config.seconds:g}")
    with Program(folder, "humanoid_sim.play", "--robot", config.robot, *output, *script) as loop:
        loop.until("(standby reached)")
        yield [loop]
    print(*(line for line in loop.lines if "ticks" in line), sep="", end="")


@contextlib.contextmanager
def _vector(config: EnduranceConfig, folder: Path) -> Iterator[Programs]:
    steps = ("--scenario", "vector", "--steps", "--seconds", str(config.seconds))
    with Program(folder, "tools.studies.endurance", *steps) as environments:
        environments.until(f"({_BEGUN})")
        yield [environments]
    print(*environments.lines[1:], sep="", end="")


def _step(seconds: float) -> int:
    envs = gymnasium.make_vec(
        "humanoid_sim/LiteTracking-v0",
        num_envs=_ENVIRONMENTS,
        threads=2,
        max_episode_steps=_STEPS,
        randomisation=_RANDOMISATION,
    )
    envs.reset(seed=0)
    generator = np.random.default_rng(0)
    end, episodes, steps = math.inf, 0, 0
    while time.monotonic() < end:
        *_, terminated, truncated, _ = envs.step(generator.uniform(-0.3, 0.3, (_ENVIRONMENTS, 14)).astype(np.float32))
        episodes += int((terminated | truncated).sum())
        steps += 1
        if steps == 2 * _STEPS:
            print(_BEGUN, flush=True)
            end = time.monotonic() + seconds
    envs.close()
    print(f"{steps} steps of {_ENVIRONMENTS} environments, {episodes} episodes")
    return 0


@contextlib.contextmanager
def _hardware(config: EnduranceConfig, folder: Path) -> Iterator[Programs]:
    played = (
        *("--hardware", _CHANNEL, "--calibration", "none", "--policy", "lite_tracking", "--yes", "--no-gamepad"),
        *("--can-timeout", "0.5", "--allow-script", "--console", "--dds", "--viewer", "none"),
        *("--record", str(folder / "run.mcap")),
        *_script(config.seconds),
    )
    with Program(folder, "humanoid_sim.hardware", "emulate", "--channel", _CHANNEL) as motors:
        motors.until("(motors of)")
        with Program(folder, "humanoid_sim.play", *played) as loop:
            address = loop.until(r"console: .* (http://\S+)")
            loop.until("(standby reached)")
            pages = threading.Thread(target=_pages, args=(address, loop.process))
            pages.start()
            yield [loop, motors]
            loop.process.wait()
            pages.join()
    print(*loop.lines[-30:], sep="", end="")


def _pages(address: str, session: subprocess.Popen[str]) -> None:
    """Open a page and its view, look at both, and close them, again and again."""
    from websockets.exceptions import WebSocketException  # noqa: PLC0415 - of an extra
    from websockets.sync.client import connect  # noqa: PLC0415
    from websockets.typing import Origin  # noqa: PLC0415

    place = address.replace("http", "ws", 1)
    origin = Origin("/".join(address.split("/")[:3]))
    while session.poll() is None:
        with contextlib.suppress(OSError, WebSocketException), contextlib.ExitStack() as stack:
            sockets = [
                stack.enter_context(connect(f"{place}{end}", origin=origin, max_size=None))
                for end in ("console", "viser")
            ]
            end = time.monotonic() + _PAGE
            while time.monotonic() < end:
                for socket in sockets:
                    with contextlib.suppress(TimeoutError):
                        socket.recv(timeout=0.05)


_SCENARIOS = {"play": _play, "vector": _vector, "hardware": _hardware}


if __name__ == "__main__":
    sys.exit(run_program(main))
