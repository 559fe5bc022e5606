import mujoco
import numpy as np
import pytest

from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.scene import CAMERAS


def names(model, kind, count):
    return [mujoco.mj_id2name(model, kind, i) for i in range(count)]


def test_the_room_has_floor_lights_sky_and_cameras():
    model = build_model(load_robot("lite"))
    floor = model.geom("floor")
    assert floor.type[0] == mujoco.mjtGeom.mjGEOM_PLANE
    assert floor.pos.tolist() == [0.0, 0.0, load_robot("lite").simulation.floor_height]
    assert model.nlight == 2
    assert model.light_castshadow.sum() == 1
    assert int(mujoco.mjtTexture.mjTEXTURE_SKYBOX) in model.tex_type.tolist()
    assert names(model, mujoco.mjtObj.mjOBJ_CAMERA, model.ncam) == list(CAMERAS)
    assert (model.vis.global_.offwidth, model.vis.global_.offheight) >= (1280, 960)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.cam("front").xpos[0] > 1.0  # x is forward
    assert data.cam("back").xpos[0] < -1.0
    bare = build_model(load_robot("lite"), scene=False)
    assert (bare.nlight, bare.ncam, bare.ntex) == (0, 0, 0)
    assert mujoco.mj_name2id(bare, mujoco.mjtObj.mjOBJ_GEOM, "floor") == -1


@pytest.mark.parametrize(("robot", "scenes"), [("lite", (True, "floor", False)), ("lite_biped", (True, "floor"))])
def test_the_scene_does_not_change_the_dynamics(robot, scenes):
    ends = []
    for scene in scenes:
        model = build_model(load_robot(robot), scene=scene)
        assert scene is True or (model.nlight, model.ncam, model.ntex) == (0, 0, 0)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 400)
        ends.append((data.qpos.tolist(), data.qvel.tolist()))
    assert ends[1:] == [ends[0]] * (len(scenes) - 1)


def assert_sees(model, camera, points):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    seen = data.cam(camera)
    rotation = seen.xmat.reshape(3, 3)
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-9)
    half_height = np.tan(np.deg2rad(0.5 * model.cam(camera).fovy[0]))
    for point in points:
        x, y, z = rotation.T @ ((data.body(point).xpos if isinstance(point, str) else point) - seen.xpos)
        assert z < 0.0  # in front of the camera, which looks along its own -z
        assert abs(y / z) < half_height
        assert abs(x / z) < half_height * 4 / 3


@pytest.mark.parametrize("camera", list(CAMERAS))
def test_every_camera_sees_the_whole_robot(camera):
    assert_sees(build_model(load_robot("lite")), camera, ["head", "left_hand", "right_hand", "chest"])
    feet_and_head = ["left_foot", "right_foot", [0.0, 0.0, 0.0], [0.0, 0.0, 0.95]]
    assert_sees(build_model(load_robot("lite_biped")), camera, feet_and_head)


def test_what_the_model_brings_is_not_doubled(small_robot):
    mjcf = """
    <mujoco>
      <asset><texture name="sky" type="skybox" builtin="flat" width="8" height="48"/></asset>
      <worldbody>
        <light name="own"/>
        <camera name="front" pos="9 0 0"/>
        <geom name="ground" type="plane" size="1 1 1"/>
        <body name="base">
          <site name="imu"/>
          <body><joint name="hinge"/><geom size="0.1"/></body>
        </body>
      </worldbody>
    </mujoco>
    """
    model = build_model(small_robot(mjcf, ("hinge",)))
    assert names(model, mujoco.mjtObj.mjOBJ_LIGHT, model.nlight) == ["own"]
    assert (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE).sum() == 1
    assert (model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX).sum() == 1
    assert model.cam("front").pos[0] == 9.0
    assert model.ncam == len(CAMERAS)


@pytest.mark.parametrize("camera", list(CAMERAS))
def test_cameras_follow_a_floating_base_without_turning_with_it(hopper, camera):
    model = build_model(load_robot(hopper))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    position, rotation = data.cam(camera).xpos.copy(), data.cam(camera).xmat.copy()
    data.qpos[:7] += [5.0, -2.0, 0.3, -0.5, 0.3, 0.1, 0.5]
    mujoco.mj_forward(model, data)
    assert data.cam(camera).xpos - position == pytest.approx([5.0, -2.0, 0.3], abs=1e-9)
    assert data.cam(camera).xmat == pytest.approx(rotation, abs=1e-9)


def test_a_robot_that_shows_nothing_shows_its_colliders(hopper):
    text = hopper.read_text().replace('<geom name="foot" ', '<geom name="foot" group="3" ')
    hopper.write_text(text)
    assert build_model(load_robot(hopper)).geom("foot").group == 3  # the trunk is there to be seen
    hopper.write_text(text.replace("<geom type", '<geom group="4" type'))
    model = build_model(load_robot(hopper))
    assert model.geom_group.tolist() == [0] * model.ngeom


FLOORS = [
    '<body pos="0 0 -0.1"><geom type="plane" size="1 1 1"/></body>',
    '<geom type="box" size="2 2 0.1" pos="0 0 -0.1"/>',
    '<geom type="hfield" hfield="hills"/>',
]


@pytest.mark.parametrize("floor", FLOORS)
def test_no_floor_is_put_upon_another(hopper, floor):
    ground = '<geom name="ground" type="plane" size="0 0 0.05"/>'
    hills = '<asset><hfield name="hills" nrow="4" ncol="4" size="2 2 0.1 0.1"/></asset>'
    text = hopper.read_text()
    hopper.write_text(text.replace(ground, floor).replace("<worldbody>", f"{hills}<worldbody>"))
    assert mujoco.mj_name2id(build_model(load_robot(hopper)), mujoco.mjtObj.mjOBJ_GEOM, "floor") == -1
    table = '<geom name="floor" type="box" size="0.5 0.5 0.1" pos="3 0 0.5"/>'
    hopper.write_text(text.replace(ground, table))
    model = build_model(load_robot(hopper))  # which has a geom called floor already
    assert (model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE).sum() == 1


def test_the_floor_holds_whatever_can_collide(hopper):
    text = hopper.read_text().replace('<geom name="ground" type="plane" size="0 0 0.05"/>', "")
    hopper.write_text(text.replace('<geom name="foot" ', '<geom name="foot" contype="4" conaffinity="0" '))
    model = build_model(load_robot(hopper))
    assert model.geom("floor").conaffinity[0] & 4
    data = mujoco.MjData(model)
    data.qpos[2] = 0.5
    mujoco.mj_forward(model, data)
    assert {model.geom("foot").id, model.geom("floor").id} in [set(pair) for pair in data.contact.geom.tolist()]
