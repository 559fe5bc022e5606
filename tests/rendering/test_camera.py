import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.rendering.camera import make_camera, tint_sides, update_pose

BALL = '<geom type="sphere" size="0.1" mass="{mass}"/>'


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


def test_it_looks_at_the_front_of_the_robot(pendulum):
    scene, data = mujoco.MjvScene(pendulum, 10), mujoco.MjData(pendulum)
    mujoco.mj_kinematics(pendulum, data)
    every = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(pendulum, data, mujoco.MjvOption(), None, make_camera(pendulum), every, scene)
    eye = scene.camera[0].pos
    assert eye[0] > 0.5
    assert abs(eye[1]) < eye[0]


@pytest.mark.parametrize("colour", ["0.5 0.5 0.5 1", "0.9 0.1 0.1 1"])
def test_left_and_right_of_a_robot_of_one_colour_are_told_apart(colour):
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><geom type="plane" size="0 0 1"/><body><freejoint/><geom size="0.2"/>
        <body pos="0 0.2 0"><joint/><geom size="0.1"/></body>
        <body pos="0 -0.2 0"><joint/><geom size="0.1" rgba="{colour}"/></body></body></worldbody></mujoco>"""
    )
    before = model.geom_rgba.copy()
    tint_sides(model)
    changed = [2, 3] if colour.startswith("0.5") else []
    assert np.flatnonzero((model.geom_rgba != before).any(axis=1)).tolist() == changed
