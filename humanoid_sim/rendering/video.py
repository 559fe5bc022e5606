"""Pictures of a run in files: a snapshot, and a video that is drawn when the robot has come to rest."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import cast

import av
import mujoco
import numpy as np
import numpy.typing as npt
from PIL import Image

from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.backend import choose_video_backend
from humanoid_sim.rendering.caption import Caption, draw_caption
from humanoid_sim.rendering.offscreen import PoseRenderer
from humanoid_sim.session.sinks import Sink

__all__ = ["VideoReport", "VideoSink", "save_snapshot"]

_SNAPSHOT_FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}

_LONGEST_PAUSE = 1.0
"""s. A longer jump of the robot's clock is shortened to this."""
_H264 = ("libx264", "libopenh264")


@dataclass(frozen=True, slots=True)
class VideoReport:
    """What became of a video."""

    path: Path
    frame_count: int
    fps: float
    backend: str
    """What drew it, and why."""
    notice: str = ""
    """What is not as it was asked for."""


@dataclass(frozen=True, slots=True, eq=False)
class _Moment:
    time: float
    """s since the first frame."""
    qpos: FloatArray
    caption: Caption


class VideoSink(Sink):
    """Remembers how the robot stood, `fps` times a second of the robot's clock; `render` makes an MP4 (H.264) of it.

    Drawing takes longer than a control period, so nothing is drawn while the robot runs. At most `max_frames` are kept:
    when they are full every second one is dropped and the frame rate halves, so that a long run is shown in whole, at
    its true speed, and neither memory nor drawing time grow without bound.

    Args:
        path: where to write; ends in `.mp4`.
        model_factory: makes the model to draw; called once, by `render`.
        fps: frames per second.
        size: width and height in pixels; even, as H.264 with 4:2:0 colour requires.
        camera: a camera of the model; None looks at the robot from the front.
        max_frames: at 30 fps, two minutes at the full rate.

    Raises:
        InputError: the path cannot be written, or its suffix or the size is not accepted.
    """

    def __init__(
        self,
        path: str | Path,
        model_factory: Callable[[], mujoco.MjModel],
        *,
        fps: int = 30,
        size: tuple[int, int] = (640, 480),
        camera: str | None = None,
        max_frames: int = 3600,
    ) -> None:
        self.path = output_file(path, "video", ".mp4")
        if fps < 1:
            raise InputError(f"video '{path}': frame rate is {fps}, accepted: 1 and more")
        if min(size) < 16 or any(side % 2 for side in size):
            raise InputError(f"video '{path}': size is {size[0]}x{size[1]}, accepted: even numbers from 16")
        self._model_factory, self._size, self._camera = model_factory, size, camera
        self._asked_fps = fps
        self._fps = Fraction(fps)
        self._max_frames = max(2, max_frames)
        self._moments: list[_Moment] = []
        self._clock = 0.0
        self._last_time = math.nan
        self._next_frame = 0

    def tick(self, record: TickRecord) -> None:
        """Keep the pose, if a frame is due."""
        time = record.input.state.time
        if record.qpos is None or not isinstance(time, float):
            return
        self._clock += min(max(0.0, time - self._last_time), _LONGEST_PAUSE)  # NaN, and backwards: 0
        self._last_time = time
        if self._clock * self._fps < self._next_frame:
            return
        self._moments.append(_Moment(self._clock, record.qpos, Caption.of(record)))
        if len(self._moments) > self._max_frames:
            del self._moments[1::2]
            self._fps /= 2
        self._next_frame = math.floor(self._clock * self._fps) + 1

    def render(self, progress: Callable[[int, int], None] | None = None) -> VideoReport:
        """Draw and write the video.

        Args:
            progress: called with the frames done and their total, after each.

        Raises:
            InputError: there is nothing to show, the file cannot be written, or there is no such camera.
        """
        if not self._moments:
            raise InputError(f"video '{self.path}': nothing to show: no tick came from a simulated robot")
        pictures = PoseRenderer(self._model_factory, *self._size, self._camera, choose=choose_video_backend)
        try:
            with whole_file(self.path) as file:
                count = self._encode(file.name, self._frames(pictures), progress)
        except av.FFmpegError as error:
            raise InputError(f"{self.path}: cannot be written: {error.strerror or error}") from None
        finally:
            pictures.close()
        fps = float(self._fps)
        notice = "" if fps == self._asked_fps else f"a long run: {fps:g} instead of {self._asked_fps} frames per second"
        return VideoReport(self.path, count, fps, pictures.backend, notice)

    @property
    def frame_count(self) -> int:
        """Frames that `render` will write."""
        return round(self._moments[-1].time * self._fps) + 1 if self._moments else 0

    def _frames(self, pictures: PoseRenderer) -> Iterator[npt.NDArray[np.uint8]]:
        """One picture per frame, at a constant rate: the moment nearest to it."""
        shown = -1
        for frame in range(self.frame_count):
            last = shown
            while shown + 1 < len(self._moments) and self._moments[shown + 1].time * self._fps <= frame + 0.5:
                shown += 1
            if shown != last:
                moment = self._moments[shown]
                picture = draw_caption(pictures.draw(moment.qpos), moment.caption)
            yield picture

    def _encode(
        self,
        path: str,
        frames: Iterator[npt.NDArray[np.uint8]],
        progress: Callable[[int, int], None] | None,
    ) -> int:
        codec = next(name for name in _H264 if name in av.codecs_available)
        done = 0
        with av.open(path, "w", format="mp4", options={"movflags": "+faststart"}) as container:
            stream = cast(
                "av.VideoStream",
                container.add_stream(codec, rate=self._fps, options={"crf": "20", "preset": "veryfast"}),
            )
            stream.width, stream.height = self._size
            stream.pix_fmt = "yuv420p"
            for picture in frames:
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
                done += 1
                if progress is not None:
                    progress(done, self.frame_count)
            container.mux(stream.encode(None))
        return done


def save_snapshot(
    path: str | Path,
    model: mujoco.MjModel,
    qpos: FloatArray,
    *,
    size: tuple[int, int] = (1280, 960),
    camera: str | None = None,
    caption: Caption | None = None,
) -> str:
    """Write a PNG or JPEG of the model at `qpos`, shape (nq,), and return what drew it.

    A `qpos` that is not finite shows the model's reference pose.

    Raises:
        InputError: the file cannot be written, or there is no such camera.
    """
    path = output_file(path, "snapshot", *_SNAPSHOT_FORMATS)
    pictures = PoseRenderer(lambda: model, *size, camera)
    try:
        picture = pictures.draw(qpos)
        image = Image.fromarray(picture if caption is None else draw_caption(picture, caption))
        with whole_file(path) as file:
            image.save(file, _SNAPSHOT_FORMATS[path.suffix.lower()])
    finally:
        pictures.close()
    return pictures.backend
