"""What the page shows beside the state, in a real Chromium. The 3D view is left out where it is not looked at."""

import io
import re
from contextlib import contextmanager

import numpy as np
import pytest
from page_buttons import in_mode, press
from PIL import Image
from waiting import until

pytestmark = pytest.mark.slow
ELBOW = "position and command: left_elbow_pitch"
PHONE = {"width": 390, "height": 844}
DRAWN = """(name) => {
    const line = document.querySelector(`[data-plot="${name}"] .scatterlayer .js-line`);
    return line !== null && line.getBBox().width > 100 && line.style.stroke === "rgb(74, 163, 224)";
}"""
"""Whether a plot's first line is there, in its colour."""


@contextmanager
def opened(browser, address, size=None):
    """A page of a browser or of one of its contexts, without its 3D view, which software draws slowly."""
    page = browser.new_page()
    page.set_viewport_size(size or {"width": 1280, "height": 800})
    page.errors = []
    page.on("pageerror", lambda error: page.errors.append(str(error)))
    page.route("**/viser/", lambda route: route.fulfill(body=""))
    page.goto(address)
    page.wait_for_selector("#cover", state="hidden")
    yield page
    assert page.errors == []
    page.close()


def test_plots_are_drawn_go_on_after_a_reconnection_and_are_kept_by_the_browser(browser, played):
    with opened(browser, played.read_only) as page:
        page.select_option("#add-plot", ELBOW)
        page.select_option("#add-plot", "loop: tick time")
        assert page.locator("#charts figure").count() == 2
        figure = page.locator(f'[data-plot="{ELBOW}"]')
        assert "left_elbow_pitch: position and command, rad" in figure.inner_text()
        page.wait_for_function(DRAWN, arg=ELBOW)
        page.evaluate("socket.close()")
        page.wait_for_selector("#cover", state="visible")
        page.wait_for_selector("#cover", state="hidden")
        assert page.locator("#charts figure").count() == 2
        page.wait_for_function(DRAWN, arg=ELBOW)
        page.reload()
        page.wait_for_function(DRAWN, arg=ELBOW)
        page.click(f'[data-plot="{ELBOW}"] button')
        assert page.locator("#charts figure").count() == 1


def test_a_plot_of_several_signals_is_frozen_and_looked_back_in(browser, played):
    with opened(browser, played.control) as page:
        page.set_default_timeout(120_000)  # the robot's clock is slow on a machine that has other things to do
        page.select_option("#add-plot", ELBOW)
        page.select_option(f'[data-plot="{ELBOW}"] select', "effort: left_elbow_pitch")
        both = f"{ELBOW} + effort: left_elbow_pitch"
        page.wait_for_function(DRAWN, arg=both)
        assert page.locator("#charts figure").count() == 1
        names = page.locator("#charts .legendtext").all_text_contents()
        assert names == ["position", "command", "effort"]
        assert page.locator("#charts .ytitle, #charts .y2title").all_text_contents() == ["rad", "N·m"]
        page.select_option("#plots-span", "5")
        page.wait_for_function("() => Number(document.getElementById('plots-time').max) > 4")
        page.click("#plots-pause")
        shown = page.inner_text("#plots-shown")
        path = page.get_attribute("#charts .js-line >> nth=0", "d")
        page.wait_for_timeout(1000)
        assert page.inner_text("#plots-shown") == shown
        page.locator("#plots-time").fill("2")
        page.wait_for_selector("#plots-shown:text-is('frozen: 0.0 to 2.0 s')")
        page.wait_for_function(
            "(path) => document.querySelector('#charts .js-line').getAttribute('d') !== path", arg=path
        )
        page.evaluate("socket.close()")  # all rows come again, and what is looked at stays
        page.wait_for_selector("#cover", state="visible")
        page.wait_for_selector("#cover", state="hidden")
        page.wait_for_function(DRAWN, arg=both)
        assert page.inner_text("#plots-shown") == "frozen: 0.0 to 2.0 s"
        page.click("#plots-pause")
        page.wait_for_function(
            "() => /^[0-9.]+ to ([4-9]|[0-9]{2,})/.test(document.getElementById('plots-shown').innerText)"
        )


