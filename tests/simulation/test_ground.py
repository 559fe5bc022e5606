"""The level of the ground, and height scans, against ground whose height is known by formula, around any frame."""

import math

import mujoco
import numpy as np
import pytest

from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.simulation.height_scan import HeightScanner
from humanoid_sim.simulation.model import SimConfig, base_body, build_model
from humanoid_sim.simulation.sim_robot import SimRobot
from humanoid_sim.simulation.stance import Floor

WALKER = """
<mujoco>
  <asset>
    <hfield name="bowl" nrow="2" ncol="2" size="1 1 1 0.1" elevation="0 1 0 1"/>
    <mesh name="ramp" vertex="-1 -1 0 1 -1 0 -1 1 0 1 1 0 1 -1 1 1 1 1"/>
  </asset>
  <worldbody>
    {ground}
    <body name="trunk">
      <freejoint/>
      <geom type="box" size="2 2 0.1" pos="0 0 -0.3" mass="1"/>
      <site name="eye" pos="0.5 0.25 0.1" euler="0 0 90"/>
      <body name="leg" pos="0 0 0.2">
        <joint name="hip"/>
        <geom type="box" size="2 2 0.05" pos="0 0 -0.2" mass="1"/>
      </body>
    </body>
    <body name="ball" pos="0 0 0.5"><freejoint/><geom size="0.4" mass="1"/></body>
  </worldbody>
</mujoco>
"""
FLOOR = '<geom type="plane" size="1 1 1"/>'
STEP = FLOOR + '<body pos="2 0 0"><geom type="box" size="2 9 0.25" rgba="0 0 0 0"/></body>'  # 0.25 m high from x = 0 on
SLOPE = f'<geom type="plane" size="9 9 1" euler="0 {math.degrees(math.atan(0.5))} 0"/>'  # falls by 0.5 m per m along x
GRID = HeightScan(grid=(0.4, 0.2), resolution=0.2)  # x = -0.2, 0, 0.2; y = -0.1, 0.1


@pytest.fixture
def walker(small_robot):
    base = {"type": "floating", "body": "trunk", "height": 1.0}
    return lambda ground: small_robot(WALKER.format(ground=ground), ("hip",), imu="trunk", base=base)


def scan_of(robot, scan, pose):
    """Around a frame at x, y, z, turned by quaternion w x y z."""
    place = np.array([*pose[:3], *(pose[3:] or (1.0, 0.0, 0.0, 0.0))])
    model = build_model(robot)
    return HeightScanner(model, base_body(model, robot), scan, 1, 1).scan(place).tolist()


def turned(x=0.0, y=0.0, z=0.0):
    """Quaternion of a turn about one axis, rad."""
    angle, axis = x + y + z, [bool(x), bool(y), bool(z)]
    return math.cos(0.5 * angle), *(math.sin(0.5 * angle) * each for each in axis)


def test_level_ground_is_as_far_as_the_frame_is_high(walker):
    assert scan_of(walker(FLOOR), GRID, (3.0, -2.0, 0.7)) == pytest.approx([0.7] * 6)
    # Beyond the picture of a plane there is ground; what hangs on the robot, and what can move, is not.
    assert scan_of(walker(FLOOR), GRID, (0.0, 0.0, 1.5)) == pytest.approx([1.5] * 6)
    painted = '<geom type="box" size="1 1 0.5" contype="0" conaffinity="0"/>'
    assert scan_of(walker(FLOOR + painted), GRID, (0.0, 0.0, 2.0)) == pytest.approx([2.0] * 6), "cannot be touched"


def test_the_grid_turns_with_the_yaw_and_lies_level(walker):
    robot = walker(SLOPE)
    ahead = [-0.2, 0.0, 0.2] * 2

    def falls(pose):
        return [value - 2.0 for value in scan_of(robot, GRID, (0.0, 0.0, 2.0, *pose))]

    assert falls(turned()) == pytest.approx([0.5 * x for x in ahead])
    assert falls(turned(z=math.pi)) == pytest.approx([-0.5 * x for x in ahead])
    assert falls(turned(z=0.5 * math.pi)) == pytest.approx([0.05] * 3 + [-0.05] * 3)  # along x lies -y of the grid
    third = [0.5 * (0.5 * x - math.sqrt(0.75) * y) for y in (-0.1, 0.1) for x in (-0.2, 0.0, 0.2)]
    assert falls(turned(z=math.pi / 3.0)) == pytest.approx(third)
    assert falls(turned(x=0.6)) == pytest.approx(falls(turned()))
    assert falls(turned(y=-1.2)) == pytest.approx(falls(turned()))
    # Where x points down, y still tells the heading; upside down, x does.
    assert falls(turned(y=0.5 * math.pi)) == pytest.approx(falls(turned()))
    assert falls(turned(y=math.pi)) == pytest.approx(falls(turned(z=math.pi)))


