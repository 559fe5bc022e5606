"""Send an intent to a running session: `python -m humanoid_sim.mode damp`."""

from __future__ import annotations

import sys
import threading
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Sequence

# Nothing here loads NumPy, nor tyro: somebody waits for a DAMP.
from humanoid_sim.cli import ExitStatus, complain, run_program
from humanoid_sim.client import Intake, SessionError, SessionInfo, find_session, running_sessions
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
    try:
        sessions = running_sessions() if config.intent == "damp" and config.session is None else []
        sessions = sessions or [find_session(config.session)]
    except SessionError as error:
        raise InputError(str(error)) from None
    if len(sessions) == 1:
        try:
            return ExitStatus.of(_asked(sessions[0], config.intent))
        except SessionError as error:
            raise InputError(str(error)) from None
    return ExitStatus.of(_damped(sessions))


def _asked(session: SessionInfo, word: str) -> bool:
    """Whether a session grants what it is asked for; its answer is printed."""
    with Intake(session, "mode") as intake:
        answer = intake.ask(word, _REACTIVATE_TIMEOUT if word == "reactivate" else _TIMEOUT)
    print(f"{session}: {answer.text}")
    return answer.granted


def _damped(sessions: Sequence[SessionInfo]) -> bool:
    """Whether all sessions are damped. They are asked at once: one that does not answer keeps no other waiting."""
    granted: list[bool] = []

    def damp(session: SessionInfo) -> None:
        try:
            granted.append(_asked(session, "damp"))
        except SessionError as error:
            complain(f"error: {error}")

    threads = [threading.Thread(target=damp, args=(session,)) for session in sessions]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return len(granted) == len(sessions) and all(granted)


if __name__ == "__main__":
    sys.exit(run_program(main))
