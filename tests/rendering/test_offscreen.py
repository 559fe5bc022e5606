import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.rendering import offscreen
from humanoid_sim.rendering.backend import Choice
from humanoid_sim.rendering.offscreen import (
    make_camera,
    make_renderer,
    update_pose,
)

BALL = '<geom type="sphere" size="0.1" mass="{mass}"/>'
NONE = Choice("none", "requested")


@pytest.fixture(autouse=True)
def _no_memory_of_failures(monkeypatch):
    monkeypatch.setattr(offscreen, "_failures", {})


def test_a_window_that_cannot_be_opened_is_said_every_time(pendulum, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":4711")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    for _ in range(2):
        with pytest.raises(InputError, match=r"glfw \(there is a display\): RuntimeError: no window can be opened$"):
            make_renderer(pendulum, 32, 24, choice=Choice("glfw", "there is a display"))


def test_an_egl_that_makes_no_context_is_never_tried_in_this_process(pendulum, monkeypatch):
    monkeypatch.setattr(offscreen, "egl_works", lambda: False)
    with pytest.raises(InputError, match=r"egl \(MUJOCO_GL=egl\): makes no context$"):
        make_renderer(pendulum, 32, 24, choice=Choice("egl", "MUJOCO_GL=egl"))


def test_a_driver_whose_error_has_no_text_is_named(pendulum, monkeypatch):
    class DriverError(Exception):
        def __str__(self):
            raise RuntimeError("the driver is gone")

    def fail(*_):
        raise DriverError

    monkeypatch.setattr(offscreen, "_OpenGLRenderer", fail)
    with pytest.raises(InputError, match=r"osmesa \(requested\): DriverError:$"):
        make_renderer(pendulum, 32, 24, choice=Choice("osmesa", "requested"))


def test_a_machine_without_opengl_draws_nothing_and_says_so(pendulum):
    with pytest.raises(InputError, match=r"^pictures: no OpenGL \(requested\) here; Debian's package libosmesa6"):
        make_renderer(pendulum, 32, 24, choice=NONE)


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
        make_renderer(pendulum, 32, 32, "top", choice=NONE)


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
