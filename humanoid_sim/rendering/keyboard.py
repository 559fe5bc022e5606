"""A keyboard from above, its keys in the colours of the hands that reach them."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from PIL import Image, ImageDraw, ImageFont

from humanoid_sim.policy.song import key_name
from humanoid_sim.robots.piano import Key

_WIDTH, _TOP, _MARGIN = 1280, 34, 12
_PAPER, _EDGE, _INK = "#ffffff", "#8a8f98", "#2b2f36"
_LEFT, _RIGHT, _BOTH = "#4c78a8", "#f2b134", "#3a9d5d"
_FREE = {True: "#ffffff", False: "#2b2f36"}


def draw_reach(keys: Sequence[Key], hands: Sequence[Collection[int]], title: str = "") -> Image.Image:
    """Draw which hand reaches which key.

    Args:
        keys: all of the piano.
        hands: the keys of the left hand, and those of the right one.
        title: above it.
    """
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
    draw.text((_MARGIN, 16), title, _INK, ImageFont.load_default(15), anchor="lm")
    x = _WIDTH - _MARGIN
    for text, colour in (("both", _BOTH), ("right hand", _RIGHT), ("left hand", _LEFT)):
        x -= int(draw.textlength(text, font)) + 30
        draw.rectangle((x, 11, x + 14, 21), fill=colour)
        draw.text((x + 20, 16), text, _INK, font, anchor="lm")
    return image


def _colour(key: Key, hands: Sequence[Collection[int]]) -> str:
    by_left, by_right = (key.index in keys for keys in hands)
    if by_left and by_right:
        return _BOTH
    return _LEFT if by_left else _RIGHT if by_right else _FREE[key.is_white]
