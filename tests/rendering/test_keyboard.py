from humanoid_sim.rendering.piano_roll import draw_reach
from humanoid_sim.robots.piano import PIANOS


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
