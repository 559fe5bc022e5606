"""Pieces of HTML; whatever comes from a file is escaped here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

__all__ = ["attributes", "badge", "element", "section", "table", "text"]


def text(value: object) -> str:
    """Any value as text of the page."""
    return escape(str(value), quote=False)


def attributes(**values: str) -> str:
    """`name="value"` for each; `class_` is written `class`."""
    return " ".join(f'{name.rstrip("_")}="{escape(value)}"' for name, value in values.items())


def element(name: str, content: str, **values: str) -> str:
    """One element around `content`, which is HTML already."""
    opening = f"{name} {attributes(**values)}" if values else name
    return f"<{opening}>{content}</{name}>"


def badge(word: str) -> str:
    """A verdict, in its colour: the word is its own class."""
    return element("span", text(word), class_=f"badge {word}")


def section(title: str, *parts: str, name: str = "") -> str:
    """A section under a heading; parts that are empty are left out."""
    content = "\n".join(part for part in parts if part)
    heading = element("h2", text(title))
    return element("section", f"{heading}\n{content}", **({"id": name} if name else {}))


def table(head: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A table of cells that are HTML already.

    Args:
        head: one title per column.
        rows: one cell per column each.
        numbers: columns that hold numbers and are set to the right.
    """

    def line(kind: str, cells: Sequence[str]) -> str:
        joined = "".join(
            element(kind, cell, class_="number") if i in numbers else element(kind, cell)
            for i, cell in enumerate(cells)
        )
        return element("tr", joined)

    body = "\n".join(line("td", row) for row in rows)
    content = f"<thead>{line('th', [text(title) for title in head])}</thead>\n<tbody>\n{body}\n</tbody>"
    return element("div", element("table", content), class_="wide")
