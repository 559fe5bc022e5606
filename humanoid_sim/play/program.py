"""One run from options to exit status."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rich.console import Console
from rich.progress import Progress

from humanoid_sim.play.assembly import Run, assemble
from humanoid_sim.play.config import PlayConfig
from humanoid_sim.play.report import print_report, summarise, write_summary
from humanoid_sim.rendering.video import save_snapshot
from humanoid_sim.session.session import Session

__all__ = ["play"]

_FAULT = 1
"""Exit status of a run in which a controller failed that nobody made fail on purpose."""


def play(config: PlayConfig) -> int:
    """Run, report, and return the exit status.

    0 for a run that ended as asked; 1 if a controller failed or a file could not be written; 128 plus the signal's
    number if a signal ended it.

    Raises:
        InputError: before anything moves.
    """
    console = Console(highlight=False, soft_wrap=not sys.stdout.isatty())
    run = assemble(config, console)
    _introduce(console, run)
    try:
        with _signals(run.session) as received:
            result = run.session.run()
    finally:
        for operator in run.operators:
            operator.close()
    summary = summarise(run, result)
    print_report(console, summary)
    status = _write_files(console, run)
    if run.outputs.summary is not None:
        write_summary(run.outputs.summary, summary)
        console.print(f"summary    {run.outputs.summary}")
    if received:
        return 128 + received[0]
    return _FAULT if status or (run.monitor.faults and not config.inject) else 0


def _introduce(console: Console, run: Run) -> None:
    if run.policy.warning:
        console.print(f"[bold white on red] {run.policy.warning} [/]")
    motion = "" if run.policy.motion_file is None else f", motion {run.policy.motion_file.name}"
    console.print(f"robot {run.description.name}, policy {run.policy.checkpoint.source}{motion}")
    for notice in run.notices:
        console.print(notice)


@contextmanager
def _signals(session: Session) -> Iterator[list[int]]:
    """SIGINT and SIGTERM end the run through DAMPING; gives the list of those received."""
    received: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the signature of a handler
        received.append(number)
        session.request_stop(signal.Signals(number).name)

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _write_files(console: Console, run: Run) -> int:
    """Draw what was asked for and name every file that the run left; returns 1 if one could not be written."""
    status = 0
    for part, error in (
        ("recording", run.recorder and run.recorder.error),
        ("final table", run.monitor.error),
        ("gravity compensation", run.gravity and run.gravity.error),
    ):
        if error:
            console.print(f"[bold red]{part} failed:[/] {error}")
            status = _FAULT
    if run.outputs.record is not None:
        console.print(
            f"recording  {run.outputs.record}   (repeat it: python -m humanoid_sim.replay {run.outputs.record})"
        )
    if run.video is not None:
        with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
            task = progress.add_task("drawing the video", total=None)
            report = run.video.render(lambda done, total: progress.update(task, completed=done, total=total))
        notice = f"   {report.notice}" if report.notice else ""
        console.print(f"video      {report.path}   drawn by {report.backend}{notice}")
    if run.outputs.snapshot is not None:
        pose = run.robot.qpos if run.monitor.pose is None else run.monitor.pose
        save_snapshot(run.outputs.snapshot, run.robot.model, pose)
        console.print(f"snapshot   {run.outputs.snapshot}")
    return status
