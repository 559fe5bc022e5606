"""What signals do to a run: those that end a program end this one through DAMPING, and none suspends held motors."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from humanoid_sim.play.assembly import Run

__all__ = ["handled_signals"]

_ENDING = (signal.SIGINT, signal.SIGQUIT, signal.SIGTERM)


@contextmanager
def handled_signals(run: Run) -> Iterator[list[int]]:
    """Take over the signals for as long as the run lasts; gives the list of those received that end it.

    SIGINT, SIGQUIT, SIGTERM and a closed terminal end the run through DAMPING. Once the robot is closed nothing is left
    to protect, and they do what they do to any program. SIGTSTP suspends a simulation; a process that holds motors
    damps instead, and goes on. It also ignores what stops a process that uses a terminal in the background.
    """
    received: list[int] = []
    before: dict[int, signal.Handlers | int | Callable[[int, FrameType | None], object] | None] = {}
    keyboards = [] if run.keyboard is None else [run.keyboard]
    interruption = run.interruption

    def end(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a handler
        received.append(number)
        if run.plan.setup.robot.is_closed:
            for keyboard in keyboards:
                keyboard.restore_terminal()
            signal.signal(number, before[number])
            signal.raise_signal(number)
        run.session.request_stop(signal.Signals(number).name)

    def suspend(number: int, frame: FrameType | None) -> None:
        if interruption is not None and not run.plan.setup.robot.is_closed:
            interruption.refuse_suspension()
            return
        for keyboard in keyboards:
            keyboard.restore_terminal()
        signal.signal(number, signal.SIG_DFL)
        signal.raise_signal(number)  # returns when the process is continued
        signal.signal(number, suspend)
        proceed(number, frame)

    def proceed(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        if interruption is not None:
            interruption.note_continued()
        for keyboard in keyboards:
            keyboard.take_terminal()

    def take(number: int, handler: signal.Handlers | Callable[[int, FrameType | None], object]) -> None:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as SIGHUP is under nohup
            before[number] = signal.signal(number, handler)

    for ending in _ENDING:
        before[ending] = signal.signal(ending, end)
    take(signal.SIGHUP, end)
    take(signal.SIGTSTP, suspend)
    take(signal.SIGCONT, proceed)
    if interruption is not None:
        take(signal.SIGTTIN, signal.SIG_IGN)
        take(signal.SIGTTOU, signal.SIG_IGN)
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
