"""Colours of the page and of its plots, in light and in dark."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

__all__ = ["COLOURS", "DARK", "candidate_colour", "themed"]

COLOURS: Mapping[str, str] = MappingProxyType(
    {
        "ink": "#1c2733",
        "faint": "#66727f",
        "grid": "#dfe4e9",
        "paper": "#ffffff",
        "panel": "#f5f7f9",
        "baseline": "#7c8a99",
        "candidate1": "#2563b8",
        "candidate2": "#b8650f",
        "candidate3": "#7a3fb0",
        "candidate4": "#0f7f7a",
        "worse": "#c42f3d",
        "better": "#1e8a4f",
        "unclear": "#a87800",
    }
)
"""By what they mean. Blue and orange, and red and blue-green, stay apart for eyes that do not tell red from green."""

DARK: Mapping[str, str] = MappingProxyType(
    {
        "ink": "#e3e8ed",
        "faint": "#98a4b0",
        "grid": "#313b46",
        "paper": "#12181e",
        "panel": "#1a222a",
        "baseline": "#8f9dab",
        "candidate1": "#6ea8f5",
        "candidate2": "#eda350",
        "candidate3": "#bd90ea",
        "candidate4": "#4fc3bd",
        "worse": "#f0707b",
        "better": "#58c98a",
        "unclear": "#e0b34a",
    }
)
"""The same where the reader's system is dark."""

_CANDIDATES = 4


def candidate_colour(index: int) -> str:
    """Of the candidate at `index`; the fifth has the first one's again."""
    return COLOURS[f"candidate{index % _CANDIDATES + 1}"]


def themed(svg: str) -> str:
    """The SVG with its colours replaced by the page's variables, so that it follows the page into the dark."""
    for name, colour in COLOURS.items():
        svg = svg.replace(colour, f"var(--{name})")
    return svg
