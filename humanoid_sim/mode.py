"""Send an intent to a running session: `python -m humanoid_sim.mode damp`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import tyro

from humanoid_sim.cli import ExitStatus, run_program
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Intent
from humanoid_sim.session.control_socket import running_sessions, send_intent, send_reactivate
from humanoid_sim.session.reactivation import REACTIVATE

__all__ = ["main"]

Word = Literal["damp", "load_a", "load_b", "start_locomotion", "start_remote", "quit", "reactivate"]


@dataclass(frozen=True)
class ModeConfig:
    """Send an intent to a session that runs on this machine, and print what became of it."""

    intent: tyro.conf.Positional[Word]
    """What to ask for. reactivate, in ZERO_TORQUE or DAMPING, verifies and enables the robot afresh, as a relaunch
    would; the FSM then begins in ZERO_TORQUE."""
    session: int | None = None
    """Process id of the session. Default: the only one that runs."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `mode` with command-line arguments; returns the exit status: 1 if it was refused, or failed."""
    config = tyro.cli(ModeConfig, prog="humanoid_sim.mode", args=arguments)
    sessions = running_sessions()
    session = config.session
    if session is None:
        if not sessions:
            raise InputError("no session is running; start one with play")
        if len(sessions) > 1:
            running = ", ".join(str(process) for process in sessions)
            raise InputError(f"--session: is needed where several sessions run; running: {running}")
        session = sessions[0]
    elif session not in sessions:
        running = ", ".join(str(process) for process in sessions) or "none"
        raise InputError(f"--session: {session} is no running session; running: {running}")
    word = config.intent
    answer = send_reactivate(session) if word == REACTIVATE else send_intent(session, Intent(word))
    print(f"session {session}: {answer.text}")
    return ExitStatus.of(answer.granted)


if __name__ == "__main__":
    sys.exit(run_program(main))
