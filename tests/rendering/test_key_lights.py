"""Keys light up in the colours of the piano roll, and go out again; which hand reaches which is drawn."""

import mujoco
import numpy as np
import pytest

from humanoid_sim.rendering.appearance import keyboard_box
from humanoid_sim.rendering.drawing import KeyLights
from humanoid_sim.rendering.offscreen import make_camera
from humanoid_sim.rendering.piano_roll import draw_reach
from humanoid_sim.rendering.piano_sound import Stroke
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.piano import PIANOS
from humanoid_sim.simulation.model import build_model

GREEN, YELLOW, RED = (0.227, 0.616, 0.365), (0.949, 0.694, 0.204), (0.820, 0.286, 0.357)
WHITE, BLACK = (0.9, 0.9, 0.9), (0.1, 0.1, 0.1)


@pytest.fixture
def piano():
    return build_model(load_robot("lite_piano"))


def colour(model, name):
    geom = model.geom(name)
    assert int(geom.matid[0]) == -1
    return tuple(np.round(geom.rgba[:3].astype(float), 3).tolist())


def test_right_wrong_and_missing_keys(piano):
    goals = np.zeros((2, 88), dtype=np.bool_)
    goals[1, [3, 4]] = True
    lights = KeyLights(piano, goals)
    names = ("white_key_3", "black_key_4", "white_key_5")
    lights.show([], None)
    assert [colour(piano, name) for name in names] == [WHITE, BLACK, WHITE]
    lights.show([Stroke(0.0, 3, True), Stroke(0.0, 5, True)], 1)
    assert [colour(piano, name) for name in names] == [GREEN, YELLOW, RED]
    lights.show([Stroke(0.1, 5, False)], 9)  # the last frame is held
    assert [colour(piano, name) for name in names] == [GREEN, YELLOW, WHITE]
    lights.show([Stroke(0.2, 3, False), Stroke(0.2, 5, True)], None)
    assert [colour(piano, name) for name in names] == [WHITE, BLACK, GREEN]


def test_a_model_without_a_piano_stays_as_it_is():
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1' rgba='1 0 0 1'/></worldbody></mujoco>")
    KeyLights(model).show([Stroke(0.0, 3, True)])
    assert model.geom_rgba[0].tolist() == [1.0, 0.0, 0.0, 1.0]
    assert keyboard_box(model) is None


def test_the_keys_are_seen_from_above(piano):
    box = keyboard_box(piano)
    assert box is not None
    middle, half = box
    assert middle[1] == pytest.approx(0.0, abs=1e-6)
    assert half[1] == pytest.approx(0.5975, abs=1e-3)  # 52 keys of 22 mm and 51 gaps of 1 mm
    camera = make_camera(piano, None, 16 / 9)
    assert camera.elevation == -46.0
    assert np.abs(camera.lookat - middle).max() < 0.15


def test_keys_have_the_colours_of_the_hands_that_reach_them():
    image = draw_reach(PIANOS["dep20"].keys, ([0, 2], [2, 87]), "reach")
    # The lower half of the first, second and third white key, of the last one, and of middle C.
    scale = (1280 - 24) / 1.195
    places = {n: round(12 + (0.011 + n * 0.023) * scale) for n in (0, 1, 2, 51, 23)}
    row = 34 + round(0.13 * scale)
    assert {n: image.getpixel((x, row)) for n, x in places.items()} == {
        0: (76, 120, 168),
        1: (58, 157, 93),
        2: (255, 255, 255),
        51: (242, 177, 52),
        23: (255, 255, 255),
    }