def test_the_layout_of_plots_is_kept_for_each_robot_whatever_the_sessions_port(browser, played, start_play):
    others = [start_play(), start_play("--robot", "lite_biped")]
    context = browser.new_context()
    with opened(context, played.control) as page:
        page.select_option("#add-plot", ELBOW)
    with opened(context, others[1].control) as page:  # and what floats is measured
        assert page.locator("#charts figure").count() == 0
        page.select_option("#add-plot", "base velocity: forward")
        page.wait_for_function("() => /^base -?0.00 m.s forward/.test(document.getElementById('vital-base').innerText)")
    with opened(context, others[0].control) as page:
        page.wait_for_function(DRAWN, arg=ELBOW)
        assert page.locator("#charts figure").count() == 1
        page.wait_for_selector("#recording.on >> text=recording run.mcap")
        assert page.get_attribute("#recording", "title") == str(others[0].folder / "run.mcap")
        page.wait_for_function("() => /^link [0-9]+ ms$/.test(document.getElementById('vital-link').innerText)")
        assert re.fullmatch(r"loop \d+\.\d of 200 Hz", page.inner_text("#vital-loop"))
    context.close()


def test_a_page_that_reconnects_shows_the_present_and_each_event_once(browser, played):
    with opened(browser, played.control) as page, opened(browser, played.control) as other:
        page.click("#damp")
        in_mode(page, "DAMPING")
        page.context.set_offline(True)
        page.evaluate("socket.close()")
        page.wait_for_selector("#cover", state="visible")
        press(other, "load_b", "STANDBY")
        other.click("#mark")
        other.wait_for_selector("#events >> text=moment")
        page.context.set_offline(False)
        page.wait_for_selector("#cover", state="hidden")
        in_mode(page, "STANDBY")
        page.wait_for_selector("#events >> text=moment")
        assert page.locator("#events li").all_inner_texts() == other.locator("#events li").all_inner_texts()
        other.click("#damp")
        in_mode(page, "DAMPING")


def test_reactivate_is_confirmed_and_a_double_click_is_not(browser, played):
    with opened(browser, played.control) as page:
        page.click("#damp")
        in_mode(page, "DAMPING")
        button = page.locator('#apart [data-ask="reactivate"]:not(.refused)')
        button.dblclick()
        page.wait_for_selector("#apart >> text=press again to confirm")
        in_mode(page, "DAMPING")
        page.wait_for_timeout(600)
        button.click()
        in_mode(page, "ZERO_TORQUE")


def test_figures_are_switched_for_all_pages(browser, played):
    with opened(browser, played.control) as page, opened(browser, played.read_only) as watching:
        box = '#figures [data-figure="command"] input'
        watching.wait_for_selector(box)
        watching.click(box)
        watching.wait_for_selector("#answer.refused")
        assert not watching.is_checked(box)
        page.click(box)
        for one in (page, watching):
            one.wait_for_selector('[data-figure="command"][data-on="true"]')
            assert one.is_checked(box)
        page.click(box)
        watching.wait_for_selector('[data-figure="command"][data-on="false"]')


def clock(page):
    return float(page.inner_text("#clock").removesuffix(" s"))


def test_a_simulation_is_paused_paced_pushed_and_reset_on_the_page(browser, played):
    with opened(browser, played.control) as page, opened(browser, played.read_only) as watching:
        assert not watching.is_visible("#simulation")
        page.click("#damp")
        in_mode(page, "DAMPING")
        page.click("#simulation-pause")
        for one in (page, watching):
            one.wait_for_selector("#pace:text-is('PAUSED')")
        stood = clock(page)
        page.wait_for_timeout(1500)  # longer than a session may stand still, and the page is not covered
        assert (clock(page), page.is_visible("#cover")) == (stood, False)
        page.click('#intents [data-ask="load_a"]')
        page.wait_for_selector("#answer.refused >> text=the robot's time is paused")
        page.click("#simulation-pause:text-is('Resume')")
        page.wait_for_function("(stood) => parseFloat(document.getElementById('clock').textContent) > stood", arg=stood)
        in_mode(page, "DAMPING")
        page.select_option("#simulation-speed", "0.5")
        watching.wait_for_selector("#pace:text-is('0.5 × real time')")
        page.select_option("#simulation [name=body]", index=2)
        page.select_option("#simulation [name=direction]", "−y")
        page.click("#simulation-push button")
        page.wait_for_selector("#events >> text=by 0,-0.5 m/s; requested by console")
        page.click("#simulation-reset")
        in_mode(watching, "ZERO_TORQUE")
        until((played.folder / "run-2.mcap").exists)
        watching.evaluate("ask('pause')")
        watching.wait_for_selector("#answer.refused >> text=this address is for watching only")


