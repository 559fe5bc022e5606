"""A run as a video (MP4, H.264); needs OpenGL."""

from __future__ import annotations

import math
from contextlib import closing
from fractions import Fraction
from pathlib import Path
from typing import cast

import av
import mujoco

from humanoid_sim.errors import InputError, blaming
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.rendering.pictures import PoseRenderer
from humanoid_sim.rendering.poses import Poses

_RATE = Fraction(25)  # Hz
_H264 = ("libx264", "libopenh264")


def write_video(path: str | Path, model: mujoco.MjModel, poses: Poses, *, size: tuple[int, int] = (1280, 720)) -> None:
    """Write a video of a run's poses, each shown at its time; `size` is width and height in pixels.

    Raises `InputError` if there is no pose, OpenGL does not work, or the file cannot be written.
    """
    path = output_file(path, "video", ".mp4")
    if not poses.kept:
        raise InputError(f"video '{path}': nothing to show: no tick came from a simulated robot")
    codec = next(name for name in _H264 if name in av.codecs_available)
    with (
        whole_file(path) as file,
        closing(PoseRenderer(model, *size)) as pictures,
        blaming(f"video '{path}': cannot be written", av.FFmpegError),
        av.open(file.name, "w", format="mp4") as container,
    ):
        stream = cast("av.VideoStream", container.add_stream(codec, rate=_RATE))
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        for pose in poses.kept:
            frame = av.VideoFrame.from_ndarray(pictures.draw(pose.qpos), format="rgb24")
            frame.pts, frame.time_base = math.floor(pose.time * _RATE + Fraction(1, 1000)), 1 / _RATE
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
