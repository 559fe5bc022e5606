"""Pictures of a run in files: a snapshot, and a video that a process beside the run draws, with how far that is."""

from __future__ import annotations

import contextlib
import json
import math
import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from time import monotonic

import mujoco
import numpy as np
import numpy.typing as npt
from PIL import Image
from rich.console import Console
from rich.progress import TimeRemainingColumn

from humanoid_sim.command_line.progress import BarOrLines
from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.messages import TickRecord
from humanoid_sim.mit import KEY_PRESSED, FloatArray
from humanoid_sim.rendering.caption import Caption
from humanoid_sim.rendering.drawing import Following, Job, Moment
from humanoid_sim.rendering.ghost import ReferenceGhost, ShownReference
from humanoid_sim.rendering.offscreen import PoseRenderer
from humanoid_sim.rendering.piano_sound import Stroke, strokes_between
from humanoid_sim.session.sinks import Sink

_SNAPSHOT_FORMATS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}

_LONGEST_PAUSE = 1.0
"""s. A longer jump of the robot's clock is shortened to this."""
_PROGRAM = "humanoid_sim.rendering.drawing"
_LOOK_PERIOD = 0.1
"""s between two looks at how far the drawing is."""
_STOPPED_WITHIN = 5.0
"""s that the drawing process has to end when nobody wants its video any more."""


@dataclass(frozen=True, slots=True)
class VideoReport:
    """Result of drawing a video."""

    path: Path
    frame_count: int
    duration: float
    """s from the first frame to the last."""
    backend: str
    """Name of what drew it, and the reason."""
    notice: str = ""
    """Deviation from what was asked for; empty if there is none."""
    sound: Path | None = None
    """File of its sound, where this machine has no encoder to put it into the video."""


