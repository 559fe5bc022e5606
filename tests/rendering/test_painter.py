import mujoco
import numpy as np
import pytest

from humanoid_sim.rendering.offscreen import make_camera
from humanoid_sim.rendering.painter import Painter

CAMERA = '<camera name="eye" pos="3 0 0" xyaxes="0 1 0 0 0 1" fovy="45"/>'
"""On the x axis, looking along -x: +y is on the right of the picture, +z at its top."""


def paint(worldbody, *, qpos=None, size=(160, 120)):
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><statistic center="0 0 0" extent="2"/><worldbody>{CAMERA}{worldbody}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    if qpos is not None:
        data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    return Painter(model, *size, make_camera(model, "eye")).render(data).astype(np.int64)


def is_red(picture):
    return picture[..., 0] > picture[..., 2] + 60


def is_blue(picture):
    return picture[..., 2] > picture[..., 0] + 60


def centre(mask):
    """Column and row."""
    rows, columns = np.nonzero(mask)
    return float(columns.mean()), float(rows.mean())


def test_things_are_where_they_belong():
    picture = paint(
        '<geom type="box" size="0.2 0.2 0.2" pos="0 -0.6 0.3" rgba="1 0 0 1"/>'
        '<geom type="sphere" size="0.25" pos="0 0.6 -0.3" rgba="0 0 1 1"/>'
    )
    focal = 60 / np.tan(np.radians(22.5))
    assert centre(is_red(picture)) == pytest.approx((80 - 0.6 * focal / 2.8, 60 - 0.3 * focal / 2.8), abs=2.0)
    assert centre(is_blue(picture)) == pytest.approx((80 + 0.6 * focal / 3, 60 + 0.3 * focal / 3), abs=2.0)
    assert is_red(picture).sum() == pytest.approx((0.4 * focal / 2.8) ** 2, rel=0.2)
    assert is_blue(picture).sum() == pytest.approx(np.pi * (0.25 * focal / 3) ** 2, rel=0.1)


@pytest.mark.parametrize("red_first", [True, False])
def test_the_nearer_hides_the_farther(red_first):
    red = '<geom type="box" size="0.1 0.2 0.2" pos="0.5 0 0" rgba="1 0 0 1"/>'
    blue = '<geom type="box" size="0.1 0.2 0.2" pos="-0.5 0 0" rgba="0 0 1 1"/>'
    picture = paint(red + blue if red_first else blue + red)
    assert is_red(picture)[60, 80]
    assert not is_blue(picture).any()


def test_surfaces_that_cross_are_cut_where_they_cross():
    picture = paint(
        '<geom type="box" size="0.4 0.4 0.4" rgba="1 0 0 1"/>'
        '<geom type="sphere" size="0.5" pos="0 0 0" rgba="0 0 1 1"/>'
    )
    # The sphere comes through each face as a disc of radius 0.3, seen at a distance of 2.6.
    focal = 60 / np.tan(np.radians(22.5))
    middle = is_blue(picture)[60 - 14 : 60 + 14, 80 - 14 : 80 + 14]
    radius = 0.3 * focal / 2.6
    assert np.count_nonzero(is_blue(picture)[60]) == pytest.approx(2 * radius, abs=3)
    assert middle.mean() > 0.75


def test_what_is_behind_the_camera_is_not_drawn_and_what_is_around_it_is_cut():
    assert not is_red(paint('<geom type="sphere" size="0.5" pos="5 0 0" rgba="1 0 0 1"/>')).any()
    # A long beam passes under the camera, from far in front to behind: only the part in front shows, growing nearer.
    picture = paint('<geom type="box" size="4 0.1 0.1" pos="2 0 -0.4" rgba="1 0 0 1"/>')
    widths = is_red(picture).sum(axis=1)
    assert not widths[:60].any()
    assert widths[119] > 2 * widths[75] > 0


def test_the_inside_of_a_solid_does_not_show():
    picture = paint('<geom type="sphere" size="0.5" pos="3 0 0" rgba="1 0 0 1"/>')  # around the camera
    assert not is_red(picture).any()


@pytest.mark.parametrize("worldbody", ["", '<geom type="plane" size="0 0 1" pos="0 0 -1"/>'])
def test_an_empty_scene_is_a_picture(worldbody):
    picture = paint(worldbody)
    assert picture.shape == (120, 160, 3)
    assert picture[0].mean() < picture[55].mean()  # the sky is paler at the horizon


def test_the_ground_has_squares_and_takes_a_shadow():
    plane = '<geom type="plane" size="0 0 1" pos="0 0 -0.8" rgba="0.6 0.6 0.6 1"/>'
    ground = paint(plane)
    assert len(np.unique(ground[100, :, 0])) > 1
    shaded = paint(plane + '<geom type="sphere" size="0.2" pos="-0.3 0 -0.4" rgba="0 0 1 1"/>')
    darker = (ground - shaded).sum(axis=-1) > 60
    assert (darker & ~is_blue(shaded)).sum() > 50


def test_the_ground_hides_what_is_under_it():
    plane = '<geom type="plane" size="0 0 1" pos="0 0 -0.5" rgba="0.6 0.6 0.6 1"/>'
    picture = paint(plane + '<geom type="sphere" size="0.2" pos="0 0 -0.8" rgba="1 0 0 1"/>')
    assert not is_red(picture).any()


def test_a_pose_that_is_not_finite_loses_only_what_hangs_on_it():
    picture = paint(
        '<geom type="box" size="0.2 0.2 0.2" pos="0 -0.6 0" rgba="1 0 0 1"/>'
        '<body><joint type="slide" axis="0 1 0"/>'
        '<geom type="sphere" size="0.2" pos="0 0.6 0" rgba="0 0 1 1"/></body>',
        qpos=[np.nan],
    )
    assert is_red(picture).any()
    assert not is_blue(picture).any()


def test_colours_come_from_materials_and_invisible_geoms_are_left_out():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><asset><material name="red" rgba="1 0 0 1"/></asset><worldbody>'
        + CAMERA
        + '<geom type="box" size="0.2 0.2 0.2" material="red"/>'
        + '<geom type="box" size="0.3 0.3 0.3" pos="0.5 0 0" rgba="0 0 1 0"/>'
        + '<geom type="box" size="0.3 0.3 0.3" pos="0.5 0 0" rgba="0 0 1 1" group="3"/></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    picture = Painter(model, 160, 120, make_camera(model, "eye")).render(data).astype(np.int64)
    assert is_red(picture).any()
    assert not is_blue(picture).any()


def test_pictures_follow_the_pose():
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody>{CAMERA}<body><joint type="slide" axis="0 1 0"/>'
        '<geom type="sphere" size="0.2" rgba="1 0 0 1"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    painter = Painter(model, 160, 120, make_camera(model, "eye"))
    columns = []
    for position in (-0.5, 0.5):
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        columns.append(centre(is_red(painter.render(data).astype(np.int64)))[0])
    assert columns[0] < 60
    assert columns[1] > 100
