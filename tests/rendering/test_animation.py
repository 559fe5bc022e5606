"""Animated pictures."""

from io import BytesIO

import mujoco
import numpy as np
from PIL import Image

from humanoid_sim.rendering.animation import animated_poses, animated_webp

SLIDER = """<mujoco>
  <visual><quality shadowsize="256"/></visual>
  <worldbody>
    <light pos="0 0 2"/>
    <body name="box"><joint type="slide" axis="0 1 0"/><geom type="box" size=".1 .1 .1" rgba="1 0 0 1"/></body>
  </worldbody>
</mujoco>"""


def test_an_animated_picture_repeats_and_keeps_its_times():
    frames = [Image.new("RGB", (16, 8), colour) for colour in ("red", "green", "blue")]
    with Image.open(BytesIO(animated_webp(frames, [80, 900, 80]))) as picture:
        assert picture.format == "WEBP"
        assert picture.size == (16, 8)
        assert picture.n_frames == 3
        assert picture.info["loop"] == 0
        picture.seek(1)
        picture.load()
        assert picture.info["duration"] == 900


def test_poses_are_drawn_one_after_the_other(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "disable")
    model = mujoco.MjModel.from_xml_string(SLIDER)
    poses = [np.array([y]) for y in (-0.2, 0.0, 0.2)]
    with Image.open(BytesIO(animated_poses(model, poses, rate=4.0, width=160))) as picture:
        assert picture.size == (160, 90)
        assert picture.n_frames == 3
        columns = []
        for i in range(3):
            picture.seek(i)
            shown = np.asarray(picture.convert("RGB")).astype(int)
            assert picture.info["duration"] == 250
            red = shown[..., 0] - shown[..., 1] > 60
            assert red.any()
            columns.append(np.nonzero(red)[1].mean())
    assert columns == sorted(columns) or columns == sorted(columns, reverse=True)
    assert abs(columns[2] - columns[0]) > 10
