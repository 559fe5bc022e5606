import mujoco
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
