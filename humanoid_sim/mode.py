"""Send an intent to a running session: `python -m humanoid_sim.mode damp`."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Sequence

# Nothing here loads NumPy, nor tyro: somebody waits for a DAMP.
from humanoid_sim.cli import ExitStatus, complain, run_program
from humanoid_sim.client import SessionError, ask_sessions
from humanoid_sim.errors import InputError

__all__ = ["main"]

WORDS = ("damp", "load_a", "load_b", "start_locomotion", "start_remote", "quit", "reactivate")

_TIMEOUT = 2.0
_REACTIVATE_TIMEOUT = 30.0
"""s; a bus may have many motors, each of which is asked for its identity."""


_HELP = """\
Send an intent to a session that runs on this machine, and print what became of it.

damp goes to all sessions that run. reactivate, in ZERO_TORQUE or DAMPING, verifies and enables the
robot afresh, as a relaunch would; the FSM then begins in ZERO_TORQUE.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `mode` with command-line arguments; returns the exit status: 1 if it was refused, or failed."""
    parser = ArgumentParser("humanoid_sim.mode", description=_HELP, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("intent", choices=WORDS, help="what to ask for")
    parser.add_argument("--session", type=int, help="process id of the session; default: the only one that runs")
    config = parser.parse_args(arguments)
    timeout = _REACTIVATE_TIMEOUT if config.intent == "reactivate" else _TIMEOUT
    granted, problems = [], []
    try:
        for session, answer in ask_sessions(config.intent, config.session, producer="mode", timeout=timeout):
            if isinstance(answer, SessionError):
                problems.append(answer)
            else:
                granted.append(answer.granted)
                print(f"{session}: {answer.text}")
    except SessionError as error:
        problems.append(error)
    if not granted and len(problems) == 1:
        raise InputError(str(problems[0]))
    for problem in problems:
        complain(f"error: {problem}")
    return ExitStatus.of(all(granted) and not problems)


if __name__ == "__main__":
    sys.exit(run_program(main))
