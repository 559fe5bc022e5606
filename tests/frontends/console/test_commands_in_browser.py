"""Sliders and velocity in a real Chromium, and what becomes of them when their page is gone."""

import os
import re
import shutil
import signal
import time
from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest
from models import linear_model, saved
from page_buttons import press

from humanoid_sim.assets import asset_path
from humanoid_sim.client import Feed, Intake, find_session
from humanoid_sim.messages import Mode

pytestmark = pytest.mark.slow
PATIENCE = 30.0
"""s, on a busy machine."""
HIDE = """() => {
    Object.defineProperty(document, "visibilityState", { value: "hidden", configurable: true });
    document.dispatchEvent(new Event("visibilitychange"));
}"""
"""Playwright keeps all pages in sight."""


class Session:
    """What the session itself says, beside all pages."""

    def __init__(self, feed):
        self._feed = feed

    def tick(self):
        sample = self._feed.latest()
        assert sample is not None
        return self._feed.decode(sample)

    def position(self, joint):
        return float(self.tick()["joint_position"][self._feed.joint_names.index(joint)])

    @property
    def is_passive(self):
        tick = self.tick()
        return not tick["command_stiffness"].any() and not tick["command_effort"].any()

    def until(self, is_it, what):
        deadline = time.monotonic() + PATIENCE
        while not is_it():
            assert time.monotonic() < deadline, what
            time.sleep(0.02)


@contextmanager
def session_of(played, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(played.runtime))
    with Feed(find_session(played.process.pid)) as feed:
        yield Session(feed)


@pytest.fixture(scope="module")
def walked(start_play, tmp_path_factory):
    """Of the Lite's legs, with a policy that takes a velocity command, and does nothing about it."""
    folder = tmp_path_factory.mktemp("legs")
    saved(folder / "legs.onnx", linear_model({}, matrix=np.zeros((3 + 3 + 3 + 3 * 14 + 2, 14))))
    shutil.copy(asset_path("policies", "lite_biped_velocity.contract.yaml"), folder / "legs.contract.yaml")
    return start_play("--policy", str(folder / "legs.onnx"), "--robot", "lite_biped")


@pytest.fixture
def another_browser(start_browser):
    """For a test that ends it."""
    browser = start_browser()
    yield browser
    browser.close()


@pytest.fixture
def session(played, monkeypatch):
    with session_of(played, monkeypatch) as session:
        yield session


def opened(browser, address):
    """A page without the 3D view: drawing that in software takes a whole core."""
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.set_default_timeout(1000.0 * PATIENCE)
    page.route("**/viser/", lambda route: route.abort())
    page.goto(address)
    page.wait_for_selector("#cover", state="hidden")
    return page


def to_remote(page):
    if page.get_attribute("#mode", "data-mode") == "REMOTE":
        return
    page.keyboard.press("Space")
    page.wait_for_selector('#mode[data-mode="DAMPING"]')
    press(page, "load_a", "STANDBY")
    press(page, "start_remote", "REMOTE")


