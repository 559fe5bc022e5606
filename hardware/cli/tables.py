"""Tables that fit a terminal, and are whole where the output is a file or a pipe."""

from __future__ import annotations

from rich import box
from rich.console import Console
from rich.table import Table

__all__ = ["make_console", "make_table"]

_UNLIMITED = 200
"""Characters a line where no terminal says how many fit."""


def make_console() -> Console:
    """Standard output; `:b:` in a channel's name is no emoji."""
    console = Console(highlight=False, emoji=False)
    return console if console.is_terminal else Console(highlight=False, emoji=False, width=_UNLIMITED)


def make_table(*headings: str, right: tuple[str, ...] = (), title: str | None = None) -> Table:
    """A table with these columns, of which those named in `right` hold numbers."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for heading in headings:
        table.add_column(heading, justify="right" if heading in right else "left", overflow="fold")
    return table