class VideoSink(Sink):
    """Hands how the robot stands, `fps` times a second of its clock, to a process that makes an MP4 (H.264) of it.

    Nothing is started before there is something to show. A long run is shown in whole and at its true speed: whenever
    `max_frames` more have been drawn the rate halves, so that drawing time does not grow without bound. Raises
    `InputError` if the path cannot be written, or its suffix or the size is not accepted.

    Args:
        model_factory: makes the model to draw; called once, on a thread of its own.
        size: width and height in pixels; even, as H.264 with 4:2:0 colour requires.
        max_frames: at 25 fps, 2.4 minutes at the full rate.
        ghost: the motion that a policy follows, drawn through the robot.
        goals: shape (F, 88), 1 where a piano's key should be down: its song.
    """

    def __init__(
        self,
        path: str | Path,
        model_factory: Callable[[], mujoco.MjModel],
        *,
        fps: int = 25,
        size: tuple[int, int] = (1280, 720),
        max_frames: int = 3600,
        ghost: ReferenceGhost | None = None,
        goals: npt.NDArray[np.floating] | None = None,
    ) -> None:
        self.path = output_file(path, "video", ".mp4")
        if fps < 1:
            raise InputError(f"video '{path}': frame rate is {fps}, accepted: 1 and more")
        if min(size) < 16 or any(side % 2 for side in size):
            raise InputError(f"video '{path}': size is {size[0]}x{size[1]}, accepted: even numbers from 16")
        self._model_factory, self._size, self._ghost = model_factory, size, ghost
        self._goals = None if goals is None else np.asarray(goals) > 0.5
        self._fps = Fraction(fps)
        self._rate, self._thin_at, self._max_frames = Fraction(fps), max(2, max_frames), max(2, max_frames)
        self._clock = 0.0
        self._last_time = math.nan
        self._next_frame = 0
        self._shown = ShownReference()
        self.frame_count = 0
        """Frames so far."""
        self._duration = 0.0
        self._drawing: _Drawing | None = None
        self._keys: npt.NDArray[np.bool_] | None = None
        self._strokes: list[Stroke] = []
        self._following: Following | None = None

    def follow(self, ghost: ReferenceGhost | None, goals: npt.NDArray[np.floating] | None) -> None:
        """Show the motion and the song of another policy from here on; arguments as for the constructor."""
        self._ghost, self._goals = ghost, None if goals is None else np.asarray(goals) > 0.5
        self._shown = ShownReference()
        self._following = Following(self._ghost, self._goals)

    def tick(self, record: TickRecord) -> None:
        """Hand over the pose, if a frame is due."""
        time = record.input.state.time
        if record.qpos is None or not isinstance(time, float):
            return
        self._clock += min(max(0.0, time - self._last_time), _LONGEST_PAUSE)  # NaN, and backwards: 0
        self._last_time = time
        if self._ghost is not None or self._goals is not None:
            self._shown.look(record)
        self._listen(record)
        if self._clock * self._rate < self._next_frame:
            return
        if self._drawing is None:
            self._drawing = _Drawing(self.path, self._job)
        shown, strokes = self._shown, tuple(self._strokes)
        self._strokes.clear()
        caption = Caption.of(record)
        self._drawing.items.put(
            Moment(self._clock, record.qpos, caption, shown.frame, shown.anchor, strokes, self._following)
        )
        shown.anchor = self._following = None  # said once
        self.frame_count += 1
        self._duration = self._clock
        if self.frame_count >= self._thin_at:
            self._thin_at += self._max_frames
            self._rate /= 2
        self._next_frame = math.floor(self._clock * self._rate) + 1

    def _listen(self, record: TickRecord) -> None:
        """Note which keys of a piano went down or up in this tick: a key may do both between two frames."""
        live = record.input.state.extern.get(KEY_PRESSED)
        if live is None:
            return
        down = live.value > 0.5
        before = np.zeros_like(down) if self._keys is None else self._keys
        self._strokes.extend(strokes_between(before, down, self._clock))
        self._keys = down

    @property
    def process_id(self) -> int | None:
        """Return the id of the process that draws, while there is one."""
        process = None if self._drawing is None else self._drawing.process
        return None if process is None else process.pid

    def finish(self, progress: Callable[[int, int], None] | None = None) -> VideoReport:
        """Wait until the rest is drawn. An exception meanwhile, such as a `KeyboardInterrupt`, leaves no file.

        `progress` is called with the frames done and their total, after each. Raises `InputError` if there is nothing
        to show, or the file cannot be written.
        """
        if self._drawing is None:
            raise InputError(f"video '{self.path}': nothing to show: no tick came from a simulated robot")
        backend, has_wav = self._drawing.finish(lambda done: progress and progress(done, self.frame_count))
        thinned = f"a long run: towards its end {float(self._rate):g} instead of {float(self._fps):g} frames per second"
        notice = "" if self._rate == self._fps else thinned
        return VideoReport(self.path, self.frame_count, self._duration, backend, notice, self._wav if has_wav else None)

    def abandon(self) -> None:
        """Nobody wants the video: end the drawing, and leave no file. May be called at any time."""
        if self._drawing is not None:
            self._drawing.discard()

    def _job(self, path: str) -> Job:
        wav = "" if self._keys is None else str(self._wav)
        return Job(path, self._model_factory(), self._size, self._fps, self._ghost, wav, self._goals)

    @property
    def _wav(self) -> Path:
        return self.path.with_suffix(".wav")


class _UnwantedError(Exception):
    """Nobody wants the video."""


