"""Before a real robot is enabled: what was checked, as a list to read, and the operator's word."""

from __future__ import annotations

import sys

from rich.console import Console
from rich.text import Text

from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.play.config import PlayConfig
from humanoid_sim.play.robot_parts import BringUp

__all__ = ["bring_up"]

_STYLES = {"ok": "green", "warning": "yellow", "problem": "bold red"}


def bring_up(robot: BringUp, config: PlayConfig, console: Console) -> bool:
    """Prepare the robot, print what was checked, and ask the operator; whether it is to be enabled.

    Raises:
        RobotError: if something is wrong with the robot; the list is printed then too.
        InputError: if nobody can be asked.
    """
    asks = bool(robot.question) and not config.yes and not config.dry_run
    if asks and not (sys.stdin and sys.stdin.isatty()):
        raise InputError(
            "--yes: is needed where nobody can be asked (standard input is no terminal): motors get enabled"
        )
    try:
        robot.prepare()
    except RobotError as error:
        _print(robot, console)
        raise RobotError(str(error).partition("\n")[0].rstrip(": ")) from None
    _print(robot, console)
    if config.dry_run:
        console.print("dry run: everything but enabling was done; no motor was enabled", markup=False)
        return False
    if not asks:
        return True
    answer = console.input(Text(f"{robot.question} [y/N] "))
    if answer.strip().lower() in ("y", "yes"):
        return True
    console.print("nothing was enabled", markup=False)
    return False


def _print(robot: BringUp, console: Console) -> None:
    console.print("[bold]Checks, before anything is enabled[/bold]")
    for verdict, subject, text in robot.checks():
        console.print(Text.assemble((f"{verdict:<8}", _STYLES.get(verdict, "")), (subject, "bold"), f"  {text}"))
