"""A run as a video (MP4, H.264); needs OpenGL."""

from __future__ import annotations

import math
from contextlib import closing
from fractions import Fraction
from pathlib import Path
from typing import cast

import av
import mujoco
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from humanoid_sim.errors import InputError, one_line
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.rendering.backend import choose_opengl
from humanoid_sim.rendering.caption import MODE_COLOURS, Caption
from humanoid_sim.rendering.moments import RATE, Moments
from humanoid_sim.rendering.offscreen import PoseRenderer

_H264 = ("libx264", "libopenh264")
_STRIP, _TEXT = (22, 26, 32), (244, 246, 248)


def write_video(
    path: str | Path, model: mujoco.MjModel, moments: Moments, *, size: tuple[int, int] = (1280, 720)
) -> str:
    """Write a video of a run's poses, each shown at its time, and return the OpenGL that drew it.

    `size` is width and height in pixels. The model's visual settings are adapted. Raises `InputError` if there is no
    pose, OpenGL does not work, or the file cannot be written.
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
                for moment, ghost in zip(moments.kept, moments.ghosts(model), strict=True):
                    picture = draw_caption(pictures.draw(moment.qpos, ghost), moment.caption)
                    frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
                    # As poses are chosen: rounding would give two of them, half a frame off, one place.
                    frame.pts, frame.time_base = math.floor(moment.time * rate + Fraction(1, 1000)), 1 / rate
                    container.mux(stream.encode(frame))
                container.mux(stream.encode(None))
        except av.FFmpegError as error:
            raise InputError(f"video '{path}': cannot be written: {error.strerror or error}") from None
    return choose_opengl()


def draw_caption(picture: npt.NDArray[np.uint8], caption: Caption) -> npt.NDArray[np.uint8]:
    """Return the picture, shape (height, width, 3), with the caption in a strip over its bottom."""
    image = Image.fromarray(picture)
    strip = max(18, image.height // 16)
    draw, top, middle = ImageDraw.Draw(image), image.height - strip, image.height - strip / 2
    draw.rectangle((0, top, image.width, image.height), fill=_STRIP)
    draw.rectangle((0, top, strip // 4, image.height), fill=MODE_COLOURS[caption.mode])
    text = one_line(f"{caption.time:.2f} s   {caption.mode.name}   {caption.controller}   {caption.message}")
    draw.text((0.65 * strip, middle), text, fill=_TEXT, font=ImageFont.load_default(0.56 * strip), anchor="lm")
    return np.asarray(image)
