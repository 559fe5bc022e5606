"""The page in a real Chromium, without a head, its 3D drawn in software."""

import os
import signal

import pytest
from page_buttons import in_mode, press

pytestmark = pytest.mark.slow


@pytest.fixture
def page(browser, played):
    page = browser.new_page(viewport={"width": 1000, "height": 700})
    page.errors = []
    page.on("pageerror", lambda error: page.errors.append(str(error)))
    page.goto(played.control)
    page.wait_for_selector("#cover", state="hidden")
    yield page
    page.close()


def test_an_operator_clicks_through_the_modes(page, browser, played):
    watching = browser.new_page(viewport={"width": 390, "height": 800})  # a phone
    watching.route("**/viser/", lambda route: route.fulfill(body=""))  # two views are drawn too slowly in software
    watching.goto(played.read_only)
    page.keyboard.press("Space")
    in_mode(page, "DAMPING")
    refused = page.locator('#intents [data-ask="start_remote"]')
    assert "refused" in refused.get_attribute("class")
    assert "requires finished STANDBY, mode is DAMPING" in refused.inner_text()
    refused.click()
    page.wait_for_selector("#answer.refused")
    assert "START_REMOTE refused" in page.inner_text("#answer")
    press(page, "load_a", "STANDBY")
    page.wait_for_selector('[data-ask="start_locomotion"]:not(.refused)', timeout=20_000)
    assert page.inner_text("#standby-text") == "pose reached"
    press(page, "start_locomotion", "LOCOMOTION")
    in_mode(watching, "LOCOMOTION")
    times = page.eval_on_selector_all("#events li", "lines => lines.map(line => Number(line.dataset.time))")
    assert len(times) > 3
    assert times == sorted(times, reverse=True)
    assert not watching.locator("#damp, #mark, #intents button").locator("visible=true").count()
    watching.keyboard.press("Space")
    watching.wait_for_selector("#answer.refused")
    assert watching.inner_text("#answer") == "this address is for watching only"
    page.click("#mark")
    assert page.inner_text("#mark-answer") in ("marking …", "marked")
    page.wait_for_selector("#mark-answer:text-is('marked')")
    watching.wait_for_selector("text=moment 1")
    in_mode(page, "LOCOMOTION")
    page.click("#damp")
    in_mode(page, "DAMPING")
    watching.close()
    assert page.errors == []


def test_the_space_bar_damps_wherever_the_focus_is(page):
    page.keyboard.press("Space")
    in_mode(page, "DAMPING")
    view = page.frame_locator("#view")
    view.locator("canvas").first.wait_for(timeout=30_000)
    for focus in ("quit", "view"):
        press(page, "load_a", "STANDBY")
        if focus == "view":
            box = page.locator("#view").bounding_box()
            page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            assert page.evaluate("document.activeElement.id") == "view"
        else:
            page.locator('#intents [data-ask="quit"]').focus()
        page.keyboard.press("Space")
        in_mode(page, "DAMPING")


def test_another_origin_reaches_neither_page_nor_socket(page, browser, played):
    stranger = browser.new_page()
    stranger.goto("data:text/html,stranger")
    opened = stranger.evaluate(
        """(address) => new Promise((resolve) => {
            const socket = new WebSocket(address);
            socket.onopen = () => resolve("open");
            socket.onerror = () => resolve("refused");
        })""",
        played.control.replace("http", "ws", 1) + "console",
    )
    assert opened == "refused"
    stranger.close()


def test_what_is_not_the_present_is_covered(page, played):
    """A console that stands still, and one that is gone."""
    (console,) = played.children
    os.kill(console, signal.SIGSTOP)
    try:
        page.wait_for_selector("#cover", state="visible")
        assert page.inner_text("#cover-title") == "NO CONNECTION"
        cover = page.locator("#cover").bounding_box()
        assert (cover["width"], cover["height"]) == (1000, 700)
    finally:
        os.kill(console, signal.SIGCONT)
    page.wait_for_selector("#cover", state="hidden")
    os.kill(played.process.pid, signal.SIGSTOP)
    try:
        page.wait_for_selector("#cover", state="visible")
        page.wait_for_selector("text=THE SESSION STANDS STILL")
    finally:
        os.kill(played.process.pid, signal.SIGCONT)
    page.wait_for_selector("#cover", state="hidden")
    os.kill(console, signal.SIGKILL)
    page.wait_for_selector("text=NO CONNECTION")
    assert played.process.poll() is None
