"""A piano roll, keys upwards and time to the right: what was asked for and played; a keyboard: what hands reach."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from humanoid_sim.policy.song import key_name
from humanoid_sim.robots.piano import Key

_WIDTH, _ROW, _LEFT, _TOP, _BOTTOM, _MARGIN = 1280, 14, 52, 34, 26, 12
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
    scale = (_WIDTH - _LEFT - _MARGIN) / max(len(goal), 1)

    def top(key: int) -> int:
        return _TOP + (high - key) * row

    for key in range(low, high + 1):
        name = key_name(key)
        if "#" in name:
            draw.rectangle((_LEFT, top(key), _WIDTH - _MARGIN, top(key) + row - 1), fill=_BLACK_ROW)
        elif name.startswith("C") or key == low:
            draw.text((6, top(key) + row / 2), name, _INK, font, anchor="lm")
    _draw_seconds(draw, font, len(goal) * step, scale / step, image.height)
    kinds = {"asked for": goal} if down is None else {"missed": goal & ~down, "wrong": down & ~goal, "hit": goal & down}
    for kind, cells in kinds.items():
        for key in range(low, high + 1):
            for first, end in _runs(cells[:, key]):
                left, right = _LEFT + first * scale, max(_LEFT + end * scale, _LEFT + first * scale + 1.5)
                draw.rectangle((left, top(key) + 1, right, top(key) + row - 2), fill=_COLOURS[kind])
    _draw_title(draw, _LEFT, title, {kind: _COLOURS[kind] for kind in kinds})
    return image


def _draw_title(draw: ImageDraw.ImageDraw, left: int, title: str, colours: dict[str, str]) -> None:
    """Draw the line above a picture: its title, and on the right what its colours mean."""
    draw.text((left, 16), title, _INK, ImageFont.load_default(15), anchor="lm")
    x, font = _WIDTH - _MARGIN, ImageFont.load_default(12)
    for text, colour in reversed(colours.items()):
        x -= int(draw.textlength(text, font)) + 30
        draw.rectangle((x, 11, x + 14, 21), fill=colour)
        draw.text((x + 20, 16), text, _INK, font, anchor="lm")


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


_EDGE = "#8a8f98"
_HANDS = {"left hand": "#4c78a8", "right hand": "#f2b134", "both": "#3a9d5d"}
"""Colours of the keys that a hand reaches."""
_FREE = {True: "#ffffff", False: "#2b2f36"}


def draw_reach(keys: Sequence[Key], hands: Sequence[Collection[int]], title: str = "") -> Image.Image:
    """Draw which hand reaches which key; `hands` are the keys of the left hand, and those of the right one."""
    left = min(key.box.position[1] - key.box.size[1] for key in keys)
    scale = (_WIDTH - 2 * _MARGIN) / (-2.0 * left)
    length = max(key.box.position[0] + key.box.size[0] for key in keys)
    image = Image.new("RGB", (_WIDTH, round(_TOP + length * scale) + 30), _PAPER)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(12)
    for key in sorted(keys, key=lambda key: not key.is_white):  # black keys lie on white ones
        (x, y, _), (half_length, half_width, _) = key.box.position, key.box.size
        box = (
            _MARGIN + (y - half_width - left) * scale,
            _TOP + (x - half_length) * scale,
            _MARGIN + (y + half_width - left) * scale,
            _TOP + (x + half_length) * scale,
        )
        draw.rectangle(box, _colour(key, hands), _EDGE)
        name = key_name(key.index)
        if name.startswith("C") and key.is_white:
            draw.text(((box[0] + box[2]) / 2, box[3] + 12), name, _INK, font, anchor="mm")
    _draw_title(draw, _MARGIN, title, _HANDS)
    return image


def _colour(key: Key, hands: Sequence[Collection[int]]) -> str:
    by_left, by_right = (key.index in keys for keys in hands)
    if not (by_left or by_right):
        return _FREE[key.is_white]
    return _HANDS["both" if by_left and by_right else "left hand" if by_left else "right hand"]
