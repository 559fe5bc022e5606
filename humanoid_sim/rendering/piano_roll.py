"""A piano roll: keys upwards, time to the right; what was asked for, and where it was hit, missed or wrong."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from humanoid_sim.policy.song import key_name

_WIDTH, _ROW, _LEFT, _TOP, _BOTTOM = 1280, 14, 52, 34, 26
_LINES = 900
"""px, the most that the keys may take."""
_PAPER, _BLACK_ROW, _GRID, _INK = "#ffffff", "#eef0f3", "#d5d9df", "#2b2f36"
HIT, MISSED, WRONG = "#3a9d5d", "#f2b134", "#d1495b"
"""Colours of keys that are down and should be, that are not down and should be, and that are down and should not."""
_COLOURS = {"asked for": "#4c78a8", "hit": HIT, "missed": MISSED, "wrong": WRONG}
_AROUND = 2
"""Keys shown beyond the lowest and the highest that are used."""

Keys = npt.NDArray[np.floating | np.bool_]


def rgb(colour: str) -> tuple[float, float, float]:
    """Red, green and blue, 0 to 1 each, of `#rrggbb`."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue


def draw_piano_roll(wanted: Keys, step: float, pressed: Keys | None = None, title: str = "") -> Image.Image:
    """Draw a song, or a performance of it.

    Args:
        wanted: shape (T, 88), 1 where a key should be down.
        step: s between two rows.
        pressed: shape (T, 88), 1 where a key was down; None to draw the song alone.
        title: above it.
    """
    goal = np.asarray(wanted) > 0.5
    down = None if pressed is None else np.asarray(pressed) > 0.5
    used = np.flatnonzero((goal if down is None else goal | down).any(axis=0))
    low = max(int(used.min(initial=39)) - _AROUND, 0)
    high: int = min(int(used.max(initial=39)) + _AROUND, goal.shape[1] - 1)
    rows = high - low + 1
    row = max(min(_ROW, _LINES // rows), 4)
    image = Image.new("RGB", (_WIDTH, _TOP + rows * row + _BOTTOM), _PAPER)
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(12)
    scale = (_WIDTH - _LEFT - 12) / max(len(goal), 1)

    def top(key: int) -> int:
        return _TOP + (high - key) * row

    for key in range(low, high + 1):
        name = key_name(key)
        if "#" in name:
            draw.rectangle((_LEFT, top(key), _WIDTH - 12, top(key) + row - 1), fill=_BLACK_ROW)
        elif name.startswith("C") or key == low:
            draw.text((6, top(key) + row / 2), name, _INK, font, anchor="lm")
    _draw_seconds(draw, font, len(goal) * step, scale / step, image.height)
    kinds = {"asked for": goal} if down is None else {"missed": goal & ~down, "wrong": down & ~goal, "hit": goal & down}
    for kind, cells in kinds.items():
        for key in range(low, high + 1):
            for first, end in _runs(cells[:, key]):
                left, right = _LEFT + first * scale, max(_LEFT + end * scale, _LEFT + first * scale + 1.5)
                draw.rectangle((left, top(key) + 1, right, top(key) + row - 2), fill=_COLOURS[kind])
    draw.text((_LEFT, 16), title, _INK, ImageFont.load_default(15), anchor="lm")
    x = _WIDTH - 12
    for kind in reversed(kinds):
        x -= int(draw.textlength(kind, font)) + 30
        draw.rectangle((x, 11, x + 14, 21), fill=_COLOURS[kind])
        draw.text((x + 20, 16), kind, _INK, font, anchor="lm")
    return image


def _draw_seconds(
    draw: ImageDraw.ImageDraw,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    seconds: float,
    scale: float,
    height: int,
) -> None:
    spacing = next(s for s in (1, 2, 5, 10, 30, 60, 300, 600, 3600, 36000) if s * scale >= 50 or s == 36000)
    for second in range(0, int(seconds) + 1, spacing):
        x = _LEFT + second * scale
        draw.line((x, _TOP, x, height - _BOTTOM), fill=_GRID)
        draw.text((x, height - _BOTTOM / 2), f"{second} s", _INK, font, anchor="mm")


def _runs(cells: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], cells, [False]]).astype(np.int8)))
    return [(int(first), int(end)) for first, end in zip(edges[::2], edges[1::2], strict=True)]
