"""Send an intent to a running session: `python -m humanoid_sim.mode damp`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

# Nothing here loads NumPy, nor tyro: somebody waits for a DAMP.
from humanoid_sim.cli import ExitStatus, complain, parse, run_program
from humanoid_sim.client import SessionError, ask_sessions
from humanoid_sim.errors import InputError

Intent: TypeAlias = Literal[
    "damp", "load_a", "load_b", "start_locomotion", "start_remote", "quit", "reactivate", "policy"
]
WORDS: tuple[Intent, ...] = get_args(Intent)
_TIMEOUT, _REACTIVATE_TIMEOUT = 2.0, 30.0  # s; a bus may have many motors, each of which is identified


@dataclass(frozen=True)
class ModeOptions:
    """Send an intent to a session that runs on this machine, and print what became of it.

    damp goes to all sessions that run. reactivate, in ZERO_TORQUE or DAMPING, verifies and enables the robot afresh, as
    a relaunch would; the FSM then begins in ZERO_TORQUE. policy, in the same modes, selects one of several that are
    loaded. Exit status 1 if it was refused, or failed.
    """

    intent: Intent
    """Intent: damp (or stop), load_a, load_b, start_locomotion, start_remote, quit, reactivate or policy."""
    name: str = ""
    """Name of the policy to select: its file's, without .onnx."""
    session: int | None = None
    """Process id of the session. Default: the only one that runs."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `mode` with command-line arguments; returns the exit status: 1 if it was refused, or failed."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words[:1] in (["stop"], ["DAMP"], ["STOP"]):  # as somebody types who has no time to look it up
        words[0] = "damp"
    match words:
        case [word] if word in WORDS:  # read without tyro, which takes time to load
            options = ModeOptions(word)
        case _:
            options = parse(ModeOptions, "mode", words, positional=True)
    word = f"{options.intent} {options.name}".strip()
    timeout = _REACTIVATE_TIMEOUT if options.intent == "reactivate" else _TIMEOUT
    passed = True
    try:
        for session, answer in ask_sessions(word, options.session, producer="mode", timeout=timeout):
            if isinstance(answer, SessionError):
                complain(f"error: {answer}")
                passed = False
            else:
                print(f"{session}: {answer.text}")
                passed = passed and answer.granted
    except SessionError as error:
        raise InputError(str(error)) from None
    return ExitStatus.of(passed)


if __name__ == "__main__":
    sys.exit(run_program(main))
