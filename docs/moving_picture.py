"""Make README's moving picture from real runs: `make picture`, or `python docs/moving_picture.py`.

The page of each run is opened in Chromium, which draws it in software: some minutes in all. What the runs leave lies in
`build/moving-picture`, where a page that is there is not made again. Needs the extra `test-integration` and a Chromium.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from humanoid_sim.files import whole_file

ROOT = Path(__file__).resolve().parent.parent
RUNS = ROOT / "build" / "moving-picture"
RESULT = ROOT / "docs" / "play.webp"
SIZE = {"width": 640, "height": 400}
PERIOD = 0.1
"""s between two frames."""
SCENES = (
    ("arms", ("--motion", "wave"), 6.5, 10.5),
    ("biped", ("--robot", "lite_biped", "--command", "0.5,0,0"), 6.5, 10.5),
    ("piano", ("--robot", "lite_piano", "--song", "ode_to_joy"), 7.0, 11.0),
)
"""Each scene with the options of its run, and from when to when it is shown, s of the run."""
CHROMIUM = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def frames(page: Page, file: Path, begin: float, end: float) -> list[Image.Image]:
    """Return pictures of a run's page, from `begin` to `end`, s."""
    page.goto(file.as_uri())
    page.wait_for_selector('[role="slider"]', state="attached")
    page.wait_for_timeout(5000.0)
    page.locator(".mantine-Notification-closeButton").evaluate("button => button.click()")  # WebGL in software
    shown = []
    for time in np.arange(begin, end, PERIOD):
        box = page.locator("input").first  # the time, which also pauses
        box.fill(f"{time:.2f}")
        box.press("Enter")
        page.wait_for_timeout(700.0)
        picture = page.screenshot(clip={"x": 0, "y": 0, "width": SIZE["width"], "height": SIZE["height"] - 40})
        shown.append(Image.open(io.BytesIO(picture)).convert("RGB"))
    return shown


def main() -> int:
    """Make the pages that are not there, and the picture; returns the exit status."""
    RUNS.mkdir(parents=True, exist_ok=True)
    pictures: list[Image.Image] = []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM)
        page = browser.new_page(viewport=SIZE)
        page.set_default_timeout(120_000)
        for name, options, begin, end in SCENES:
            file = RUNS / f"{name}.html"
            if not file.is_file():
                play = [sys.executable, "-m", "humanoid_sim.play", "--record", "none", "--html", str(file)]
                subprocess.run([*play, "--duration", f"{end:g}", *options], check=True)
            pictures += frames(page, file, begin, end)
        browser.close()
    with whole_file(RESULT) as result:
        first, *rest = pictures
        durations = [round(1e3 * PERIOD)] * len(pictures)
        options = {"duration": durations, "loop": 0, "quality": 60, "method": 4}
        first.save(result, "WEBP", save_all=True, append_images=rest, **options)
    print(f"{RESULT}: {len(pictures)} frames, {RESULT.stat().st_size / 1e6:.2f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
