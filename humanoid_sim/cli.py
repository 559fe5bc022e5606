"""Entry points: every program is `python -m humanoid_sim.<verb>` and also `humanoid-sim <verb>`."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import sys
import textwrap
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any

from humanoid_sim.errors import InputError, RobotError, known_names

VERBS = {
    "play": "run a policy on a robot, simulated by default",
    "robot": "show what is read from an MJCF, and make an MJCF of a URDF",
    "policy": "show, check, stamp or diagnose a checkpoint",
    "mode": "send an intent to a running session",
    "replay": "repeat a recording bit for bit",
    "record": "look into a recording, export it, or make a LeRobot dataset of it",
    "prepare": "check a motion from elsewhere on the robot and convert it; fetch a checkpoint",
    "regress": "compare policies over a suite, with confidence intervals; exit 1 on a regression",
    "hardware": "find, test and calibrate motors on a CAN bus, or emulate them",
    "gamepad": "drive a running session with a gamepad",
    "midi": "send to a running session which keys of a MIDI keyboard are down",
    "gravity": "compensate gravity in REMOTE, on a running session",
    "console": "serve a page for the operator, on a running session",
    "viewer": "watch a running session in a window, or move a robot's joints by sliders",
    "dds": "serve a running session to ROS 2 and DDS, and take commands for REMOTE",
    "rerun": "watch a running session in rerun's viewer",
    "ros2_services": "serve the modes of a running session as ROS 2 services, with ROS 2's Python",
}
_MODULES = {"policy": "policy_tools", "hardware": "hardware.tools"}  # verbs whose program is another module


class ExitStatus(IntEnum):
    """Exit status of every program; if a signal ends the run, it is 128 plus the signal's number."""

    OK = 0
    FAILED = 1  # it ran, and something failed, or is worse than it may be
    BAD_INPUT = 2  # it did not run: what was given cannot be used, and a user can fix that
    NO_ANSWER = 3  # a motor, or all of them, stayed silent
    INTERRUPTED = 130  # Ctrl-C, as shells have it: 128 + SIGINT

    @classmethod
    def of(cls, passed: bool) -> ExitStatus:
        return cls.OK if passed else cls.FAILED


def parse(options: Any, program: str, arguments: Sequence[str] | None, *, positional: bool = False) -> Any:
    """Return a program's options, of a frozen dataclass or a union of those of its commands; exits for --help.

    `program` is the verb, or a file such as `examples/mine.py`; with `positional` required options are given by their
    place. Raises `InputError` with what tyro says about options that are not accepted.
    """
    import tyro  # noqa: PLC0415 - a DAMP does without it

    conf = tyro.conf
    markers = (conf.FlagCreatePairsOff, conf.OmitSubcommandPrefixes, *[conf.PositionalRequiredArgs] * positional)
    run = f"python {program}" if "." in program else f"python -m humanoid_sim.{program}"
    box = io.StringIO()
    try:
        with contextlib.redirect_stderr(box):
            return tyro.cli(options, prog=run, args=arguments, config=markers)
    except SystemExit as stop:
        if not stop.code:
            raise
        rows = (line.strip(" │╰╯") for line in box.getvalue().splitlines()[1:])  # below the title
        text = " ".join(row if row.strip("─-") else ";" for row in rows if row)  # a rule between two parts
        raise InputError(text.strip("; ").replace(" ;", ";")) from None


def run_program(program: Callable[[Sequence[str] | None], int], arguments: Sequence[str] | None = None) -> int:
    """Run a program; what its user can fix becomes one line on stderr and exit status 2."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        status = program(arguments)
        sys.stdout.flush()
        return status
    except (InputError, RobotError) as error:
        complain(f"error: {error}")
    except BrokenPipeError:  # the reader has left, as in `| head`
        mute_output()
        return ExitStatus.FAILED
    except OSError as error:
        complain(f"error: {'' if error.filename is None else f'{error.filename}: '}{error.strerror or error}")
    except KeyboardInterrupt:
        complain("interrupted")
        return ExitStatus.INTERRUPTED
    return ExitStatus.BAD_INPUT


def complain(message: str) -> None:
    """Print one line on stderr: names from a user's file may hold characters that end it, or steer a terminal."""
    line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in message)
    with contextlib.suppress(OSError):  # nobody reads it
        print(line, file=sys.stderr)


def mute_output() -> None:
    """Send what is printed from here on nowhere, and what Python still holds back of stdout as well."""
    broken, sys.stdout = sys.stdout, open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - lives as long as we do
    with contextlib.suppress(OSError, ValueError):  # a stdout that is not a file
        os.dup2(sys.stdout.fileno(), broken.fileno())


def main(arguments: Sequence[str] | None = None) -> int:
    """`humanoid-sim <verb> …`."""
    return run_program(_run_verb, sys.argv[1:] if arguments is None else arguments)


def _run_verb(words: Sequence[str] | None) -> int:
    verb, *arguments = words or ("--help",)
    if verb not in ("-h", "--help", "--version"):
        return load_program(verb)(arguments)
    if verb == "--version":
        from humanoid_sim import __version__  # noqa: PLC0415 - only here

        print(__version__)
        return ExitStatus.OK
    print("usage: python -m humanoid_sim VERB [options], or: humanoid-sim VERB [options]\n")
    for name, purpose in VERBS.items():
        print(textwrap.fill(purpose, 80, initial_indent=f"  {name:<16}", subsequent_indent=" " * 18))
    print("\nBegin with `python -m humanoid_sim play`. `VERB --help` describes a verb.")
    return ExitStatus.OK


def load_program(verb: str) -> Callable[[Sequence[str] | None], int]:
    """Return the program of a verb, imported now."""
    if verb not in VERBS:
        raise InputError(known_names("verb", verb, VERBS))
    program: Callable[[Sequence[str] | None], int]
    program = importlib.import_module(f"humanoid_sim.{_MODULES.get(verb, verb)}").main
    return program
