from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.scene import CAMERAS

RobotFactory = Callable[..., RobotDescription]


def names(model: mujoco.MjModel, kind: mujoco.mjtObj, count: int) -> list[str]:
    return [mujoco.mj_id2name(model, kind, i) for i in range(count)]


def test_the_room_has_floor_lights_sky_and_cameras() -> None:
    model = build_model(load_robot("lite"))
    floor = model.geom("floor")
    assert floor.type[0] == mujoco.mjtGeom.mjGEOM_PLANE
    assert floor.pos.tolist() == [0.0, 0.0, load_robot("lite").simulation.floor_height]
    assert model.nlight == 2
    assert model.light_castshadow.sum() == 1
    assert int(mujoco.mjtTexture.mjTEXTURE_SKYBOX) in model.tex_type.tolist()
    assert names(model, mujoco.mjtObj.mjOBJ_CAMERA, model.ncam) == list(CAMERAS)
    assert (model.vis.global_.offwidth, model.vis.global_.offheight) >= (1280, 960)


def test_without_a_scene_there_is_only_the_robot() -> None:
    model = build_model(load_robot("lite"), scene=False)
    assert (model.nlight, model.ncam, model.ntex) == (0, 0, 0)
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "floor") == -1


@pytest.mark.parametrize("camera", list(CAMERAS))
def test_every_camera_sees_the_whole_robot(camera: str) -> None:
    model = build_model(load_robot("lite"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    position = data.cam(camera).xpos
    rotation = data.cam(camera).xmat.reshape(3, 3)
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-9)
    half_height = np.tan(np.deg2rad(0.5 * model.cam(camera).fovy[0]))
    for body in ("head", "left_hand", "right_hand", "chest"):
        x, y, z = rotation.T @ (data.body(body).xpos - position)
        assert z < 0.0  # in front of the camera, which looks along its own -z
        assert abs(y / z) < half_height
        assert abs(x / z) < half_height * 4 / 3


def test_the_front_camera_sees_the_face() -> None:
    model = build_model(load_robot("lite"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.cam("front").xpos[0] > 1.0  # x is forward
    assert data.cam("back").xpos[0] < -1.0


def test_what_the_model_brings_is_not_doubled(small_robot: RobotFactory) -> None:
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


def test_the_scene_does_not_change_the_dynamics() -> None:
    robot = load_robot("lite")
    results = []
    for scene in (True, False):
        model = build_model(robot, scene=scene)
        data = mujoco.MjData(model)
        for _ in range(200):
            mujoco.mj_step(model, data)
        results.append(data.qpos.copy())
    assert (results[0] == results[1]).all()
