import mujoco
import pytest

from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model


def test_the_room_has_floor_light_and_sky():
    model = build_model(load_robot("lite"))
    floor = model.geom("floor")
    assert floor.type[0] == mujoco.mjtGeom.mjGEOM_PLANE
    assert floor.pos.tolist() == [0.0, 0.0, load_robot("lite").simulation.floor_height]
    assert model.nlight == 1
    assert int(mujoco.mjtTexture.mjTEXTURE_SKYBOX) in model.tex_type.tolist()


@pytest.mark.parametrize(("robot", "scenes"), [("lite", (True, "floor", False)), ("lite_biped", (True, "floor"))])
def test_the_scene_does_not_change_the_dynamics(robot, scenes):
    ends = []
    for scene in scenes:
        model = build_model(load_robot(robot), scene=scene)
        assert scene is True or (model.nlight, model.ntex) == (0, 0)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 400)
        ends.append((data.qpos.tolist(), data.qvel.tolist()))
    assert ends[1:] == [ends[0]] * (len(scenes) - 1)
