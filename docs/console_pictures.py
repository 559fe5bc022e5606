"""Take the picture of docs/console.md: `make picture`, or `python docs/console_pictures.py`.

A page of a real session in Chromium, which draws 3D in software. Needs the extra `test-integration` and a Chromium.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import sync_playwright

PICTURE = Path(__file__).resolve().parent / "pictures" / "console-locomotion.png"
CHROMIUM = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PLAY = ["--robot", "lite_biped", "--manual", "--console", "--pace", "realtime", "--viewer", "none", "--html", "none"]
PLOTS = ("left_knee_pitch position, rad", "base velocity forward, m/s")
PATIENCE = 120_000  # ms


def operate(page: Any) -> None:
    """Lead the robot to LOCOMOTION, let it walk, and add plots."""
    page.wait_for_selector("#cover", state="hidden")
    page.wait_for_timeout(5000)
    page.get_by_text("WebGL is running in software mode").evaluate_all("found => found.forEach((one) => one.remove())")
    page.keyboard.press("Space")
    for word, mode in (("LOAD_A", "STANDBY"), ("START_LOCOMOTION", "LOCOMOTION")):
        while page.get_attribute("#mode", "data-mode") != mode:
            page.get_by_role("button", name=word).click()
            page.wait_for_timeout(2000)
    page.get_by_text("Plots", exact=True).first.click()
    for plot in PLOTS:
        page.wait_for_timeout(2000)
        page.get_by_role("combobox", name="Add a plot").click()
        page.get_by_role("option", name=plot).click()
    slider = page.locator("[role=slider]").first
    slider.focus()
    for _ in range(30):
        slider.press("ArrowRight")
    page.wait_for_timeout(8000)


def main() -> None:
    """Run a session, operate it, and store the picture in 256 colours."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        environment = {**os.environ, "XDG_RUNTIME_DIR": folder, "NO_COLOR": "1"}
        command = [sys.executable, "-m", "humanoid_sim.play", *PLAY, "--record", f"{folder}/run.mcap"]
        with subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, env=environment
        ) as play:
            assert play.stdout is not None
            found = next(filter(None, (re.search(r"console on (http://\S+)", line) for line in play.stdout)))
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM, timeout=PATIENCE)
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            page.set_default_timeout(PATIENCE)
            page.goto(found[1])
            operate(page)
            with Image.open(io.BytesIO(page.screenshot())) as picture:
                picture.convert("RGB").quantize(256).save(PICTURE, optimize=True)
            browser.close()
            play.terminate()
            play.communicate()


if __name__ == "__main__":
    main()
