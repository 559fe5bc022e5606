import numpy as np

from humanoid_sim.messages import Mode
from humanoid_sim.rendering.caption import Caption
from humanoid_sim.rendering.video import draw_caption


def test_the_caption_says_who_is_in_control():
    blank = np.full((480, 640, 3), 200, dtype=np.uint8)

    def strip(mode, message):
        picture = draw_caption(blank, Caption(1.25, mode, "damping_controller", message))
        np.testing.assert_array_equal(picture[:440], blank[:440])
        return picture[450:].astype(np.int64)

    assert strip(Mode.DAMPING, "").mean() < 100
    assert np.abs(strip(Mode.DAMPING, "") - strip(Mode.LOCOMOTION, "")).max() > 60
    assert np.abs(strip(Mode.DAMPING, "") - strip(Mode.DAMPING, "LOAD_A refused")).max() > 60
