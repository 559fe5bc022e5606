"""One run from options to exit status."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.markup import escape

from humanoid_sim.cli import ExitStatus, mute_output
from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.play.assembly import Run
from humanoid_sim.play.console import PlayConsole
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.plan import Plan
from humanoid_sim.play.report import print_report, summarise, write_summary
from humanoid_sim.session.requests import flattened
from humanoid_sim.session.session import SessionResult


class Outcome(NamedTuple):
    """A run that has ended, as `play` reports it."""

    status: int
    summary: dict[str, Any]  # the final table, as `--summary` writes it; empty after a dry run
    problems: tuple[str, ...]  # parts of the run that failed while it went on, a line each


def played(config: PlayConfig, console: PlayConsole) -> Outcome:
    """Run, and report on a console.

    The status is 0 for a run that ended as asked; 1 if a controller failed, a safety status was not OK, the robot fell
    or a file could not be written; 128 plus the signal's number if a signal ended it. Raises `InputError` before
    anything moves.
    """
    with ExitStack() as left:
        plan = Plan(config, left)
        for warning in (one.warning for one in plan.policies.choices if one.warning):
            console.print(f" {warning} ", style="bold white on red", markup=False)
        console.print(f"robot {plan.description.name}, policy {plan.policies.label}", markup=False)
        for notice in plan.notices:
            console.print(f"note: {notice}", markup=False, style="dim")
        left.callback(plan.setup.robot.close)
        if not plan.setup.bring_up(config, console):
            return Outcome(0, {}, ())
        run = Run(plan, console)
        try:
            with _handled_signals(run) as received:
                result = run.session.run()
        except RobotError as error:  # it could not be activated, although it could be prepared
            raise RobotError(flattened(str(error))) from None
        finally:
            run.close()
            if run.console.error is not None or run.console.is_alive:
                mute_output()  # what is printed from here on would fail as well, or wait as that thread does
                console = PlayConsole(quiet=console.quiet)  # that thread may hold the lock of the other one
        problems = _problems(run, result)
        summary = summarise(run, result)
    print_report(console, summary)
    is_automatic = config.script is None and plan.steps is not None and config.remote == "none"
    if is_automatic and plan.policies.first is not None and not summary["inferences"]:
        console.print("note: the policy did not run: the run ended before LOCOMOTION")
    _write_files(console, run, summary, problems)
    for problem in problems:
        console.print(f"[bold red]failed:[/] {escape(problem)}")
    fell = summary["base"] is not None and summary["base"]["fall"] is not None
    passed = not (fell or problems or summary["faults"] or summary["safety"])
    return Outcome(128 + received[0] if received else ExitStatus.of(passed), summary, tuple(problems))


def _problems(run: Run, result: SessionResult) -> list[str]:
    """Return the parts of the run that failed while it went on."""
    found = list(result.failures)
    failure = run.plan.setup.failure()
    if failure:
        found.append(f"robot: {failure}")
    for part, sink in (("recording", run.recorder), ("final table", run.monitor), ("console", run.console)):
        if sink is not None and sink.error:
            found.append(f"{part}: {sink.error}")
        if sink is not None and sink.lost:
            found.append(f"{part}: {sink.lost} ticks left out, it could not keep up")
    if run.plan.config.script is None and result.reason == "script finished":  # else refusals may be meant
        found += [f"the automatic script: {one['message']}" for one in run.monitor.figures.remarks["refusals"]]
    return found


def _write_files(console: Console, run: Run, summary: dict[str, Any], problems: list[str]) -> None:
    """Write what is made of a run, and name every file that it left; one that fails spares the others."""

    def say(kind: str, text: object) -> None:
        console.print(f"{kind:<9}  {text}", markup=False)

    outputs = run.plan.outputs
    path = outputs.get("record")
    if path is not None and path.exists():
        say("recording", f"{path}   (check it; nothing moves: python -m humanoid_sim.replay {path})")
    for kind in ("summary", "html", "video"):
        if kind not in outputs:
            continue
        file = outputs[kind]
        try:
            if kind == "summary":
                write_summary(file, summary)
            else:
                with console.status(f"writing {file} (Ctrl-C skips it)"):
                    _draw(file, run)
            say(kind, f"{file}   {file.stat().st_size / 1e6:.1f} MB")
        except InputError as error:
            problems.append(str(error))
        except KeyboardInterrupt:
            say(kind, "skipped")


def _draw(file: Path, run: Run) -> None:
    """Write a page or a video, whose packages take seconds to import."""
    plan, poses = run.plan, run.poses
    assert poses is not None
    if file.suffix.lower() == ".html":
        from humanoid_sim.rendering.replay_page import write_page  # noqa: PLC0415

        title = f"{plan.description.name}, {plan.policies.label}"
        write_page(file, plan.setup.model(), poses, title=title)
    else:
        from humanoid_sim.rendering.video import write_video  # noqa: PLC0415

        write_video(file, plan.setup.model(), poses)


@contextmanager
def _handled_signals(run: Run) -> Iterator[list[int]]:
    """Handle the signals for as long as the run lasts; yields the list of those received that end it.

    SIGINT, SIGQUIT, SIGTERM and a closed terminal end the run through DAMPING. Once the robot is closed nothing is left
    to protect, and they do what they do to any program. A process that holds motors is not suspended but damps, and
    ignores what stops a process that uses a terminal in the background.
    """
    received: list[int] = []
    before: dict[int, Any] = {}
    interruption, keyboard, robot = run.interruption, run.keyboard, run.plan.setup.robot

    def end(number: int, _: object) -> None:
        received.append(number)
        if robot.is_closed:
            if keyboard is not None:
                keyboard.close()
            signal.signal(number, before[number])
            signal.raise_signal(number)
        run.session.request_stop(signal.Signals(number).name)

    always = (signal.SIGINT, signal.SIGQUIT, signal.SIGTERM)
    handlers: dict[int, Any] = dict.fromkeys((*always, signal.SIGHUP), end)
    if keyboard is not None:
        handlers[signal.SIGCONT] = lambda *_: keyboard.take_terminal()
    if interruption is not None:
        handlers[signal.SIGTSTP] = lambda *_: interruption.refuse_suspension()
        handlers |= {signal.SIGTTIN: signal.SIG_IGN, signal.SIGTTOU: signal.SIG_IGN}
    for number, handler in handlers.items():
        if number in always or signal.getsignal(number) is not signal.SIG_IGN:  # as SIGHUP is under nohup
            before[number] = signal.signal(number, handler)
    try:
        yield received
    finally:
        for number, former in before.items():
            signal.signal(number, former)
