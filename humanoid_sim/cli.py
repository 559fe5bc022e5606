"""Entry points: every program is `python -m humanoid_sim.<verb>` and also `humanoid-sim <verb>`."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Sequence

from humanoid_sim.errors import InputError, RobotError

__all__ = ["VERBS", "main", "run_program"]

VERBS = {
    "play": "run a policy on a robot, simulated by default",
    "policy": "show, check, stamp or diagnose a checkpoint",
    "mode": "send an intent to a running session",
    "replay": "repeat a recording bit for bit",
    "record": "look into a recording, or recover one that was cut off",
    "prepare": "check a motion from elsewhere on the robot and convert it; fetch a checkpoint",
    "record_dataset": "make a LeRobot dataset of recordings",
    "bench": "measure this machine's figures",
}

BAD_INPUT = 2
"""Exit status for what a user can mend."""
INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it: 128 + SIGINT."""


def run_program(program: Callable[[Sequence[str] | None], int], arguments: Sequence[str] | None = None) -> int:
    """Run a program; what its user can mend becomes one line on stderr and exit status 2."""
    try:
        return program(arguments)
    except (InputError, RobotError) as error:
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has left (`| head`); Python would complain once more while flushing at exit.
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - lives as long as the process
        return 1


def main(arguments: Sequence[str] | None = None) -> int:
    """`humanoid-sim <verb> …`."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if not words or words[0] in ("-h", "--help"):
        print("usage: humanoid-sim <verb> [options]\n")
        for verb, purpose in VERBS.items():
            print(f"  {verb:<14} {purpose}")
        print("\n'humanoid-sim <verb> --help' tells the rest.")
        return 0 if words else BAD_INPUT
    if words[0] == "--version":
        from humanoid_sim import __version__  # noqa: PLC0415 - only for this option

        print(__version__)
        return 0
    verb, *rest = words
    if verb not in VERBS:
        print(f"error: unknown verb '{verb}'; known: {', '.join(VERBS)}", file=sys.stderr)
        return BAD_INPUT
    module = importlib.import_module(f"humanoid_sim.{verb}")
    program: Callable[[Sequence[str] | None], int] = module.main
    return run_program(program, rest)