class _Drawing:
    """The drawing process, fed by a thread: neither the process nor the pipe to it makes the control loop wait."""

    def __init__(self, path: Path, job: Callable[[str], Job]) -> None:
        self._path = path
        self._left = contextlib.ExitStack()
        self._file = self._left.enter_context(whole_file(path))
        self.items: queue.SimpleQueue[Moment | None] = queue.SimpleQueue()
        self.process: subprocess.Popen[bytes] | None = None
        self._done, self._backend, self._has_wav = 0, "", False
        self._error: Exception | None = None
        self._is_abandoned = False
        self._feeder = threading.Thread(target=self._feed, args=(job,), name="video", daemon=True)
        self._feeder.start()

    def finish(self, progress: Callable[[int], object]) -> tuple[str, bool]:
        """Wait for the process; what drew, and whether the sound is in a file of its own."""
        self.items.put(None)
        with self._left:  # the file takes its name, or vanishes with the exception
            try:
                while self._feeder.is_alive():
                    self._feeder.join(_LOOK_PERIOD)
                    progress(self._done)
            except BaseException:
                self.abandon()
                raise
            if self._error is not None:
                raise self._error
            return self._backend, self._has_wav

    def abandon(self) -> None:
        self._is_abandoned = True
        self.items.put(None)
        if self.process is not None:
            self.process.kill()
        self._feeder.join(_STOPPED_WITHIN)

    def discard(self) -> None:
        """Abandon it, and remove the file that it was written to."""
        self.abandon()
        with contextlib.suppress(_UnwantedError), self._left:
            raise _UnwantedError

    def _feed(self, job: Callable[[str], Job]) -> None:
        try:
            work = pickle.dumps(job(self._file.name))
            with subprocess.Popen(
                [sys.executable, "-m", _PROGRAM, str(os.getpid())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,  # the terminal's Ctrl-C is for the run
            ) as self.process:
                listener = threading.Thread(target=self._listen, name="video's progress", daemon=True)
                listener.start()
                self._hand_over(work)
                listener.join()
            if not self._backend and self._error is None:
                raise InputError(f"{self._path}: the drawing process ended, status {self.process.returncode}")
        except Exception as error:  # told by `finish`
            self._error = error

    def _hand_over(self, work: bytes) -> None:
        assert self.process is not None
        assert self.process.stdin is not None
        with contextlib.suppress(BrokenPipeError), self.process.stdin as pipe:  # it says why it ended
            pipe.write(work)
            while not self._is_abandoned:
                item = self.items.get()
                pipe.write(pickle.dumps(item))
                pipe.flush()
                if item is None:
                    return

    def _listen(self) -> None:
        assert self.process is not None
        assert self.process.stdout is not None
        for line in self.process.stdout:
            answer = json.loads(line)
            self._done = answer.get("frames", self._done)
            self._backend, self._has_wav = answer.get("backend", ""), answer.get("wav", False)
            if "error" in answer:
                self._error = InputError(f"{self._path}: {answer['error']}")


def save_snapshot(
    path: str | Path, model: mujoco.MjModel, qpos: FloatArray, *, size: tuple[int, int] = (1280, 960)
) -> str:
    """Write a PNG or JPEG of the model at `qpos`, shape (nq,), and return what drew it.

    A `qpos` that is not finite shows the model's reference pose.
    """
    path = output_file(path, "snapshot", *_SNAPSHOT_FORMATS)
    pictures = PoseRenderer(lambda: model, *size)
    try:
        image = Image.fromarray(pictures.draw(qpos))
        with whole_file(path) as file:
            image.save(file, _SNAPSHOT_FORMATS[path.suffix.lower()])
    finally:
        pictures.close()
    return pictures.backend


class _VideoProgress(BarOrLines):
    """A context that is called with how many frames are drawn. A line that cannot be written spoils no video."""

    def __init__(self, video: VideoSink, console: Console, hint: str) -> None:
        note = f" ({hint})" if hint else ""
        super().__init__(console, f"drawing the video{note}", None, TimeRemainingColumn())
        self._begin = monotonic()
        if not console.is_terminal:
            self._line(0.0, f"drawing the rest of {video.frame_count} frames of video{note} ...")

    def __call__(self, done: int, total: int) -> None:
        self.update(self._task, completed=done, total=total)
        elapsed = monotonic() - self._begin
        if self.is_due(elapsed):
            self._line(elapsed, f"{done} of {total} frames drawn")

    def _line(self, elapsed: float, text: str) -> None:
        with contextlib.suppress(OSError):
            self.say(elapsed, text)


def finish_video(video: VideoSink, console: Console, hint: str = "") -> VideoReport:
    """Wait until a video is drawn, and show how far it is; the hint says what Ctrl-C does."""
    with _VideoProgress(video, console, hint) as progress:
        return video.finish(progress)