def test_a_phone_shows_everything_in_its_width_and_damp_always(browser, played):
    with opened(browser, played.control, PHONE) as page:
        page.select_option("#add-plot", ELBOW)
        page.wait_for_selector("#joints tbody tr:nth-child(14)")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        for name in ("#joints", "#charts figure", "#intents", "#mark"):
            box = page.locator(name).first.bounding_box()
            assert box["x"] >= 0.0, name
            assert box["x"] + box["width"] <= 390.0, name
        order = [
            page.locator(name).bounding_box()["y"] for name in ("#mode", "#scene", "#intents", "#safety", "#events")
        ]
        assert order == sorted(order)
        scene = page.locator("#scene").bounding_box()
        assert scene["y"] + scene["height"] < 844.0  # the robot is seen without scrolling
        for name in ("button", "select", "#figures label"):
            for box in (one.bounding_box() for one in page.locator(f"{name} >> visible=true").all()):
                assert box["height"] >= 44.0, name
        assert not re.search("space bar|key", page.inner_text("main"))
        for place in ("0", "document.documentElement.scrollHeight"):
            page.evaluate(f"window.scrollTo(0, {place})")
            box = page.locator("#damp").bounding_box()
            assert 0.0 <= box["y"] <= 100.0
        page.click("#damp")
        in_mode(page, "DAMPING")


def orange(page):
    """Pixels of the view that are, as the commanded pose is, and some of the robot itself."""
    picture = Image.open(io.BytesIO(page.locator("#scene").screenshot())).convert("RGB")
    red, _, blue = np.moveaxis(np.asarray(picture, dtype=int), -1, 0)
    return int((red - blue > 40).sum())


def test_the_commanded_pose_is_seen_over_the_robot(browser, played):
    page = browser.new_page(viewport={"width": 900, "height": 720})
    page.set_default_timeout(120_000)
    page.goto(played.control)
    page.wait_for_selector("#cover", state="hidden")
    page.evaluate("ask('damp')")
    in_mode(page, "DAMPING")
    press(page, "load_a", "STANDBY")
    page.wait_for_selector('[data-ask="start_locomotion"]:not(.refused)')
    counts = [0, 1]
    until(lambda: counts.append(orange(page)) or counts[-1] == counts[-2] > 20)  # the robot is there, and stands still
    page.evaluate("tell({ show: 'command', on: true })")
    until(lambda: orange(page) > counts[-1] + 300)
    page.evaluate("tell({ show: 'command', on: false })")
    until(lambda: orange(page) < counts[-1] + 100)
    page.evaluate("ask('damp')")
    page.wait_for_selector('#mode[data-mode="DAMPING"]')
    page.close()


def test_on_hardware_motors_and_buses_are_listed(browser, start_play):
    """Emulated motors: they warm up from 25 °C, and answer."""
    played = start_play("--hardware", "virtual:console")
    with opened(browser, played.control) as page:
        page.wait_for_selector("#motors tbody tr:nth-child(14)")
        page.wait_for_function(
            "() => /virtual:console [1-9][0-9]* %/.test(document.getElementById('buses').textContent)"
        )
        cells = page.locator("#motors tbody tr").first.locator("td").all_inner_texts()
        assert cells[0] == "left_shoulder_pitch"
        assert 10.0 < float(cells[1]) < 60.0
        assert float(cells[2]) < 10_000.0
        page.select_option("#add-plot", "bus load: virtual:console")
        page.wait_for_function(DRAWN, arg="bus load: virtual:console")
        for part in ("#simulation", "#pace", '[data-figure="contacts"]', '[data-figure="follow"]'):
            assert not page.is_visible(part), part
        for word in ("pause", "speed 2", "push 1,0", "reset"):
            page.evaluate("(word) => ask(word)", word)
            page.wait_for_selector(f"#answer.refused >> text={word.split()[0].upper()} refused: it is for a simulation")
