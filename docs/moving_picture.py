"""Make README's moving picture from real runs: `make picture`, or `python docs/moving_picture.py`.

Three scenes, one after the other: the arms follow a motion, the biped walks, and somebody makes it walk from the
console. What the runs leave lies in `build/moving-picture`, where a scene that is there is not run again; remove the
folder after a change of a policy. Needs the extra `test-frontends` and a Chromium.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
RUNS = ROOT / "build" / "moving-picture"
RESULT = ROOT / "docs" / "play.webp"
SIZE = 640, 360
FRAME = 80
"""ms that a frame of a video is shown: 12.5 frames a second."""
VIDEOS = (
    ("arms", ("--motion", "wave"), 5.2, 9.6),
    ("biped", ("--robot", "lite_biped", "--command", "0.5,0,0"), 5.2, 9.6),
)
"""Each scene with the options of its run, and from when to when it is shown, s of its video."""
CHROMIUM = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
WINDOW = {"width": 1280, "height": 720}
LONGEST = 900
"""ms that a picture of the console is shown at most: software draws about one a second, and clicks wait for it."""
Frames = list[tuple[Image.Image, int]]
"""Pictures, and for how many ms each is shown."""


def play(*options: str) -> list[str]:
    """The command line of a run that leaves nothing but what its options name."""
    return [sys.executable, "-m", "humanoid_sim.play", "--viewer", "none", "--record", "none", *options]


def video_frames(path: Path, begin: float, end: float) -> Frames:
    """The part of a video from `begin` to `end`, s, in the size and at the rate of the moving picture."""
    frames: Frames = []
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            if frame.time >= begin + len(frames) * FRAME / 1e3 and frame.time < end:
                frames.append((frame.to_image().resize(SIZE, Image.Resampling.LANCZOS), FRAME))
    return frames


def console_frames(folder: Path) -> Frames:
    """The pictures of the console, each as long as it was to be seen."""
    times = json.loads((folder / "times.json").read_text("utf-8"))
    durations = [min(LONGEST, round(1e3 * (after - at))) for at, after in pairwise(times)]
    frames = []
    for i, duration in enumerate([*durations, LONGEST]):
        with Image.open(folder / f"{i:03}.png") as picture:
            frames.append((picture.convert("RGB").resize(SIZE, Image.Resampling.LANCZOS), duration))
    return frames


def operate(page: Any, folder: Path) -> None:
    """Make the robot walk from its page, as an operator does, and take pictures of that."""
    times: list[float] = []

    def watch(seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            page.screenshot(path=folder / f"{len(times):03}.png")
            times.append(time.monotonic())

    def ask(word: str, mode: str) -> None:
        page.wait_for_selector(f'[data-ask="{word}"]:not(.refused)' if word != "damp" else "#damp")
        page.evaluate("(word) => ask(word)", word)
        page.wait_for_selector(f'#mode[data-mode="{mode}"]')

    ask("damp", "DAMPING")
    watch(2.0)
    ask("load_a", "STANDBY")
    watch(3.0)
    ask("start_locomotion", "LOCOMOTION")
    watch(8.0)
    ask("damp", "DAMPING")
    watch(1.0)
    (folder / "times.json").write_text(json.dumps(times), "utf-8")


def run_console(folder: Path) -> None:
    """Run the biped with its console, and take the console's pictures in a browser."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415

    chromium = shutil.which("chromium")
    if chromium is None:
        sys.exit("error: the console's pictures need chromium, which is not installed: apt-get install chromium")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    options = ("--robot", "lite_biped", "--command", "0.3,0,0", "--manual", "--console", "--pace", "realtime")
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder), "NO_COLOR": "1"}
    command = play(*options, "--video", "none")
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(command, text=True, env=environment, **pipes) as process:
        try:
            assert process.stdout is not None
            addresses = (re.search(r"console: .* (http://\S+)", line) for line in process.stdout)
            address = next(found[1] for found in addresses if found)
            with sync_playwright() as driver:
                browser = driver.chromium.launch(executable_path=chromium, args=list(CHROMIUM))
                page = browser.new_page(viewport=WINDOW)
                page.set_default_timeout(120_000)
                page.goto(address)
                page.wait_for_selector("#cover", state="hidden")
                page.wait_for_timeout(4000)  # the 3D view is loaded
                operate(page, folder)
                browser.close()
        finally:
            process.terminate()
            process.communicate(timeout=60.0)


def main() -> int:
    """Run what was not run yet, and join the scenes; returns the exit status."""
    RUNS.mkdir(parents=True, exist_ok=True)
    frames: Frames = []
    for name, options, begin, end in VIDEOS:
        path = RUNS / f"{name}.mp4"
        if not path.is_file():
            subprocess.run(play(*options, "--video", str(path)), check=True)
        frames += video_frames(path, begin, end)
    if not (RUNS / "console" / "times.json").is_file():
        run_console(RUNS / "console")
    frames += console_frames(RUNS / "console")
    pictures, durations = zip(*frames, strict=True)
    pictures[0].save(
        RESULT, save_all=True, append_images=pictures[1:], duration=list(durations), loop=0, quality=60, method=4
    )
    print(f"{RESULT}: {len(frames)} frames, {sum(durations) / 1e3:.1f} s, {RESULT.stat().st_size / 1e6:.2f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
