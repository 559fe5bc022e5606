"""Values and names of strangers, for messages of one line."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["cut", "one_line", "shown"]


def shown(value: Any, width: int = 60) -> str:
    """A value as a person would write it, in at most `width` characters."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple) and all(isinstance(item, str | float | int) for item in value):
        text = f"[{', '.join(item if isinstance(item, str) else f'{item:g}' for item in value)}]"
    else:
        text = f"{value:g}" if isinstance(value, float) else str(value)
    return cut(text, width)


def cut(text: str, width: int = 80) -> str:
    """The text in at most `width` characters."""
    return text if len(text) <= width else text[: width - 3] + "..."


def one_line(text: str) -> str:
    """The text without line breaks, which names in somebody's file may well have."""
    return " ".join(text.split())