def take(page, session, joint="left_elbow_pitch"):
    """Until its gains are in. A busy machine may let go meanwhile, which is not a failure of these tests."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if not owns(page):
            page.select_option("#sliders-joint", joint)
            page.click("#sliders-take")
        if session.tick()["command_stiffness"].max() == 50.0:
            return
        time.sleep(0.2)
    raise AssertionError(page.inner_text("#sliders-text"))


def owns(page):
    return bool(page.evaluate("turn !== null && turn.page === page"))


def moved(page, session, is_it, **goals):
    """Type goals into the number fields until the session shows it; take over again where a busy machine let go."""
    deadline = time.monotonic() + PATIENCE
    while not is_it():
        assert time.monotonic() < deadline, goals
        if not owns(page):
            take(page, session)
        for field, value in goals.items():
            if page.evaluate(f"goals !== null && goals.{field} !== {value}") and owns(page):
                page.fill(f"#sliders-rows-{field}-number", str(value), force=True)
                page.keyboard.press("Enter")
        time.sleep(0.05)


def slide(page, slider, value):
    page.locator(f"#{slider}").evaluate(
        "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input', { bubbles: true })); }",
        value,
    )


def test_a_joint_is_moved_by_sliders(browser, played, session):
    page = opened(browser, played.control)
    assert not page.is_visible("#sliders")
    to_remote(page)
    session.until(lambda: session.is_passive, "passive before anybody moves anything")
    take(page, session)
    assert page.evaluate("goals.stiffness") == 0.0
    others = session.position("right_elbow_pitch")
    elbow = partial(session.position, "left_elbow_pitch")
    moved(page, session, lambda: abs(elbow() + 1.0) < 0.1, stiffness=60, damping=2, position=-1)
    assert session.position("right_elbow_pitch") == pytest.approx(others, abs=0.2)
    moved(page, session, lambda: elbow() > -0.1, stiffness=60, damping=2, position=0)
    fields = []
    while not fields:  # beyond the elbow's limit
        if not owns(page):
            take(page, session)
        page.evaluate("sliderRows.position.field.value = 99")
        page.evaluate("sliderRows.position.field.dispatchEvent(new Event('change'))")
        fields = page.evaluate("goals === null ? [] : [goals.position]")
    assert fields == [0]
    slide(page, "sliders-rows-position", -0.5)
    assert page.evaluate("goals === null ? -0.5 : goals.position") == -0.5
    if owns(page):
        page.locator("#sliders-snap").dispatch_event("click")
    session.until(lambda: session.tick()["command_stiffness"][3] == 0.0, "its gains are 0")
    if owns(page):
        page.locator("#sliders-let-go").dispatch_event("click")
    session.until(lambda: session.is_passive, "passive")
    page.wait_for_selector("text=sliders let go: ")
    page.close()


def test_the_space_bar_damps_in_a_slider_and_in_a_number_field(browser, played, session):
    page = opened(browser, played.control)
    for focus in ("position", "position-number"):
        to_remote(page)
        take(page, session)
        page.evaluate(f"get('sliders-own').hidden = false; get('sliders-rows-{focus}').focus()")
        page.keyboard.press("Space")
        page.wait_for_selector('#mode[data-mode="DAMPING"]')
        session.until(lambda: session.is_passive, "damped")
        page.wait_for_selector("#sliders", state="hidden")
    page.close()


def test_a_second_page_is_shown_who_moves_what_and_cannot(browser, played, session):
    page, second, watching = (opened(browser, address) for address in (played.control,) * 2 + (played.read_only,))
    to_remote(page)
    take(page, session)
    number = page.evaluate("page")
    for other in (second, watching):
        other.wait_for_selector(f"text=left_elbow_pitch: moved by page {number}")
        assert not other.is_visible("#sliders-own")
    take(page, session)
    second.click("#sliders-take")
    second.wait_for_selector(f"text=sliders: page {number} moves left_elbow_pitch")
    assert not watching.is_visible("#sliders-take")
    second.close()  # who does not command changes nothing by leaving
    watching.close()
    assert owns(page) or "held up" in page.inner_text("#sliders-text")
    page.close()
    session.until(lambda: session.is_passive, "passive: its page has closed")


def test_a_page_that_is_hidden_or_frozen_moves_nothing(browser, played, session):
    page, second = opened(browser, played.control), opened(browser, played.control)
    to_remote(page)
    take(page, session)
    page.evaluate(HIDE)
    session.until(lambda: session.is_passive, "hidden: passive")
    second.wait_for_selector(f"text=sliders let go: page {page.evaluate('page')} let go")
    page.evaluate("delete document.visibilityState")
    take(page, session)
    number = page.evaluate("page")
    # Chromium freezes no page that Playwright looks at; one that is busy runs no timers either.
    page.evaluate("setTimeout(() => { const end = performance.now() + 3000; while (performance.now() < end); }, 0)")
    session.until(lambda: session.is_passive, "frozen: passive")
    second.wait_for_selector(f"text=sliders let go: page {number} shows what is older than 1 s")
    page.wait_for_selector("#sliders-own", state="hidden")
    assert session.is_passive
    page.close()
    second.close()


def processes(browser, kind):
    told = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")
    return [process["id"] for process in told["processInfo"] if process["type"] == kind]


def test_a_page_whose_process_stands_still_or_is_killed_moves_nothing(browser, another_browser, played, session):
    watching = opened(browser, played.read_only)
    page = opened(another_browser, played.control)
    to_remote(page)
    take(page, session)
    number, stopped = page.evaluate("page"), processes(another_browser, "renderer")
    assert stopped
    for process in stopped:
        os.kill(process, signal.SIGSTOP)  # its socket stays open: that is the browser's other process
    try:
        session.until(lambda: session.is_passive, "stopped: passive")
        watching.wait_for_selector(f"text=sliders let go: page {number} was not heard for 0.5 s")
    finally:
        for process in stopped:
            os.kill(process, signal.SIGCONT)
    page.wait_for_selector("#sliders-own", state="hidden")
    assert session.is_passive
    take(page, session)
    (process,) = processes(another_browser, "browser")
    os.kill(process, signal.SIGKILL)
    session.until(lambda: session.is_passive, "killed: passive")
    watching.wait_for_selector(f"text=sliders let go: page {number} ")
    assert watching.get_attribute("#mode", "data-mode") == "REMOTE"
    watching.close()


def test_a_console_that_stands_still_or_is_killed_moves_nothing(browser, played, session):
    """The last of this session's console."""
    page = opened(browser, played.control)
    to_remote(page)
    take(page, session)
    (console,) = played.children
    os.kill(console, signal.SIGSTOP)
    try:
        session.until(lambda: session.is_passive, "stopped: passive")
        time.sleep(0.6)
    finally:
        os.kill(console, signal.SIGCONT)
    page.wait_for_selector("text=sliders let go: ")
    assert session.is_passive  # nothing begins again by itself
    take(page, session)
    os.kill(console, signal.SIGKILL)
    session.until(lambda: session.is_passive, "killed: passive")
    page.wait_for_selector("text=NO CONNECTION")
    assert session.tick()["mode"] == int(Mode.REMOTE)
    page.close()


