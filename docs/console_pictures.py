"""Take the pictures of docs/console.md: `make picture`, or `python docs/console_pictures.py`.

Each is a page of a real session in Chromium, which draws 3D in software: some minutes in all. Needs the extra
`test-integration` and a Chromium.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image

PATIENCE = 120_000
"""ms."""
PICTURES = Path(__file__).resolve().parent / "pictures"
SCREEN = {"width": 1280, "height": 800}
ELBOW = "position and command: left_elbow_pitch"
CHARTS = (ELBOW, "tracking error: positions of bodies")
MODES = {
    "damp": "DAMPING",
    "load_a": "STANDBY",
    "load_b": "STANDBY",
    "start_locomotion": "LOCOMOTION",
    "start_remote": "REMOTE",
}
"""Modes by the words that ask for them."""
FAULT = "over_temperature:left_elbow_pitch@60+60"
"""While the policy drives."""


@dataclass
class Desk:
    """A session, and the page of its operator."""

    play: subprocess.Popen[str]
    page: Any

    def ask(self, word: str) -> None:
        """Ask for a mode as soon as it is offered, and again: a page that is drawn slowly may ask too late."""
        self.page.wait_for_selector("#damp" if word == "damp" else f'#intents [data-ask="{word}"]:not(.refused)')
        while self.page.get_attribute("#mode", "data-mode") != MODES[word]:
            self.page.evaluate("(word) => ask(word)", word)
            for _ in range(20):
                if self.page.get_attribute("#mode", "data-mode") != MODES[word]:
                    self.stay(0.2)

    def reach(self, mode: str) -> None:
        """Wait for a mode."""
        self.page.wait_for_selector(f'#mode[data-mode="{mode}"]')

    def stay(self, seconds: float) -> None:
        """Let the robot go on."""
        self.page.wait_for_timeout(1000.0 * seconds)

    def take(self, name: str, part: str = "") -> None:
        """Store a picture, or one of a part of the page, in 256 colours."""
        shown = self.page.locator(part) if part else self.page
        with Image.open(io.BytesIO(shown.screenshot())) as picture:
            picture.convert("RGB").quantize(256).save(PICTURES / f"console-{name}.png", optimize=True)


@contextmanager
def desk(driver: Any, folder: Path, *options: str) -> Iterator[Desk]:
    """Run a session with a console; give its page once it shows the robot."""
    command = [sys.executable, "-m", "humanoid_sim.play", "--manual", "--console", "--pace", "realtime", *options]
    results = ["--viewer", "none", "--html", "none", "--record", "run.mcap", "--overwrite"]
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder), "NO_COLOR": "1"}
    chromium = driver.chromium.launch(
        executable_path=shutil.which("chromium"),
        args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
    )
    with subprocess.Popen(
        [*command, *results],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=folder,
        env=environment,
    ) as play:
        try:
            assert play.stdout is not None
            said = ""
            while not (found := re.search(r"console on (http://\S+)", said)):
                line = play.stdout.readline()
                assert line, said
                said += line
            page = chromium.new_page(viewport=SCREEN)
            page.set_default_timeout(PATIENCE)
            page.goto(found[1])
            page.wait_for_selector("#cover", state="hidden")
            page.frame_locator("#view").locator("canvas").first.wait_for()
            page.add_style_tag(
                content="#session { visibility: hidden } #policy-text { display: none }"
            )  # paths of this machine
            page.frame_locator("#view").locator(".mantine-Notification-closeButton").evaluate(
                "it => it.click()"
            )  # WebGL in software
            yield Desk(play, page)
        finally:
            play.kill()
            chromium.close()


def simulated(driver: Any, folder: Path) -> None:
    """Show LOCOMOTION with plots."""
    with desk(driver, folder) as at:
        at.stay(3.0)
        at.ask("damp")
        at.ask("load_a")
        at.ask("start_locomotion")
        for name in CHARTS:
            at.page.select_option("#add-plot", name)
        at.page.select_option(f'[data-plot="{ELBOW}"] select', "effort: left_elbow_pitch")
        for name in ("motion's pose", "commanded pose"):
            box = at.page.locator("#figures").get_by_label(name)
            if not box.is_checked():
                box.click()
        at.stay(5.0)
        at.take("locomotion")


def in_remote(driver: Any, folder: Path) -> None:
    """Show the sliders."""
    with desk(driver, folder) as at:
        at.ask("damp")
        at.ask("load_b")
        at.ask("start_remote")
        at.page.select_option("#sliders-joint", "left_elbow_pitch")
        at.page.click("#sliders-take")
        at.stay(2.0)
        at.page.locator("#sliders").scroll_into_view_if_needed()
        at.take("sliders")


def damped(driver: Any, folder: Path) -> None:
    """Have a motor report a fault while the policy drives."""
    channel = "udp_multicast:239.74.163.9"
    emulate = [sys.executable, "-m", "humanoid_sim.hardware", "emulate", "--channel", channel, "--fault", FAULT]
    with subprocess.Popen([*emulate, "--quiet"], stdout=subprocess.DEVNULL) as motors:
        try:
            given = (
                "--hardware",
                channel,
                "--policy",
                "lite_tracking",
                "--calibration",
                "none",
                "--yes",
                "--no-gamepad",
            )
            with desk(driver, folder, *given) as at:
                at.ask("damp")
                at.ask("load_a")
                at.ask("start_locomotion")
                at.reach("DAMPING")
                at.stay(1.0)
                at.take("damping")
        finally:
            motors.kill()


def main() -> None:
    """Take all of them."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - not installed everywhere

    with sync_playwright() as driver:
        for scene in (simulated, in_remote, damped):
            with tempfile.TemporaryDirectory() as folder:
                scene(driver, Path(folder))


if __name__ == "__main__":
    main()
