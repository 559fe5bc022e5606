import mujoco
import numpy as np
import pytest

from humanoid_sim.simulation.stance import Floor

BALL = '<body name="ball" pos="0 0 {z}"><freejoint/><geom size="0.1" mass="2"/></body>'
PLANE, STEP = '<geom type="plane" size="1 1 1"/>', '<geom type="box" size="1 1 0.1" pos="5 0 0.1" rgba="0 0 0 0"/>'
SLOPE, PLATE = '<geom type="plane" size="0 0 1" euler="0 -45 0"/>', '<geom type="box" size="3 3 0.1" pos="0 0 -0.1"/>'
PICTURE = '<geom type="box" size="3 3 0.1" pos="0 0 0.4" contype="0" conaffinity="0"/>'


def world(geoms, z=1.0):
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}{BALL.format(z=z)}</worldbody></mujoco>")


@pytest.mark.parametrize(
    ("geoms", "z", "points", "found"),
    [
        # A plane is the floor everywhere, however large its picture is.
        ('<geom type="plane" size="1 1 0.1" pos="0 0 -0.3"/>', 1, [(0, 0, 1), (50, 0, 1), (0, 0, -5)], [-0.3] * 3),
        (PLANE + PICTURE, 1, [(0, 0, 1)], [0.0]),  # what cannot be touched is none
        (PLANE + STEP, 1, [(5, 0, 1), (3.9, 0, 1), (50, 0, 1), (5, 0, 0.05)], [0.2, 0.0, 0.0, 0.0]),
        (SLOPE, 1, [(1, 0, 3), (-1, 2, 3)], [1.0, -1.0]),
        (SLOPE + PLANE, 1, [(1, 0, 3), (-1, 2, 3)], [1.0, 0.0]),  # a second plane
        ("", 1, [(0, 0, 1)], [0.0]),
        (PLANE, 1, [(0, 0, 5)], [0.0]),  # the robot itself is none
        (PLATE, 2, [(0, 0, 5)], [0.0]),
    ],
)
def test_the_level_of_the_floor(geoms, z, points, found):
    assert Floor(world(geoms, z)).level(np.array(points)).tolist() == pytest.approx(found)
