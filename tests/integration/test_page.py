"""Pages in a real Chromium, without a head, their 3D drawn in software: the console's, and that of a run."""

import os
import re
import shutil
import subprocess
import sys

import pytest

pytestmark = [pytest.mark.integration, pytest.mark.timeout(900)]

PATIENCE = 120_000
"""ms; a busy machine draws 3D slowly, and the page waits for it."""
CHROMIUM = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
OPEN = """(address) => new Promise((resolve) => {
    const socket = new WebSocket(address);
    socket.onopen = () => { socket.close(); resolve("open"); };
    socket.onerror = () => resolve("refused");
})"""
"""Whether the page that asks gets a websocket."""


@pytest.fixture
def address(tmp_path, runtime):
    """Of the page of a session that runs in real time."""
    command = [sys.executable, "-m", "humanoid_sim.play", "--manual", "--console", "--pace", "realtime"]
    nothing = ["--viewer", "none", "--html", "none", "--record", "none"]
    with subprocess.Popen(
        [*command, *nothing],
        stdin=subprocess.DEVNULL,  # no terminal: the operator is at the page
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "NO_COLOR": "1"},
    ) as process:
        try:
            said = ""
            for line in process.stdout:
                said += line
                found = re.search(r"console: .* (http://\S+)", said)
                if found:
                    break
            else:
                pytest.fail(said)
            yield found[1]
        finally:
            process.terminate()
            try:
                process.communicate(timeout=60.0)
            except subprocess.TimeoutExpired:
                process.kill()
                raise


@pytest.fixture
def browser():
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - make test collects this file without it

    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("there is no chromium here (apt-get install chromium)")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=CHROMIUM, timeout=PATIENCE)
        yield browser
        browser.close()


def opened(browser, address):
    page = browser.new_page(viewport={"width": 800, "height": 500})
    page.set_default_timeout(PATIENCE)
    page.goto(address)
    return page


def shown(mode):
    return f'#mode[data-mode="{mode}"]'


def press(page, word, mode):
    """Press a button until the mode is there: it is refused before a pose is reached, and clicks can come late."""
    from playwright.sync_api import TimeoutError as TookTooLong  # noqa: PLC0415 - as above

    for _ in range(30):
        page.get_by_role("button", name=word).click()
        try:
            page.wait_for_selector(shown(mode), timeout=10_000)
        except TookTooLong:
            continue
        return
    raise AssertionError(f"{word}: {page.inner_text('body')}")


def test_an_operator_clicks_through_the_modes_and_a_stranger_is_refused(address, browser):
    socket = address.replace("http", "ws", 1) + "console"
    errors = []
    page = opened(browser, "about:blank")
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(address)
    page.wait_for_selector("#cover", state="hidden")
    page.locator("canvas").first.wait_for()
    page.keyboard.press("Space")
    page.wait_for_selector(shown("DAMPING"))
    press(page, "LOAD_A", "STANDBY")
    press(page, "START_LOCOMOTION", "LOCOMOTION")  # once the pose is reached
    stranger = opened(browser, "data:text/html,stranger")
    assert stranger.evaluate(OPEN, socket) == "refused"
    assert page.evaluate(OPEN, socket) == "open"
    stranger.close()
    assert page.locator(shown("LOCOMOTION")).count() == 1
    page.click("#damp")
    page.wait_for_selector(shown("DAMPING"))
    assert errors == []


def picture_at(page, time):
    page.locator("input").first.fill(time)
    page.locator("input").first.press("Enter")
    page.wait_for_timeout(2000.0)  # the canvas does not tell when it has drawn
    return page.locator("canvas").last.screenshot()


def test_the_page_of_a_run_replays_it_offline(browser, tmp_path, runtime):
    run = ["--script", "damp; load_a; hold 3", "--record", "none", "--html", "run.html", "--pace", "fast"]
    subprocess.run([sys.executable, "-m", "humanoid_sim.play", *run], cwd=tmp_path, check=True, capture_output=True)
    page = browser.new_context(offline=True, viewport={"width": 400, "height": 300}).new_page()
    page.set_default_timeout(PATIENCE)
    errors, asked = [], []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto((tmp_path / "run.html").as_uri())
    page.wait_for_selector('[role="slider"]', state="attached")
    early, late, again = (picture_at(page, time) for time in ("0.2", "2.5", "0.2"))
    for _ in range(30):  # until everything is drawn, however slowly: then a picture depends on its time alone
        if early == again != late:
            break
        early, late, again = again, picture_at(page, "2.5"), picture_at(page, "0.2")
    assert early == again != late, "the picture does not follow the time"
    picture_at(page, "2.5")
    page.wait_for_function("document.getElementById('caption').textContent.startsWith('STANDBY 2.')")
    assert errors == []
    assert [address for address in asked if not address.startswith(("file:", "blob:", "data:"))] == []
