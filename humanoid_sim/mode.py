"""Send an intent to a running session: `python -m humanoid_sim.mode damp`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

# Nothing here loads NumPy, nor tyro: somebody waits for a DAMP.
from humanoid_sim.cli import ExitStatus, complain, run_program
from humanoid_sim.client import SessionError, ask_sessions
from humanoid_sim.errors import InputError

Intent: TypeAlias = Literal[
    "damp", "load_a", "load_b", "start_locomotion", "start_remote", "quit", "reactivate", "policy"
]
WORDS: tuple[Intent, ...] = get_args(Intent)

_TIMEOUT = 2.0
_REACTIVATE_TIMEOUT = 30.0
"""s; a bus may have many motors, each of which is identified."""


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
    if words[:1] == ["stop"]:  # as somebody types who has no time to look it up
        words[0] = "damp"
    config = _read_usual(words)
    if config is None:
        from humanoid_sim.cli import parse  # noqa: PLC0415 - help, and what is wrong, may take a moment

        config = parse(ModeOptions, "mode", words, positional=True)
    word = f"{config.intent} {config.name}".strip()
    return _ask(word, config.session, _REACTIVATE_TIMEOUT if config.intent == "reactivate" else _TIMEOUT)


def _ask(word: str, process: int | None, timeout: float) -> int:
    """Ask, and print what became of it; returns the exit status."""
    granted, problems = [], []
    try:
        for session, answer in ask_sessions(word, process, producer="mode", timeout=timeout):
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


def _read_usual(words: Sequence[str]) -> ModeOptions | None:
    """Return what is usually typed, read without anything that takes time to load; None: it is something else."""
    match words:
        case [word] if word in WORDS:
            return ModeOptions(word)
        case [word, "--session", number] if word in WORDS and number.isascii() and number.isdecimal():
            return ModeOptions(word, session=int(number))
    return None


if __name__ == "__main__":
    sys.exit(run_program(main))
