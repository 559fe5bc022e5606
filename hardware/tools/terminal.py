"""Questions to an operator and tables of figures, for the bench tools."""

from __future__ import annotations

import sys

from rich import box
from rich.console import Console
from rich.table import Table

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.robstride.parameters import CanTimeout, Parameter

_UNLIMITED = 200
"""Characters a line where no terminal says how many fit."""


def confirm(question: str, yes: bool, otherwise: str) -> None:
    """Go on only if an operator types yes; an `InputError` says `otherwise`, such as `not moved`, if not."""
    if yes:
        return
    if not sys.stdin.isatty():
        raise InputError("--yes: is needed where standard input is not a terminal")
    try:
        answer = input(f"{question} Type yes: ")
    except EOFError:
        answer = ""
    if answer.strip().lower() != "yes":
        raise InputError(f"{otherwise}: not confirmed")


def shown(parameter: Parameter, value: float | None) -> str:
    """Return a value for a person."""
    if value is None:
        return "not there"
    if parameter.name == "canTimeout":
        return f"{int(value)} ({1000.0 * CanTimeout.to_seconds(int(value)):g} ms)" if value else "0 (off)"
    return f"{value:g} {parameter.unit}".rstrip() if parameter.type.is_float else str(int(value))


def make_console() -> Console:
    """Return standard output; `:b:` in a channel's name is no emoji."""
    console = Console(highlight=False, emoji=False)
    return console if console.is_terminal else Console(highlight=False, emoji=False, width=_UNLIMITED)


def make_table(*headings: str, right: tuple[str, ...] = (), title: str | None = None) -> Table:
    """Return a table with these columns, of which those named in `right` hold numbers."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for heading in headings:
        table.add_column(heading, justify="right" if heading in right else "left", overflow="fold")
    return table
