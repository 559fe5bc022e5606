from io import BytesIO

import mujoco
import numpy as np
import pytest
from PIL import Image

from humanoid_sim.errors import InputError
from humanoid_sim.rendering import offscreen
from humanoid_sim.rendering.backend import Choice
from humanoid_sim.rendering.offscreen import (
    animated_poses,
    animated_webp,
    make_camera,
    make_renderer,
    update_pose,
)

BALL = '<geom type="sphere" size="0.1" mass="{mass}"/>'
OSMESA, PAINTER = Choice("osmesa", "asked for"), Choice("none", "asked for")


@pytest.fixture(autouse=True)
def _no_memory_of_failures(monkeypatch):
    monkeypatch.setattr(offscreen, "_failures", {})


def silhouette(model, choice):
    data = mujoco.MjData(model)
    update_pose(model, data, np.array([0.8]))
    renderer = make_renderer(model, 320, 240, choice=choice)
    try:
        picture = renderer.render(data).astype(np.int64)
    finally:
        renderer.close()
        renderer.close()
    assert picture.shape == (240, 320, 3)
    return renderer.backend, picture[..., 0] > 1.8 * picture[..., 2]


def test_a_window_that_cannot_be_opened_gives_way_to_the_painter_every_time(pendulum, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":4711")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    for _ in range(2):
        name, painted = silhouette(pendulum, Choice("glfw", "there is a display"))
        assert name == "software painter (glfw (there is a display): RuntimeError: no window can be opened)"
        assert painted.any()


def test_an_egl_that_makes_no_context_is_never_tried_in_this_process(pendulum, monkeypatch):
    monkeypatch.setattr(offscreen, "egl_works", lambda: False)
    name, painted = silhouette(pendulum, Choice("egl", "MUJOCO_GL=egl"))
    assert name == "software painter (egl (MUJOCO_GL=egl): makes no context)"
    assert painted.any()


def test_a_driver_whose_error_has_no_text_gives_way_too(pendulum, monkeypatch):
    class DriverError(Exception):
        def __str__(self):
            raise RuntimeError("the driver is gone")

    def fail(*_):
        raise DriverError

    monkeypatch.setattr(offscreen, "_OpenGLRenderer", fail)
    assert silhouette(pendulum, OSMESA)[0] == "software painter (osmesa (asked for): DriverError:)"


def test_a_pose_that_is_not_finite_is_not_taken(pendulum):
    data = mujoco.MjData(pendulum)
    assert update_pose(pendulum, data, np.array([0.5]))
    before = data.geom_xpos.copy()
    assert not update_pose(pendulum, data, np.array([np.nan]))
    assert data.qpos[0] == 0.5
    np.testing.assert_array_equal(data.geom_xpos, before)


def test_an_unknown_camera_is_named_with_those_that_exist(pendulum):
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><camera name="left"/><camera name="right"/></worldbody></mujoco>'
    )
    assert make_camera(model, "right").fixedcamid == 1
    with pytest.raises(InputError, match=r"unknown camera 'top'; known: left, right"):
        make_camera(model, "top")
    with pytest.raises(InputError, match=r"unknown camera 'top'; known: none"):
        make_renderer(pendulum, 32, 32, "top", choice=PAINTER)


@pytest.mark.parametrize(("mass", "follows"), [(10.0, True), (0.1, False)])
def test_a_robot_that_can_walk_away_is_followed_and_a_ball_is_not(mass, follows):
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body pos="1 0 0">{BALL.format(mass=1.0)}<joint/></body>'
        f'<body name="loose"><freejoint/>{BALL.format(mass=mass)}</body></worldbody></mujoco>'
    )
    camera = make_camera(model)
    assert (camera.type == mujoco.mjtCamera.mjCAMERA_TRACKING) == follows
    if follows:
        assert camera.trackbodyid == model.body("loose").id


def test_it_looks_at_the_front_of_the_robot():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><statistic center="0 0 0" extent="1"/><worldbody><geom size="0.1"/></worldbody></mujoco>'
    )
    scene, data = mujoco.MjvScene(model, 10), mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    every = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, make_camera(model), every, scene)
    eye = scene.camera[0].pos
    assert eye[0] > 0.8
    assert abs(eye[1]) < eye[0]
    assert 0 < eye[2] < eye[0]


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
