"""Animated pictures (WebP), of poses or of a part of a video; browsers and notebooks play them by themselves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from io import BytesIO
from pathlib import Path

import av
import mujoco
from PIL import Image

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.offscreen import PoseRenderer


def video_frames(path: Path, begin: float, end: float, *, size: tuple[int, int], rate: float) -> list[Image.Image]:
    """Take `rate` frames per second of a video, from `begin` to `end`, s, in the size of width and height.

    Raises:
        InputError: the video shows nothing between these times.
    """
    frames: list[Image.Image] = []
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            if begin + len(frames) / rate <= frame.time < end:
                picture = Image.fromarray(frame.to_ndarray(format="rgb24"))
                frames.append(picture.resize(size, Image.Resampling.LANCZOS))
    if not frames:
        raise InputError(f"video '{path}': shows nothing from {begin:g} to {end:g} s")
    return frames


def animated_webp(frames: Sequence[Image.Image], durations: Sequence[int], *, quality: int = 60) -> bytes:
    """Return the file of an animated picture that repeats for ever.

    Args:
        frames: one or more pictures of one size.
        durations: ms for which each is shown.
        quality: 0 to 100, of lossy compression.
    """
    file = BytesIO()
    first, *rest = frames
    first.save(
        file, "WEBP", save_all=True, append_images=rest, duration=list(durations), loop=0, quality=quality, method=4
    )
    return file.getvalue()


def animated_poses(model: mujoco.MjModel, poses: Iterable[FloatArray], *, rate: float, width: int = 480) -> bytes:
    """Draw a model in each of the poses, shape (nq,), for 1 / `rate` s each; the picture is 16 : 9.

    The model's visual settings are adapted. The result is the file of an animated picture.
    """
    pictures = PoseRenderer(lambda: model, width, width * 9 // 16)
    try:
        frames = [Image.fromarray(pictures.draw(qpos)) for qpos in poses]
    finally:
        pictures.close()
    return animated_webp(frames, [round(1e3 / rate)] * len(frames))
