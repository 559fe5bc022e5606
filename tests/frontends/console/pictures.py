"""Takes pictures of docs/console.md: `python tests/frontends/console/pictures.py docs/pictures`.

All but that of a page without connection. Each is a page of a real session in Chromium, which draws 3D in software.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PATIENCE = 60_000
"""ms."""
SCREEN, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
CHARTS = (
    "left_elbow_pitch: position and command, rad",
    "positions of bodies: tracking error, mm",
    "left_elbow_pitch: effort, N·m",
    "joint_pos: observation, as observed",
)
FAULT = "over_temperature:left_elbow_pitch@24+60"
"""While the policy drives."""


@dataclass
class Desk:
    """A session, and the page of its operator."""

    play: subprocess.Popen[str]
    page: Any

    def ask(self, intent: str) -> None:
        """As soon as it is allowed."""
        self.page.wait_for_selector(f'#intents [data-ask="{intent}"]:not(.refused)', timeout=PATIENCE)
        self.page.click(f'#intents [data-ask="{intent}"]')

    def damp(self) -> None:
        self.page.click("#damp")
        self.reach("DAMPING")

    def reach(self, mode: str) -> None:
        self.page.wait_for_selector(f'#mode[data-mode="{mode}"]', timeout=PATIENCE)

    def stay(self, seconds: float) -> None:
        self.page.wait_for_timeout(1000.0 * seconds)

    def show_plots(self, names: Sequence[str]) -> None:
        for name in names:
            self.page.select_option("#add-plot", value=_option(self.page, name))

    def take(self, path: Path) -> None:
        self.page.screenshot(path=path)


def _option(page: Any, title: str) -> str:
    """The value in the list of plots of what has this title: its name, and the group that it is under."""
    name, kind = title.split(",", maxsplit=1)[0].split(": ")
    options = page.eval_on_selector_all(
        "#add-plot option", "all => all.map(one => [one.value, one.label, one.parentElement.label || ''])"
    )
    return next(value for value, label, group in options if (label, group.split(",")[0]) == (name, kind))


@contextmanager
def desk(driver: Any, folder: Path, *options: str, size: dict[str, int] = SCREEN) -> Iterator[Desk]:
    """A session with a console, and its page once it shows the robot."""
    command = [sys.executable, "-m", "humanoid_sim.play", "--manual", "--console", "--pace", "realtime", *options]
    results = ["--viewer", "none", "--video", "none", "--record", "run.mcap", "--overwrite"]
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
            page = chromium.new_page(viewport=size)
            page.goto(found[1])
            page.wait_for_selector("#cover", state="hidden", timeout=PATIENCE)
            page.frame_locator("#view").locator("canvas").first.wait_for(timeout=PATIENCE)
            page.add_style_tag(content="#session { visibility: hidden }")  # paths of this machine
            page.frame_locator("#view").locator(".mantine-Notification-closeButton").evaluate(
                "it => it.click()"
            )  # WebGL in software
            yield Desk(play, page)
        finally:
            play.kill()
            chromium.close()


def simulated(driver: Any, folder: Path, pictures: Path) -> None:
    """STANDBY, and LOCOMOTION with plots."""
    with desk(driver, folder) as at:
        at.stay(3.0)
        at.damp()
        at.ask("load_a")
        at.stay(1.5)
        at.take(pictures / "console-standby.png")
        at.ask("start_locomotion")
        at.show_plots(CHARTS)
        for name in ("motion's pose", "commanded pose"):
            box = at.page.locator("#figures").get_by_label(name)
            if not box.is_checked():
                box.click()
        at.stay(5.0)
        at.take(pictures / "console-locomotion.png")


def on_motors(driver: Any, folder: Path, pictures: Path) -> None:
    """REMOTE, a fault while the policy drives, and sliders."""
    given = ("--hardware", f"virtual:{folder.name}", "--policy", "lite_tracking", "--yes", "--no-gamepad")
    with desk(driver, folder, *given, "--remote", "gravity") as at:
        at.damp()
        at.ask("load_b")
        at.ask("start_remote")
        at.reach("REMOTE")
        at.stay(3.0)
        at.page.locator("#motors").scroll_into_view_if_needed()
        at.take(pictures / "console-remote.png")
    with desk(driver, folder) as at:
        at.damp()
        at.ask("load_b")
        at.ask("start_remote")
        at.reach("REMOTE")
        at.page.select_option("#sliders-joint", "left_elbow_pitch")
        at.page.click("#sliders-take")
        at.stay(2.0)
        at.page.locator("#sliders").scroll_into_view_if_needed()
        at.take(pictures / "console-sliders.png")


def damped(driver: Any, folder: Path, pictures: Path) -> None:
    """A fault of a motor while the policy drives."""
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
                at.damp()
                at.ask("load_a")
                at.ask("start_locomotion")
                at.reach("LOCOMOTION")
                at.reach("DAMPING")
                at.stay(1.0)
                at.take(pictures / "console-damping.png")
        finally:
            motors.kill()


def on_a_phone(driver: Any, folder: Path, pictures: Path) -> None:
    """A narrow page."""
    with desk(driver, folder, size=PHONE) as at:
        at.damp()
        at.ask("load_a")
        at.ask("start_locomotion")
        at.reach("LOCOMOTION")
        at.stay(3.0)
        at.take(pictures / "console-phone.png")


def main(pictures: Path) -> None:
    """Take all of them."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - not installed everywhere

    pictures = pictures.absolute()
    pictures.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as driver:
        for scene in (on_motors, simulated, damped, on_a_phone):
            with tempfile.TemporaryDirectory() as folder:
                scene(driver, Path(folder), pictures)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
