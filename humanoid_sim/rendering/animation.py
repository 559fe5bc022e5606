"""Animated pictures (WebP), which browsers and notebooks play by themselves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from io import BytesIO

import mujoco
from PIL import Image

from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.offscreen import PoseRenderer


def animated_webp(frames: Sequence[Image.Image], durations: Sequence[int]) -> bytes:
    """Return the file of an animated picture that repeats for ever.

    Args:
        frames: one or more pictures of one size.
        durations: ms for which each is shown.
    """
    file = BytesIO()
    first, *rest = frames
    first.save(file, "WEBP", save_all=True, append_images=rest, duration=list(durations), loop=0, quality=60, method=4)
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
