"""Draws and encodes a video in a process of its own, while the robot still runs.

On standard input it takes pickles: a `Job`, then `Moment`s as they come, then None. On standard output it tells, a JSON
object a line: how many frames are done, and in the end what drew them, or what went wrong. If its input ends without
None, or the process that started it (its argument) is gone, nobody waits for the file, and it is removed.
"""

from __future__ import annotations

import json
import math
import os
import pickle
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain
from pathlib import Path
from threading import Thread
from time import sleep
from typing import cast

import av
import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.files import whole_file
from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.caption import Caption, draw_caption
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.rendering.offscreen import PoseRenderer
from humanoid_sim.rendering.piano_roll import HIT, MISSED, WRONG, rgb
from humanoid_sim.rendering.piano_sound import RATE, PianoSound, Samples, Stroke, write_wav
from humanoid_sim.robots.piano import KEY_COUNT, key_joint_names

_H264 = ("libx264", "libopenh264")
_AAC, _AAC_BITS = "aac", 128_000
"""Sound that every browser plays with H.264, and bits per second."""
_LOOK_PERIOD = 0.2
"""s between two looks at whether the process that wants the video is there."""
_NICENESS = 5
"""The robot that is being simulated goes first."""


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """Video to draw, and its file."""

    path: str
    model: mujoco.MjModel
    size: tuple[int, int]
    """Width and height in pixels."""
    fps: Fraction
    ghost: ReferenceGhost | None = None
    wav: str = ""
    """Path of the sound where this machine has no encoder for it; empty where the run has no piano, and no sound."""
    goals: npt.NDArray[np.bool_] | None = None
    """Shape (F, 88), whether a key should be down; None where no song is known."""


@dataclass(frozen=True, slots=True, eq=False)
class Following:
    """Motion and song that a policy follows."""

    ghost: ReferenceGhost | None
    goals: npt.NDArray[np.bool_] | None
    """As of `Job`."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """One frame."""

    time: float
    """s since the first."""
    qpos: FloatArray
    """Shape (nq,)."""
    caption: Caption
    frame: int | None = None
    """Index of the reference's frame, while a policy follows it."""
    anchor: FloatArray | None = None
    """Pose (7,), m and w x y z, of the anchor body when the policy was shown frame 0; None where there is none."""
    strokes: tuple[Stroke, ...] = ()
    """Strokes of a piano's keys since the moment before, at their times as `time`."""
    following: Following | None = None
    """Reference of a policy that was loaded since the moment before; None for the same as before."""


def draw_video(job: Job, moments: Iterator[Moment], progress: Callable[[int], None]) -> tuple[str, bool]:
    """Write an MP4 (H.264) with a picture of every moment, shown at its time, and with the sound (AAC) of a piano.

    Returns what drew it, and whether the sound is in a file of its own. Raises `av.FFmpegError` if it cannot be
    written.
    """
    first = next(moments)
    codec = next(name for name in _H264 if name in av.codecs_available)
    with (
        closing(PoseRenderer(lambda: job.model, *job.size, fastest=True)) as pictures,
        av.open(job.path, "w", format="mp4", options={"movflags": "+faststart"}) as container,
    ):
        stream = cast(
            "av.VideoStream", container.add_stream(codec, rate=job.fps, options={"crf": "20", "preset": "veryfast"})
        )
        stream.width, stream.height = job.size
        stream.pix_fmt = "yuv420p"
        stream.time_base = stream.codec_context.time_base = 1 / job.fps
        sound = _Sound(container, job) if job.wav else None
        lights = KeyLights(job.model, job.goals) if job.wav else None
        for count, moment in enumerate(chain([first], moments), start=1):
            if moment.following is not None:
                job = replace(job, ghost=moment.following.ghost, goals=moment.following.goals)
                lights = KeyLights(job.model, job.goals) if job.wav else None
            if lights is not None:
                lights.show(moment.strokes, moment.frame)
            frame = av.VideoFrame.from_ndarray(_picture(job, pictures, moment), format="rgb24")
            # As moments are chosen: rounding would give two of them, half a frame off, one place.
            frame.pts, frame.time_base = math.floor(moment.time * job.fps), 1 / job.fps
            container.mux(stream.encode(frame))
            if sound is not None:
                sound.add(moment)
            progress(count)
        container.mux(stream.encode(None))
        if sound is not None:
            sound.finish()
        return pictures.backend, sound is not None and sound.is_beside