def test_what_a_ray_cannot_reach_is_a_miss(walker):
    edge = walker('<geom type="box" size="1 9 0.5" pos="-1 0 -0.5"/>')  # ends at x = 0
    assert scan_of(edge, GRID, (-0.1, 0.0, 1.0)) == pytest.approx([1.0, 1.0, 5.0] * 2)
    short = HeightScan(grid=(0.0, 0.0), range=0.9, offset=0.5)
    assert scan_of(edge, short, (-0.1, 0.0, 0.8)) == pytest.approx([0.3])
    assert scan_of(edge, short, (-0.1, 0.0, 1.0)) == [0.9]


FRAMES = [("base", (0.0, 0.0, 0.0)), ("eye", (0.5, 0.25, 0.1)), ("leg", (0.0, 0.0, 0.2)), ("imu", (0.0, 0.0, 0.0))]


@pytest.mark.parametrize(("at", "offset"), FRAMES)
def test_it_lies_around_any_frame_of_the_robot(walker, at, offset):
    scan = HeightScan(at=at, grid=(0.4, 0.2), resolution=0.2)
    robot = SimRobot(walker(STEP), SimConfig(height_scan=scan))
    assert dict(robot.extern) == {"base_linear_velocity": 3, "height_scan": 6}
    live = robot.read()[0].extern["height_scan"]
    x, y = GRID.points.T
    if at == "eye":  # which is turned to the left
        x = -y
    ground = np.where(x + offset[0] >= 0.0, 0.25, 0.0)
    assert live.value == pytest.approx(1.0 + offset[2] - ground)
    assert live.arrival_time == 0.0


BALL = '<body name="ball" pos="0 0 {z}"><freejoint/><geom size="0.1" mass="2"/></body>'
PLANE, BLOCK = '<geom type="plane" size="1 1 1"/>', '<geom type="box" size="1 1 0.1" pos="5 0 0.1" rgba="0 0 0 0"/>'
TILTED, PLATE = '<geom type="plane" size="0 0 1" euler="0 -45 0"/>', '<geom type="box" size="3 3 0.1" pos="0 0 -0.1"/>'
PICTURE = '<geom type="box" size="3 3 0.1" pos="0 0 0.4" contype="0" conaffinity="0"/>'


def world(geoms, z=1.0):
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}{BALL.format(z=z)}</worldbody></mujoco>")


@pytest.mark.parametrize(
    ("geoms", "z", "points", "found"),
    [
        # A plane is the floor everywhere, however large its picture is.
        ('<geom type="plane" size="1 1 0.1" pos="0 0 -0.3"/>', 1, [(0, 0, 1), (50, 0, 1), (0, 0, -5)], [-0.3] * 3),
        (PLANE + PICTURE, 1, [(0, 0, 1)], [0.0]),  # what cannot be touched is none
        (PLANE + BLOCK, 1, [(5, 0, 1), (3.9, 0, 1), (50, 0, 1), (5, 0, 0.05)], [0.2, 0.0, 0.0, 0.0]),
        (TILTED, 1, [(1, 0, 3), (-1, 2, 3)], [1.0, -1.0]),
        (TILTED + PLANE, 1, [(1, 0, 3), (-1, 2, 3)], [1.0, 0.0]),  # a second plane
        ("", 1, [(0, 0, 1)], [0.0]),
        (PLANE, 1, [(0, 0, 5)], [0.0]),  # the robot itself is none
        (PLATE, 2, [(0, 0, 5)], [0.0]),
    ],
)
def test_the_level_of_the_floor(geoms, z, points, found):
    assert Floor(world(geoms, z)).level(np.array(points)).tolist() == pytest.approx(found)