def steered(page, act, text):
    """Do it until the session's command reads so: on a busy machine one that is a quarter of a second old has ended."""
    deadline = time.monotonic() + PATIENCE
    while not re.search(text, page.inner_text("#velocity-text")):
        assert time.monotonic() < deadline, page.inner_text("#velocity-text")
        act()
        time.sleep(0.3)


def test_sliders_and_keys_command_a_velocity(browser, walked, monkeypatch):
    page = opened(browser, walked.control)
    assert not page.is_visible("#sliders")
    page.keyboard.press("Space")
    page.wait_for_selector('#mode[data-mode="DAMPING"]')
    page.keyboard.press("w")
    page.wait_for_selector("text=velocity refused: requires LOCOMOTION, mode is DAMPING")
    press(page, "load_a", "STANDBY")
    press(page, "start_locomotion", "LOCOMOTION")
    ours = r" by console \(\d+\), this page$"
    page.wait_for_selector("text=forward 0.00 m/s, left 0.00 m/s, turn left 0.00 rad/s")
    steered(
        page, lambda: page.keyboard.press("w"), rf"^forward 0\.\d0 m/s, left 0\.00 m/s, turn left 0\.00 rad/s{ours}"
    )
    steered(page, lambda: slide(page, "velocity-rows-wz", 0.5), rf", turn left 0\.50 rad/s{ours}")
    steered(page, lambda: page.click("#velocity-stop"), r"^forward 0\.00 m/s, left 0\.00 m/s, turn left 0\.00 rad/s")
    with session_of(walked, monkeypatch), Intake(find_session(walked.process.pid), "gamepad") as other:
        page.evaluate("wished = []; wish = ((send) => (what) => { wished.push(what); send(what); })(wish); 0")
        stick = partial(other.velocity, 0.2, 0.0, 0.0, deliberate=True)
        steered(page, stick, r"^forward 0\.20 m/s, .* by gamepad")
        for focus, key in (("vx-number", "0"), ("vx-number", "ArrowUp"), ("vx", "ArrowUp")):
            page.focus(f"#velocity-rows-{focus}")
            page.keyboard.press(key)
        pressed = "wished.filter((what) => what.do === 'press').map((what) => what.key).join()"
        assert page.evaluate(pressed) == ""  # those keys are the field's and the slider's own
        page.keyboard.press("w")
        page.focus("#velocity-stop")
        page.keyboard.press("ArrowUp")
        assert page.evaluate(pressed) == "w,up"
    page.evaluate(HIDE)
    assert page.evaluate("wished.at(-1).do") == "let_go"
    page.wait_for_selector("text=/^forward 0.00 m.s, left 0.00 m.s, turn left 0.00 rad.s/")
    page.close()


def test_a_slow_page_steers_on_and_one_that_is_frozen_stops_and_says_so(browser, walked, monkeypatch):
    """Slow as where software draws 3D: its thread runs for a moment between two frames of 0.4 s."""
    page = opened(browser, walked.control)
    page.keyboard.press("Space")
    page.wait_for_selector('#mode[data-mode="DAMPING"]')
    press(page, "load_a", "STANDBY")
    press(page, "start_locomotion", "LOCOMOTION")
    with session_of(walked, monkeypatch) as session:

        def speed():
            return next(float(one["value"][0]) for one in session.tick()["extern"] if one["name"] == "velocity_command")

        steered(page, lambda: page.keyboard.press("w"), r"^forward 0\.\d0 m/s")
        page.evaluate("busy = (ms) => { const end = performance.now() + ms; while (performance.now() < end); }; 0")
        page.evaluate("slow = setInterval(busy, 450, 400); 0")
        held, deadline = 0, time.monotonic() + PATIENCE
        while held < 40 and time.monotonic() < deadline:  # for 2 s on end, which a busy machine may interrupt
            held = held + 1 if speed() > 0.0 else 0
            if not held:
                page.keyboard.press("w")
            time.sleep(0.05)
        assert held == 40
        page.evaluate("clearInterval(slow); setTimeout(busy, 0, 4000)")
        time.sleep(1.5)
        assert speed() == 0.0
    page.wait_for_selector("#stop >> text=velocity let go: ")
    for name in ("#stop", "#events li >> nth=4"):
        box = page.locator(name).bounding_box()
        assert 0.0 <= box["y"] <= 800.0 - box["height"]
    page.close()