class _Sound:
    """The sound track of a video, or, without an encoder for one, a WAV beside it."""

    def __init__(self, container: av.container.OutputContainer, job: Job) -> None:
        self._container, self._wav = container, job.wav
        self._piano = PianoSound()
        self._stream: av.AudioStream | None = None
        self._kept: list[Samples] = []
        self._count = 0
        if _AAC in av.codecs_available:
            self._stream = cast("av.AudioStream", container.add_stream(_AAC, rate=RATE, layout="mono"))
            self._stream.bit_rate = _AAC_BITS

    @property
    def is_beside(self) -> bool:
        return self._stream is None

    def add(self, moment: Moment) -> None:
        self._piano.strike(moment.strokes)
        samples = self._piano.until(moment.time)
        if self._stream is None:
            self._kept.append(samples)
        elif len(samples):
            frame = av.AudioFrame.from_ndarray(samples[None], format="fltp", layout="mono")
            frame.sample_rate, frame.pts, frame.time_base = RATE, self._count, Fraction(1, RATE)
            self._count += len(samples)
            self._container.mux(self._stream.encode(frame))

    def finish(self) -> None:
        if self._stream is not None:
            self._container.mux(self._stream.encode(None))
            return
        with whole_file(Path(self._wav)) as file:
            write_wav(file, np.concatenate(self._kept))


def _picture(job: Job, pictures: PoseRenderer, moment: Moment) -> npt.NDArray[np.uint8]:
    ghost = None
    if job.ghost is not None and moment.frame is not None:
        if moment.anchor is not None:
            job.ghost.align(moment.anchor)
        ghost = job.ghost.pose(job.model, moment.qpos, moment.frame)
    return draw_caption(pictures.draw(moment.qpos, ghost), moment.caption)


def _end_with(parent: int, path: str) -> None:
    """End this process, and leave no file, within a moment of the end of `parent`: there may be minutes to draw."""
    while os.getppid() == parent:
        sleep(_LOOK_PERIOD)
    with suppress(OSError):
        os.unlink(path)
    os._exit(1)


def main(parent: int) -> int:
    """Draw what standard input asks for, for the process `parent`."""
    output = os.fdopen(os.dup(sys.stdout.fileno()), "w", buffering=1)
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # whatever a driver prints is not an answer
    os.nice(_NICENESS)

    def tell(**answer: object) -> None:
        with suppress(OSError):
            print(json.dumps(answer), file=output)

    job: Job = pickle.load(sys.stdin.buffer)
    moments: Iterator[Moment] = iter(lambda: pickle.load(sys.stdin.buffer), None)
    Thread(target=_end_with, args=(parent, job.path), name="parent", daemon=True).start()
    try:
        backend, is_beside = draw_video(job, moments, lambda count: tell(frames=count))
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
    tell(backend=backend, wav=is_beside)
    return 0


class KeyLights:
    """Colours of a model's keys. A model without a piano has none, and nothing happens.

    The colours are the piano roll's; while no song is played every key that is down is right.
    """

    def __init__(self, model: mujoco.MjModel, goals: npt.NDArray[np.bool_] | None = None) -> None:
        """Find the keys of a model to be drawn, whose `geom_rgba` is written, and note their own colours.

        `goals`, shape (F, 88), say whether a key should be down in a frame; None without a song.
        """
        self._model, self._goals = model, goals
        joints = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in key_joint_names()]
        bodies = [model.jnt_bodyid[joint] if joint >= 0 else -1 for joint in joints]
        self._geoms = [np.flatnonzero(model.geom_bodyid == body).tolist() for body in bodies]
        self._own = []
        for geoms in self._geoms:
            for geom in geoms:
                material = int(model.geom_matid[geom])
                if material >= 0:  # which would hide the geom's own colour
                    model.geom_rgba[geom] = model.mat_rgba[material]
                    model.geom_matid[geom] = -1
            self._own.append([model.geom_rgba[geom].copy() for geom in geoms])
        self._down = np.zeros(KEY_COUNT, dtype=np.bool_)

    def show(self, strokes: Iterable[Stroke], frame: int | None = None) -> None:
        """Take what happened to the keys since the last picture, and the frame of the song that is shown, if any is."""
        for stroke in strokes:
            self._down[stroke.key] = stroke.is_down
        wanted = self._down
        if self._goals is not None and frame is not None:
            wanted = self._goals[min(frame, len(self._goals) - 1)]
        for key, geoms in enumerate(self._geoms):
            colour = _COLOURS.get((bool(self._down[key]), bool(wanted[key])))
            for geom, own in zip(geoms, self._own[key], strict=True):
                self._model.geom_rgba[geom] = own if colour is None else (*colour, 1.0)


_COLOURS = {(True, True): rgb(HIT), (True, False): rgb(WRONG), (False, True): rgb(MISSED)}
"""By whether a key is down, and whether it should be."""


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
