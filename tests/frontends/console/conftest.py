"""A session that runs in real time with its console, as an operator starts it."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest


@dataclass
class Played:
    process: subprocess.Popen[str]
    control: str
    """Address."""
    read_only: str
    folder: Path
    runtime: Path
    """XDG_RUNTIME_DIR."""

    @property
    def authority(self):
        return self.control.split("/")[2]

    @property
    def children(self):
        """Process ids: the console, the only one."""
        tasks = Path(f"/proc/{self.process.pid}/task").iterdir()
        return [int(name) for task in tasks for name in (task / "children").read_text().split()]


@pytest.fixture(scope="module")
def start_play(tmp_path_factory):
    """Starts `play` with a console and further options; all end with the module."""
    for package in ("viser", "mjviser", "plotly", "websockets"):
        pytest.importorskip(package)
    with ExitStack() as stack:
        yield lambda *options: stack.enter_context(_playing(tmp_path_factory.mktemp("run"), options))


@pytest.fixture(scope="module")
def played(start_play):
    return start_play()


@pytest.fixture(scope="module")
def start_browser():
    """Starts Chromium, which draws 3D in software."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("there is no chromium here (apt-get install chromium)")
    options = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with playwright.sync_playwright() as driver:
        yield lambda: driver.chromium.launch(executable_path=chromium, args=options)


@pytest.fixture(scope="module")
def browser(start_browser):
    browser = start_browser()
    yield browser
    browser.close()


@contextmanager
def _playing(folder, options):
    command = [sys.executable, "-m", "humanoid_sim.play", "--manual", "--console", "--pace", "realtime", *options]
    nothing = ["--viewer", "none", "--video", "none", "--record", "run.mcap"]
    runtime = tempfile.TemporaryDirectory(prefix="hs-")
    environment = {**os.environ, "XDG_RUNTIME_DIR": runtime.name, "NO_COLOR": "1"}
    with (
        runtime,
        subprocess.Popen(
            [*command, *nothing],
            stdin=subprocess.DEVNULL,  # no terminal: the operator is at the page
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=folder,
            env=environment,
        ) as process,
    ):
        try:
            addresses = []
            for line in process.stdout:
                addresses += re.findall(r"console: .* (http://\S+)", line)
                if len(addresses) == 2:
                    break
            assert len(addresses) == 2
            yield Played(process, addresses[0], addresses[1], folder, Path(runtime.name))
        finally:
            process.terminate()
            process.communicate(timeout=20.0)
