"""The site as a browser shows it, wide and on a phone: whole, without a word to any other server."""

import functools
import re
import shutil
import subprocess
import sys
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parent.parent.parent
SITE = ROOT / "build" / "site"
WIDTHS = (1280, 390)
"""Pixels: a computer's window, and a phone's."""


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *arguments):
        pass


@pytest.fixture(scope="module")
def site():
    """Builds the site; the address under which it is served."""
    for package in ("zensical", "mkdocstrings", "mermaidx"):
        pytest.importorskip(package, reason=f"{package} is not installed (extra docs)")
    built = subprocess.run([sys.executable, ROOT / "docs" / "build.py"], capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    assert "links to the outside, not followed:" in built.stdout
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=str(SITE)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("there is no chromium here (apt-get install chromium)")
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield started
        started.close()


def test_every_page_is_whole_at_any_width_and_loads_nothing_from_elsewhere(site, browser):
    problems = []
    tab = browser.new_page()
    tab.on("pageerror", lambda error: problems.append(f"{tab.url}: {error}"))
    tab.on("console", lambda said: problems.append(f"{tab.url}: {said.text}") if said.type == "error" else None)
    tab.on("request", lambda asked: asked.url.startswith((site, "data:", "blob:")) or problems.append(asked.url))
    pages = sorted(path.relative_to(SITE).as_posix() for path in SITE.rglob("*.html") if path.name != "404.html")
    assert len(pages) > 50
    for page in pages:
        tab.goto(f"{site}/{page}", wait_until="load")
        for width in WIDTHS:
            tab.set_viewport_size({"width": width, "height": 800})
            if tab.evaluate("document.documentElement.scrollWidth > window.innerWidth"):
                problems.append(f"{page}: is wider than a window of {width} pixels")
    tab.close()
    assert problems == []


def test_diagrams_are_drawn(site, browser):
    tab = browser.new_page()
    tab.goto(f"{site}/concepts.html")
    tab.wait_for_function("document.querySelectorAll('div.mermaid').length === 3")
    heights = tab.evaluate("[...document.querySelectorAll('div.mermaid')].map(drawn => drawn.offsetHeight)")
    tab.close()
    assert min(heights) > 200


def test_the_search_finds_pages(site, browser):
    tab = browser.new_page()
    tab.goto(f"{site}/index.html", wait_until="networkidle")
    tab.keyboard.press("Control+k")
    tab.get_by_role("combobox", name="Search").fill("guardian")
    tab.get_by_text(re.compile(r"^\d+ results$")).wait_for()
    tab.close()
