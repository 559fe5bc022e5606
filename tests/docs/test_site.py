"""The site as a browser shows it, wide and on a phone: whole, without a word to any other server."""

import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parent.parent.parent
SITE = ROOT / "build" / "site"
WIDTHS = (1280, 390)
"""Pixels: a computer's window, and a phone's."""


@pytest.fixture(scope="module")
def site():
    """Builds the site and serves it; the address."""
    for package in ("zensical", "mkdocstrings", "mermaidx"):
        pytest.importorskip(package, reason=f"{package} is not installed (extra docs)")
    # A shell's background job ignores SIGINT, and so does what it starts.
    command = ["env", "--default-signal=INT", sys.executable, ROOT / "docs" / "build.py", "--serve"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        try:
            said = []
            for line in server.stdout:
                said.append(line)
                if found := re.fullmatch(r"serving on (http://127\.0\.0\.1:\d+)/ until Ctrl-C\n", line):
                    break
            else:
                raise AssertionError("".join(said))
            assert "links to the outside, not followed:\n" in said
            yield found[1]
        finally:
            server.send_signal(signal.SIGINT)
    assert server.returncode == 0


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


def found(tab, words):
    """The first addresses that the search of a page finds."""
    field = tab.get_by_role("combobox", name="Search")
    while not field.is_visible():  # on a busy machine a page hears keys late
        tab.keyboard.press("Control+k")
        tab.wait_for_timeout(1000)
    field.fill(words)
    tab.get_by_text(re.compile(r"^\d+ results$")).wait_for()
    return [result.get_attribute("href") for result in tab.get_by_role("option").all()]


@pytest.mark.parametrize("page", ["index.html", "guides/researcher.html"])
def test_the_search_shows_guides_first_served_or_opened_as_a_file(site, browser, page):
    for address in (site, SITE.as_uri()):
        tab = browser.new_page()
        tab.goto(f"{address}/{page}", wait_until="networkidle")
        assert "front-ends.html" in found(tab, "front end")[0]
        tab.reload(wait_until="networkidle")
        pages = [href.split("?")[0] for href in found(tab, "policy")]
        assert len(pages) > 5
        assert not [href for href in pages if "contributing" in href or "reference/" in href]
        tab.reload(wait_until="networkidle")
        pages = found(tab, "damp")  # in no heading; texts of the reference are short
        assert not [href for href in pages[:5] if "reference/" in href]
        tab.close()


@pytest.mark.parametrize("page", ["index.html", "checklist.html"])
def test_long_commands_wrap_on_a_phone(site, browser, page):
    tab = browser.new_page(viewport={"width": 390, "height": 844})
    tab.goto(f"{site}/{page}")
    blocks = tab.locator(":is(.language-text, .language-sh) pre > code").all()
    assert len(blocks) > 5
    for block in blocks:
        assert block.evaluate("code => code.scrollWidth <= code.clientWidth"), block.inner_text()
    tab.close()
