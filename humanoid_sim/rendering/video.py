"""A run as a video (MP4, H.264), and a pose as a picture; both need OpenGL."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import closing
from fractions import Fraction
from functools import lru_cache
from pathlib import Path
from typing import cast

import av
import mujoco
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from humanoid_sim.errors import InputError, one_line
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.caption import MODE_COLOURS, Caption
from humanoid_sim.rendering.moments import RATE, Moments
from humanoid_sim.rendering.offscreen import PoseRenderer

_SNAPSHOT_FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}
_H264 = ("libx264", "libopenh264")
_STRIP = (22, 26, 32, 210)
_TEXT, _FAINT = (244, 246, 248), (176, 184, 194)


def write_video(
    path: str | Path,
    model: mujoco.MjModel,
    moments: Moments,
    *,
    size: tuple[int, int] = (1280, 720),
    progress: Callable[[int, int], object] | None = None,
) -> str:
    """Write a video of a run's poses, each shown at its time, and return what drew it.

    `size` is width and height in pixels; `progress` is called with the poses done and their total. The model's visual
    settings are adapted. Raises `InputError` if there is no pose, OpenGL does not work, or the file cannot be written.
    """
    path = output_file(path, "video", ".mp4")
    if not moments.kept:
        raise InputError(f"video '{path}': nothing to show: no tick came from a simulated robot")
    codec = next(name for name in _H264 if name in av.codecs_available)
    rate = Fraction(RATE)
    with whole_file(path) as file, closing(PoseRenderer(lambda: model, *size)) as pictures:
        pictures.draw(moments.kept[0].qpos)  # where OpenGL does not work, nothing is written
        try:
            with av.open(file.name, "w", format="mp4", options={"movflags": "+faststart"}) as container:
                options = {"crf": "20", "preset": "veryfast"}
                stream = cast("av.VideoStream", container.add_stream(codec, rate=rate, options=options))
                stream.width, stream.height = size
                stream.pix_fmt = "yuv420p"
                stream.time_base = stream.codec_context.time_base = 1 / rate
                poses = zip(moments.kept, moments.ghosts(model), strict=True)
                for count, (moment, ghost) in enumerate(poses, start=1):
                    picture = draw_caption(pictures.draw(moment.qpos, ghost), moment.caption)
                    frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
                    # As poses are chosen: rounding would give two of them, half a frame off, one place.
                    frame.pts, frame.time_base = math.floor(moment.time * rate + Fraction(1, 1000)), 1 / rate
                    container.mux(stream.encode(frame))
                    if progress is not None:
                        progress(count, len(moments.kept))
                container.mux(stream.encode(None))
        except av.FFmpegError as error:
            raise InputError(f"video '{path}': cannot be written: {error.strerror or error}") from None
        return pictures.backend


def save_snapshot(
    path: str | Path, model: mujoco.MjModel, qpos: FloatArray, *, size: tuple[int, int] = (1280, 960)
) -> str:
    """Write a PNG or JPEG of the model at `qpos`, shape (nq,), and return what drew it.

    A `qpos` that is not finite shows the model's reference pose. Raises `InputError` where OpenGL does not work.
    """
    path = output_file(path, "snapshot", *_SNAPSHOT_FORMATS)
    with closing(PoseRenderer(lambda: model, *size)) as pictures:
        image = Image.fromarray(pictures.draw(qpos))
        with whole_file(path) as file:
            image.save(file, _SNAPSHOT_FORMATS[path.suffix.lower()])
        return pictures.backend


def draw_caption(picture: npt.NDArray[np.uint8], caption: Caption) -> npt.NDArray[np.uint8]:
    """Give the picture, shape (height, width, 3), with the strip over its bottom; text that is too long is cut off."""
    image = Image.fromarray(picture)
    height = max(18, image.height // 16)
    font = _font(int(0.56 * height))
    draw = ImageDraw.Draw(image, "RGBA")
    top, middle = image.height - height, image.height - height / 2
    draw.rectangle((0, top, image.width, image.height), fill=_STRIP)
    draw.rectangle((0, top, height // 4, image.height), fill=MODE_COLOURS[caption.mode])
    x = 0.65 * height
    for text, colour, width in (
        (f"{caption.time:.2f} s", _TEXT, 3.6 * height),
        (caption.mode.name, MODE_COLOURS[caption.mode], 0.0),
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
