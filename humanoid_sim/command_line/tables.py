"""Tables that programs print."""

from __future__ import annotations

from collections.abc import Container

from rich.table import Table


def titled_table(title: str, *headings: str, right: Container[str] = ()) -> Table:
    """Return an empty table; without headings one of names and their values. No cell is cut off."""
    table = Table(title=title, title_justify="left", title_style="bold", show_header=bool(headings))
    for heading in headings or ("name", "value"):
        table.add_column(heading, justify="right" if heading in right else "left", overflow="fold")
    return table
