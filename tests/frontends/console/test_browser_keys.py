"""A piano's keys on the page, in a real Chromium, played on an emulated MIDI keyboard."""

import pytest
from lost_keyboard import piano_options, plugged_in
from page_buttons import in_mode, press
from play_fixtures import quick_robot

pytestmark = pytest.mark.slow


def lit(page, key, state):
    page.wait_for_selector(f'#keys-row [data-key="{key}"][data-state="{state}"]', timeout=20_000)


def test_keys_are_lit_as_they_are_pressed_beside_what_the_song_asks_for(browser, start_play, tmp_path):
    with plugged_in(tmp_path) as keyboard:
        options = (*piano_options(tmp_path)[:-1], keyboard.path, "--robot", quick_robot(tmp_path))
        played = start_play(*options)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        errors = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.route("**/viser/", lambda route: route.fulfill(body=""))
        page.goto(played.control)
        page.wait_for_selector("#cover", state="hidden")
        page.wait_for_selector("#keys-text >> text=no song is played")
        assert page.locator("#keys-row [data-key]").count() == 88
        assert page.locator("#keys-row > div").count() == 52
        keyboard.press(60)
        lit(page, 39, "down")
        keyboard.release(60)
        lit(page, 39, "")
        page.click("#damp")
        in_mode(page, "DAMPING")
        press(page, "load_a", "STANDBY")
        press(page, "start_locomotion", "LOCOMOTION")
        lit(page, 43, "wanted")
        keyboard.press(60, 71)
        lit(page, 39, "hit")
        lit(page, 50, "wrong")
        row = page.locator("#keys-row").bounding_box()
        first, last = (page.locator(f'[data-key="{key}"]').bounding_box() for key in (0, 87))
        assert first["x"] == pytest.approx(row["x"], abs=2.0)
        assert last["x"] + last["width"] == pytest.approx(row["x"] + row["width"], abs=2.0)
        keyboard.unplug()
        in_mode(page, "DAMPING")
        page.wait_for_selector("#keys-text >> text=which keys are down is not known")
        assert page.locator('#keys-row [data-state="hit"], #keys-row [data-state="wrong"]').count() == 0
        assert errors == []
        page.close()
