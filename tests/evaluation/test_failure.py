import numpy as np
import pytest

from humanoid_sim.evaluation import failure
from humanoid_sim.evaluation.errors import PoseError
from humanoid_sim.evaluation.failure import DEFINITIONS, differing
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.floating_base import BaseObserver, BaseState
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.sim_robot import SimRobot
from humanoid_sim.simulation.stance import clearance


def leaning(tilt):
    zero = np.zeros_like(tilt)
    return np.stack([np.cos(tilt / 2), np.sin(tilt / 2), zero, zero], axis=-1)


def base(height, tilt):
    zeros = np.zeros((*height.shape, 3))
    position = zeros.copy()
    position[..., 2] = height
    return BaseState(zeros, leaning(tilt), zeros, zeros, position, np.zeros_like(height))


def test_a_fall_is_a_tilt_of_more_than_1_rad_or_less_than_six_tenths_of_the_height():
    bases = base(np.array([0.8, 0.49, 0.47, 0.8, 0.8]), np.array([0.0, 0.0, 0.0, 0.99, 1.01]))
    assert failure.has_fallen(bases, 0.8).tolist() == [False, False, True, False, True]
    assert failure.has_fallen(bases, np.array([0.8, 0.9, 0.7, 0.8, 0.8])).tolist() == [False, True, False, False, True]


def test_an_anchor_strays_by_height_or_tilt_and_not_by_heading_or_place():
    offset = np.array([[5.0, 5.0, 0.34], [0.0, 0.0, -0.36], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, np.nan]])
    turn = np.stack([*leaning(np.array([0.0, 0.0, 1.19, 1.21])), np.array([np.cos(1.5), 0.0, 0.0, np.sin(1.5)])])
    error = PoseError(offset, turn)
    assert failure.has_strayed(error).tolist() == [False, True, False, True, True]
    assert error.angle[4] == pytest.approx(3.0)
    assert error.tilt[4] == 0.0


def test_a_body_strays_by_its_distance():
    distance = np.array([[0.1, 0.29], [0.31, 0.0], [np.nan, 0.0]])
    assert failure.body_has_strayed(distance).tolist() == [False, True, True]


ROBOT = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <geom name="ground" type="plane" size="0 0 0.05" pos="0 0 {floor}"/>
    <body name="base" pos="0 0 1">
      <freejoint/>
      <site name="imu"/>
      <body name="hips" pos="0 0 {down}">
        <geom type="box" size="0.1 0.15 0.2" pos="0 0 0.3" mass="10"/>
        <body name="leg">
          <joint name="hip" axis="0 1 0" range="-2 2" armature="0.02"/>
          <geom type="box" size="0.05 0.1 0.25" pos="0 0 -0.25" mass="2" contype="0" conaffinity="0"/>
          <body name="shank" pos="0 0 -0.5">
            <joint name="knee" axis="0 1 0" range="-2.5 2.5" armature="0.02"/>
            <geom type="box" size="0.1 0.15 0.2" pos="0 0 -0.2" mass="2"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
"""1.4 m high, the hips at 0.9 m, with its base's frame anywhere: `down` is from there to the hips."""
FRAMES = {"hips": 0.0, "above the head": -0.8, "below the ground": 1.1}
MASS = (10.0 * 1.2 + 2.0 * 0.65 + 2.0 * 0.2) / 14.0
"""m, of its centre of mass where it stands."""
FOLDED = np.array([-1.5, 2.4])
"""rad: it sits on its heels."""


@pytest.fixture(params=FRAMES)
def figure(request, tmp_path):
    """Writes that robot."""

    def make(floor=0.0):
        path = tmp_path / "figure.xml"
        path.write_text(ROBOT.format(down=FRAMES[request.param], floor=floor))
        return path

    return make


def posed(robot, joints, quaternion=None):
    """On the floor in some pose."""
    observer = BaseObserver(robot.model, robot.description)
    qpos = robot.qpos.copy()
    qpos[7:] = joints
    if quaternion is not None:
        qpos[3:7] = quaternion
    qpos[2] -= clearance(robot.model, qpos)
    return observer.at(qpos, np.zeros(8))


@pytest.mark.parametrize("floor", [0.0, -0.8])
def test_a_fall_is_one_wherever_the_base_frame_and_the_floor_lie(figure, floor):
    robot = SimRobot(load_robot(figure(floor)), SimConfig(support=False))
    standing = BaseObserver(robot.model, robot.description).standing_height(robot.qpos)
    assert standing == pytest.approx(MASS)
    base = robot.base
    assert base.mass_height == pytest.approx(MASS)
    assert not failure.has_fallen(base, standing)
    crouching = posed(robot, np.array([-0.6, 1.2]))
    assert 0.75 * MASS < crouching.mass_height < 0.95 * MASS
    assert not failure.has_fallen(crouching, standing)
    sitting = posed(robot, FOLDED)
    assert sitting.mass_height < 0.6 * MASS
    assert failure.has_fallen(sitting, standing)
    lying = posed(robot, np.zeros(2), np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]))
    assert lying.tilt == pytest.approx(np.pi / 2)
    assert failure.has_fallen(lying, standing)


def test_joints_that_no_motor_could_turn_as_fast_are_a_fault():
    assert failure.has_run_away(np.array([[0.0, -99.0], [0.0, -101.0]])).tolist() == [False, True]


def test_what_differs_is_named():
    assert differing(DEFINITIONS) == ()
    assert differing({**DEFINITIONS, "loss": "it is out of sight"}) == ("loss",)
    assert differing({}) == ("fall", "loss", "errors")
    assert differing({**DEFINITIONS, "more": "than there is today"}) == ()
