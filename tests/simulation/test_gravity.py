"""Gravity's levers: what holds a robot is what MuJoCo computes, in its pose and in those that it might be in."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from msgspec.structs import replace as changed

from humanoid_sim.controllers.signs import _Tree
from humanoid_sim.errors import InputError
from humanoid_sim.mit import GRAVITY_LEVERS
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.schema import SignSettings
from humanoid_sim.simulation.floating_base import base_addresses
from humanoid_sim.simulation.gravity import GravityLevers, LeverSamples
from humanoid_sim.simulation.model import build_model, joint_addresses
from humanoid_sim.simulation.sensors import Imu
from humanoid_sim.testing import healthy_state

EXACT = SignSettings(mass_error=0.0, payload=0.0, friction=0.0)


def needed(robot, pose, hangs):
    """Torques of MuJoCo's inverse dynamics, N·m, and the IMU's quaternion."""
    model = build_model(robot, scene=False)
    data = mujoco.MjData(model)
    joints = joint_addresses(model, robot.joint_names)
    data.qpos[joints.qpos] = pose
    if robot.is_floating:
        data.qpos[base_addresses(model, robot)[1]] = hangs
    mujoco.mj_forward(model, data)
    return data.qfrc_bias[joints.dof].copy(), Imu(model, robot.imu).read(data).quaternion


@pytest.mark.parametrize("name", ["lite", "lite_biped"])
def test_they_hold_the_robot_as_it_is_and_as_it_might_be(name):
    robot, generator = load_robot(name), np.random.default_rng(3)
    levers = GravityLevers(robot, EXACT)
    n = robot.joint_count
    pose = generator.uniform(robot.lower, robot.upper)
    hangs = np.array([0.9, 0.2, -0.3, 0.25])
    hangs /= np.linalg.norm(hangs)
    torques, quaternion = needed(robot, pose, hangs)
    tree = _Tree.of(levers(replace(healthy_state(pose), imu_quaternion=quaternion)))
    assert tree.own == pytest.approx(torques, abs=1e-9)
    turns = generator.uniform(-2.0, 2.0, n)
    for joint, found in enumerate(tree.torque(np.arange(n), turns)):
        turned = pose + turns[joint] * (np.arange(n) == joint)
        assert found == pytest.approx(needed(robot, turned, hangs)[0], abs=1e-9), robot.joint_names[joint]


def test_limbs_that_may_stand_are_those_that_end_lowest():
    legs, arms = load_robot("lite_biped"), load_robot("lite")
    pose = np.array(legs.initial_position)
    assert GravityLevers(legs, EXACT)(healthy_state(pose))[:, 9].all()
    pose[legs.joint_names.index("left_hip_pitch")] = -1.5
    left = np.array([name.startswith("left") for name in legs.joint_names])
    assert (GravityLevers(legs, EXACT)(healthy_state(pose))[:, 9] == ~left).all()
    assert not GravityLevers(arms, EXACT)(healthy_state(np.array(arms.initial_position)))[:, 9].any()


def test_a_payload_only_adds_weight():
    robot = load_robot("lite")
    state = healthy_state(np.array(robot.standby_controller_b.pose_segments[-1]))
    plain, loaded = (GravityLevers(robot, changed(EXACT, payload=mass))(state) for mass in (0.0, 0.5))
    needs = _Tree.of(plain).own
    elbow = robot.joint_names.index("left_elbow_pitch")
    less, more = (loaded - plain)[elbow, 7:9] * np.sign(needs[elbow]) ** np.array([1, 1])
    with_weight, against = (abs(more), abs(less)) if needs[elbow] > 0 else (abs(less), abs(more))
    assert with_weight > 0.5
    assert against < 0.3


MJCF = """
<mujoco><compiler angle="radian"/><worldbody><body name="trunk">
  <geom size="0.1" mass="1"/><site name="imu"/>
  <body name="upper" pos="0 0 -0.1"><joint name="hip" axis="0 1 0" range="-1 1" {hip}/>
    <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="1"/>
    <body name="lower" pos="0.2 0 0"><joint name="knee" axis="0 1 0" range="-1 1"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="1"/></body></body></body></worldbody>{rest}</mujoco>
"""


@pytest.fixture
def make(tmp_path):
    def write(hip="", rest=""):
        path = tmp_path / "leg.xml"
        path.write_text(MJCF.format(hip=hip, rest=rest), encoding="utf-8")
        return load_robot(path)

    return write


def test_a_spring_is_not_gravity_and_friction_of_the_model_counts(make):
    state = healthy_state(np.zeros(2))
    own = _Tree.of(GravityLevers(make(), EXACT)(state)).own
    assert own == pytest.approx([-9.81 * 0.4, -9.81 * 0.1])
    sprung = GravityLevers(make('stiffness="3"'), EXACT)(state)
    assert not sprung[0, :3].any()
    assert _Tree.of(sprung).own == pytest.approx([0.0, own[1]])
    rough = GravityLevers(make('frictionloss="0.8"'), SignSettings(mass_error=0.0, payload=0.0))(state)[:, 7]
    smooth = GravityLevers(make(), SignSettings(mass_error=0.0, payload=0.0))(state)[:, 7]
    assert rough - smooth == pytest.approx([0.5, 0.0])


def test_coupled_joints_are_refused(make):
    robot = make(rest='<equality><joint joint1="hip" joint2="knee"/></equality>')
    with pytest.raises(InputError, match=r"^leg\.xml couples joints by equality constraints$"):
        GravityLevers(robot, EXACT)


@pytest.mark.parametrize("period", [0.005, 0.02, 0.03, 0.25])
def test_samples_come_ten_times_a_second_and_only_while_it_is_held(period):
    robot = load_robot("lite")
    state = None
    samples = LeverSamples(GravityLevers(robot, EXACT), period, lambda: state)
    assert samples.latest() == {}
    times = []
    for k in range(round(2.0 / period)):
        state = healthy_state(np.array(robot.initial_position), k * period)
        live = samples.latest()
        if live:
            assert live[GRAVITY_LEVERS].arrival_time == state.time
            times.append(k * period)
    assert np.diff(times) == pytest.approx(max(0.1, period), abs=period)
    state = replace(healthy_state(np.full(robot.joint_count, np.nan)), time=0.1)
    assert samples.latest() == {}
