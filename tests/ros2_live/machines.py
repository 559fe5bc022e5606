"""Computers for tests: network and shared memory of their own, joined by a cable, on this machine."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PROGRAMS = Path(__file__).parent / "programs"
ROS_PYTHON = ROOT / ".venv-ros" / "bin" / "python"
CABLE = "eth1"
"""The device at both ends."""

_HOLD = "mount -t tmpfs tmpfs /dev/shm && ip link set lo up && echo ready && exec cat"
_LIMIT = 60.0
"""s; a program that should have ended long before."""


class Machine:
    """A computer of its own: programs that run on it share loopback, `/dev/shm` and the folder of sessions."""

    def __init__(self, folder: Path, beside=None) -> None:
        """Switch it on; `folder` is that of its users' sessions, and a cable is to lead to `beside`."""
        self._folder = folder
        self._programs: list[subprocess.Popen[str]] = []
        begin = ["unshare", "-rnm"] if beside is None else [*beside.command("unshare", "-nm")]
        pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
        self._holder = subprocess.Popen([*begin, "sh", "-c", _HOLD], text=True, **pipes)
        assert self._holder.stdout.readline() == "ready\n", "no namespaces of our own here"
        self.process = self._holder.pid

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for program in self._programs:
            if program.poll() is None:
                program.terminate()
        for program in self._programs:
            try:
                program.communicate(timeout=20.0)
            except subprocess.TimeoutExpired:
                program.kill()
                program.communicate()
        self._holder.communicate()

    def command(self, *arguments: str) -> list[str]:
        """What runs a command on it."""
        return ["nsenter", "-t", str(self.process), "-U", "-n", "-m", "--preserve-credentials", *arguments]

    def start(self, *arguments, environment=None, **options) -> subprocess.Popen[str]:
        """Start a program on it, which ends with it. Its output, errors included, is to be read."""
        clean = {name: os.environ[name] for name in ("PATH", "HOME", "LANG", "PYTHONPATH") if name in os.environ}
        env = {**clean, "XDG_RUNTIME_DIR": str(self._folder), "PYTHONUNBUFFERED": "1", **(environment or {})}
        program = subprocess.Popen(
            self.command(*arguments),
            env=env,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            **options,
        )
        self._programs.append(program)
        return program

    def run(self, *arguments: str, environment: Mapping[str, str] | None = None, **options: Any) -> str:
        """Run a program on it to its end, which must be a good one; its output."""
        program = self.start(*arguments, environment=environment, **options)
        output, _ = program.communicate(timeout=_LIMIT)
        assert program.returncode == 0, output
        return output

    def python(self, *arguments: str, **options: Any) -> subprocess.Popen[str]:
        """Start a program with this Python, which has no ROS 2."""
        return self.start(sys.executable, *arguments, **options)

    def ros(self, program: str, *arguments: str, **options: Any) -> subprocess.Popen[str]:
        """Start one of `programs/` with ROS 2's Python."""
        return self.start(str(ROS_PYTHON), str(PROGRAMS / program), *arguments, **options)

    def ask_ros(self, program: str, *arguments: str, environment: Mapping[str, str] | None = None) -> str:
        """Run one of `programs/` with ROS 2's Python to its end; its output without Fast DDS's own log."""
        output = self.run(str(ROS_PYTHON), str(PROGRAMS / program), *arguments, environment=environment)
        return "".join(line for line in output.splitlines(keepends=True) if not line.startswith("\x1b["))


def plug_in(one: Machine, other: Machine, device: str = CABLE, network: int = 7) -> None:
    """Lay a cable between two devices of that name: 10.7.0.1 at one machine, 10.7.0.2 at the other."""
    one.run("ip", "link", "add", device, "type", "veth", "peer", "name", device, "netns", str(other.process))
    for number, machine in enumerate((one, other), 1):
        machine.run("ip", "address", "add", f"10.{network}.0.{number}/24", "dev", device)
        machine.run("ip", "link", "set", device, "up")


def read_until(program: subprocess.Popen[str], wanted: str) -> list[str]:
    """The lines of a program up to one that holds a text."""
    lines = []
    for line in program.stdout:
        lines.append(line)
        if wanted in line:
            return lines
    raise AssertionError(f"it ended without '{wanted}': {''.join(lines)}")


def play(machine: Machine, *options: str, script: str = "hold 300") -> subprocess.Popen[str]:
    """Start a session on a machine, in simulation, where whoever sends an intent takes over."""
    return machine.python(
        "-m", "humanoid_sim.play", "--script", script, "--viewer", "none", "--record", "none", *options, cwd=ROOT
    )


def serve(machine: Machine, folder: Path = ROOT, **environment: str) -> subprocess.Popen[str]:
    """Start the services on a machine, as a user of ROS 2 does."""
    program = machine.start(
        str(ROS_PYTHON),
        "-m",
        "humanoid_sim.ros2_services",
        environment={**environment, "PYTHONPATH": str(ROOT)},
        cwd=folder,
    )
    read_until(program, "on this machine")
    return program
