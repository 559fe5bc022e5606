"""A strip under a picture that says when it was, and who was in control."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from humanoid_sim.errors import one_line
from humanoid_sim.messages import Mode, TickRecord

_MODE_COLOURS = {
    Mode.ZERO_TORQUE: (150, 156, 164),
    Mode.DAMPING: (232, 168, 56),
    Mode.STANDBY: (86, 160, 236),
    Mode.LOCOMOTION: (88, 196, 120),
    Mode.REMOTE: (184, 128, 232),
}
_STRIP = (22, 26, 32, 210)
_TEXT, _FAINT = (244, 246, 248), (176, 184, 194)


@dataclass(frozen=True, slots=True)
class Caption:
    """Text of the strip."""

    time: float
    """s"""
    mode: Mode
    controller: str
    message: str = ""

    @classmethod
    def of(cls, record: TickRecord) -> Caption:
        """Return the caption of a tick, at its time on the robot's clock."""
        control = record.output.control_mode
        time = float(np.ravel(record.input.state.time)[0])
        return cls(time, control.mode, control.controller_name, control.status_message)


def draw_caption(picture: npt.NDArray[np.uint8], caption: Caption) -> npt.NDArray[np.uint8]:
    """Give the picture, shape (height, width, 3), with the strip over its bottom; text that is too long is cut off."""
    image = Image.fromarray(picture)
    height = max(18, image.height // 16)
    font = _font(int(0.56 * height))
    draw = ImageDraw.Draw(image, "RGBA")
    top, middle = image.height - height, image.height - height / 2
    draw.rectangle((0, top, image.width, image.height), fill=_STRIP)
    draw.rectangle((0, top, height // 4, image.height), fill=_MODE_COLOURS[caption.mode])
    x = 0.65 * height
    for text, colour, width in (
        (f"{caption.time:.2f} s", _TEXT, 3.6 * height),
        (caption.mode.name, _MODE_COLOURS[caption.mode], 0.0),
        (caption.controller, _TEXT, 0.0),
        (caption.message, _FAINT, 0.0),
    ):
        shown = _cut(text, font, image.width - x - 0.3 * height)
        draw.text((x, middle), shown, fill=colour, font=font, anchor="lm")
        x += max(width, font.getlength(shown) + 0.7 * height)
    return np.asarray(image)


@lru_cache(maxsize=4)
def _font(size: int) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(size)
    assert isinstance(font, ImageFont.FreeTypeFont), "Pillow's wheels include FreeType"
    return font


def _cut(text: str, font: ImageFont.FreeTypeFont, room: float) -> str:
    """Return the part of a line that fits into `room` pixels."""
    text = one_line(text)
    if font.getlength(text) <= room:
        return text
    while text and font.getlength(text + "…") > room:
        text = text[:-1]
    return text + "…" if text else ""
