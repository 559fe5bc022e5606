"""Draws and encodes a video in a process of its own, while the robot still runs.

On standard input it takes pickles: a `Job`, then `Moment`s as they come, then None. On standard output it tells, a JSON
object a line: how many frames are done, and in the end what drew them, or what went wrong. If its input ends without
None, nobody waits for the file, and it is removed.
"""

from __future__ import annotations

import json
import math
import os
import pickle
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass
from fractions import Fraction
from itertools import chain
from typing import IO, cast

import av
import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.caption import Caption, draw_caption
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.rendering.offscreen import PoseRenderer

__all__ = ["Job", "Moment", "draw_video"]

_H264 = ("libx264", "libopenh264")
_NICENESS = 5
"""The robot that is being simulated goes first."""


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """What to draw, and where to."""

    path: str
    model: mujoco.MjModel
    size: tuple[int, int]
    """Width and height in pixels."""
    camera: str | None
    fps: Fraction
    ghost: ReferenceGhost | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """One frame."""

    time: float
    """s since the first."""
    qpos: FloatArray
    """Shape (nq,)."""
    caption: Caption
    frame: int | None = None
    """Of the reference, while a policy follows it."""
    anchor: FloatArray | None = None
    """Pose (7,), m and w x y z, of the anchor body when the policy was shown frame 0; None where there is none."""


def draw_video(job: Job, moments: Iterator[Moment], progress: Callable[[int], None]) -> str:
    """Write an MP4 (H.264) with a picture of every moment, shown at its time; return what drew it.

    Raises:
        InputError: the model has no such camera.
        av.FFmpegError: the file cannot be written.
    """
    first = next(moments)
    codec = next(name for name in _H264 if name in av.codecs_available)
    with (
        closing(PoseRenderer(lambda: job.model, *job.size, job.camera, fastest=True)) as pictures,
        av.open(job.path, "w", format="mp4", options={"movflags": "+faststart"}) as container,
    ):
        stream = cast(
            "av.VideoStream",
            container.add_stream(codec, rate=job.fps, options={"crf": "20", "preset": "veryfast"}),
        )
        stream.width, stream.height = job.size
        stream.pix_fmt = "yuv420p"
        stream.time_base = stream.codec_context.time_base = 1 / job.fps
        for count, moment in enumerate(chain([first], moments), start=1):
            frame = av.VideoFrame.from_ndarray(_picture(job, pictures, moment), format="rgb24")
            # As moments are chosen: rounding would give two of them, half a frame off, one place.
            frame.pts, frame.time_base = math.floor(moment.time * job.fps), 1 / job.fps
            container.mux(stream.encode(frame))
            progress(count)
        container.mux(stream.encode(None))
        return pictures.backend


def _picture(job: Job, pictures: PoseRenderer, moment: Moment) -> npt.NDArray[np.uint8]:
    ghost = None
    if job.ghost is not None and moment.frame is not None:
        if moment.anchor is not None:
            job.ghost.align(moment.anchor)
        ghost = job.ghost.pose(job.model, moment.qpos, moment.frame)
    return draw_caption(pictures.draw(moment.qpos, ghost), moment.caption)


def _moments(source: IO[bytes]) -> Iterator[Moment]:
    while (item := pickle.load(source)) is not None:
        yield item


def main() -> int:
    """Draw what standard input asks for."""
    output = os.fdopen(os.dup(sys.stdout.fileno()), "w", buffering=1)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # whatever a driver prints is no answer
    os.nice(_NICENESS)

    def tell(**answer: object) -> None:
        with suppress(OSError):
            print(json.dumps(answer), file=output)

    job: Job = pickle.load(sys.stdin.buffer)
    try:
        backend = draw_video(job, _moments(sys.stdin.buffer), lambda count: tell(frames=count))
    except EOFError:  # who wanted it is gone
        with suppress(OSError):
            os.unlink(job.path)
        return 1
    except av.FFmpegError as error:
        tell(error=f"cannot be written: {error.strerror or error}")
        return 1
    except InputError as error:
        tell(error=str(error))
        return 1
    tell(backend=backend)
    return 0


if __name__ == "__main__":
    sys.exit(main())
