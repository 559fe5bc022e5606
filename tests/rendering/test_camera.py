from __future__ import annotations

import mujoco
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.rendering.camera import make_camera

BALL = '<geom type="sphere" size="0.1" mass="{mass}"/>'


def test_an_unknown_camera_is_named_with_those_that_exist() -> None:
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><camera name="left"/><camera name="right"/></worldbody></mujoco>'
    )
    assert make_camera(model, "right").fixedcamid == 1
    with pytest.raises(InputError, match=r"unknown camera 'top'; known: left, right"):
        make_camera(model, "top")


@pytest.mark.parametrize(("mass", "follows"), [(10.0, True), (0.1, False)])
def test_a_robot_that_can_walk_away_is_followed_and_a_ball_is_not(mass: float, follows: bool) -> None:
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body pos="1 0 0">{BALL.format(mass=1.0)}<joint/></body>'
        f'<body name="loose"><freejoint/>{BALL.format(mass=mass)}</body></worldbody></mujoco>'
    )
    camera = make_camera(model)
    assert (camera.type == mujoco.mjtCamera.mjCAMERA_TRACKING) == follows
    if follows:
        assert camera.trackbodyid == model.body("loose").id


def test_it_looks_at_the_front_of_the_robot() -> None:
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
