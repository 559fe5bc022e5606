"""Make README's moving picture from real runs: `make picture`, or `python docs/moving_picture.py`.

Four scenes, one after the other: the arms follow a motion, the biped walks, hands play the piano, and somebody makes
the biped walk from the console. What the runs leave lies in `build/moving-picture`, where a scene that is there is not
run again; remove the folder after a change of a policy. Needs the extra `test-integration` and a Chromium.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
from PIL import Image, ImageDraw, ImageFont

from humanoid_sim.errors import InputError
from humanoid_sim.files import whole_file
from humanoid_sim.policy.song import goals, named_song
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.rendering.offscreen import animated_webp
from humanoid_sim.rendering.video import VideoSink
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model

ROOT = Path(__file__).resolve().parent.parent
RUNS = ROOT / "build" / "moving-picture"
RESULT = ROOT / "docs" / "play.webp"
SIZE = 640, 360
FRAME = 80
"""ms that a frame of a video is shown: 12.5 frames a second."""
SONG, SONG_STEP = "ode_to_joy", 0.02
"""Notes that the hands play, and s between two rows of them."""
VIDEOS = (
    ("arms", ("--motion", "wave"), 5.2, 9.6),
    ("biped", ("--robot", "lite_biped", "--command", "0.5,0,0"), 5.2, 9.6),
    ("piano", ("--robot", "lite_piano", "--song", SONG), 6.0, 11.0),
)
"""Each scene with the options of its run, and from when to when it is shown, s of the run."""
CAPTIONS = {
    "arms": "A trained network moves simulated arms along a recorded motion",
    "biped": "Another one walks, asked for half a metre per second",
    "piano": "A third one plays Ode to Joy; keys light up green when pressed as the song asks",
    "console": "An operator starts the walk, and stops it, from a page in the browser",
}
"""Captions of the scenes, for somebody who has never seen a robot's control program."""
STRIP = 26
"""Pixels of a caption's height."""
WINDOW = {"width": 1280, "height": 720}
PERIOD = 0.7
"""s between two pictures of the console, where the machine draws them so fast."""
LONGEST = 500
"""ms that a picture of the console is shown at most: software draws about one a second, and nobody waits for that."""
Frames = list[tuple[Image.Image, int]]
"""Pictures, and for how many ms each is shown."""


def play(*options: str) -> list[str]:
    """Return the command line of a run that nobody watches."""
    return [sys.executable, "-m", "humanoid_sim.play", "--viewer", "none", "--video", "none", *options]


def film(recording: Path, video: Path, begin: float, end: float) -> None:
    """Make a video of the part of a recording from `begin` to `end`, s."""
    run = open_recording(recording)
    robot = load_robot(run.header.robot)
    song = None if robot.piano is None else goals(named_song(SONG, robot)[0], SONG_STEP)
    sink = VideoSink(video, lambda: build_model(robot), size=SIZE, goals=song)
    for tick in run.ticks():
        if begin <= tick.input.state.time < end:
            sink.tick(tick)
    sink.finish()


def console_frames(folder: Path) -> Frames:
    """Return the pictures of the console, each as long as it was to be seen."""
    times = json.loads((folder / "times.json").read_text("utf-8"))
    durations = [min(LONGEST, round(1e3 * (after - at))) for at, after in pairwise(times)]
    frames = []
    for i, duration in enumerate([*durations, LONGEST]):
        with Image.open(folder / f"{i:03}.png") as picture:
            frames.append((picture.convert("RGB").resize(SIZE, Image.Resampling.LANCZOS), duration))
    return frames


def operate(desk: Any, folder: Path) -> None:
    """Make the robot walk from its page, as an operator does, and take pictures of that."""
    times: list[float] = []

    def watch(count: int) -> None:
        for i in range(count):
            desk.page.screenshot(path=folder / f"{len(times):03}.png")
            times.append(time.monotonic())
            if i + 1 < count:
                desk.stay(max(0.0, times[-1] + PERIOD - time.monotonic()))

    desk.ask("damp")
    watch(2)
    desk.ask("load_a")
    watch(4)
    desk.ask("start_locomotion")
    watch(12)
    desk.ask("damp")
    watch(2)
    (folder / "times.json").write_text(json.dumps(times), "utf-8")


def run_console(folder: Path) -> None:
    """Run the biped with its console, and take the console's pictures in a browser."""
    from console_pictures import desk  # noqa: PLC0415 - beside this file
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - not installed everywhere

    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    options = ("--robot", "lite_biped", "--command", "0.3,0,0")
    with (
        sync_playwright() as driver,
        tempfile.TemporaryDirectory() as place,
        desk(driver, Path(place), *options, size=WINDOW) as at,
    ):
        operate(at, folder)


def captioned(picture: Image.Image, text: str) -> Image.Image:
    """Return a scene's picture with a strip that says what it shows, over the strip that recordings have."""
    picture = picture.copy()
    draw = ImageDraw.Draw(picture)
    draw.rectangle((0, picture.height - STRIP, *picture.size), fill=(22, 26, 32))
    place = picture.width / 2, picture.height - STRIP / 2
    draw.text(place, text, fill=(244, 246, 248), font=ImageFont.load_default(15), anchor="mm")
    return picture


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


def main() -> int:
    """Run what was not run yet, and join the scenes; returns the exit status."""
    RUNS.mkdir(parents=True, exist_ok=True)
    frames: Frames = []
    for name, options, begin, end in VIDEOS:
        recording, video = RUNS / f"{name}.mcap", RUNS / f"{name}.mp4"
        if not recording.is_file():
            subprocess.run(play(*options, "--duration", f"{end:g}", "--record", str(recording)), check=True)
        if not video.is_file():
            film(recording, video, begin, end)
        pictures = video_frames(video, 0.0, end - begin, size=SIZE, rate=1e3 / FRAME)
        frames += [(captioned(picture, CAPTIONS[name]), FRAME) for picture in pictures]
    if not (RUNS / "console" / "times.json").is_file():
        run_console(RUNS / "console")
    frames += [(captioned(picture, CAPTIONS["console"]), shown) for picture, shown in console_frames(RUNS / "console")]
    pictures, durations = zip(*frames, strict=True)
    with whole_file(RESULT) as file:
        file.write(animated_webp(pictures, durations))
    print(f"{RESULT}: {len(frames)} frames, {sum(durations) / 1e3:.1f} s, {RESULT.stat().st_size / 1e6:.2f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
