import mujoco
import numpy as np
import pytest
from msgspec.structs import replace

from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.schema import JointDynamics
from humanoid_sim.simulation.model import base_body, build_model

WITH_ACTUATORS = """
<mujoco>
  <worldbody>
    <light name="own"/>
    <body name="base">
      <site name="imu"/>
      <body name="link">
        <joint name="free_wheel" axis="0 1 0" range="-90 90"/>
        <joint name="hinge" axis="1 0 0" range="-90 90" actuatorfrcrange="-0.5 0.5"/>
        <geom size="0.1" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="servo" joint="hinge" kp="100"/>
    <motor name="torque" joint="free_wheel"/>
  </actuator>
  <sensor>
    <actuatorfrc name="servo_force" actuator="servo"/>
    <jointpos name="angle" joint="hinge"/>
  </sensor>
  <keyframe>
    <key name="home" qpos="0 1" ctrl="0 0"/>
  </keyframe>
</mujoco>
"""


def test_options():
    robot = load_robot("lite")
    model = build_model(robot)
    assert model.body(base_body(model, robot)).name == "chest"
    assert model.opt.timestep == 0.0005
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    assert build_model(load_robot("lite"), physics_timestep=0.001).opt.timestep == 0.001
    assert model.geom("floor").type[0] == mujoco.mjtGeom.mjGEOM_PLANE
    assert model.geom("floor").pos.tolist() == [0.0, 0.0, robot.simulation.floor_height]
    assert model.nlight == 1


def test_the_models_own_actuation_goes_and_limits_are_the_descriptions_whatever_the_models_unit(small_robot):
    """The MJCF is in degrees (MuJoCo's default): ±3 rad must not become ±3°."""
    model = build_model(small_robot(WITH_ACTUATORS, ("hinge",)))
    assert (model.nu, model.nkey, model.nsensor, model.sensor(0).name) == (0, 0, 1, "angle")
    hinge, free_wheel = model.joint("hinge").id, model.joint("free_wheel").id
    assert model.jnt_range[hinge].tolist() == [-3.0, 3.0]
    assert model.jnt_limited[hinge]
    assert not model.jnt_actfrclimited[hinge]
    # A joint that the description does not name stays as the MJCF has it.
    assert model.jnt_range[free_wheel] == pytest.approx([-np.pi / 2, np.pi / 2])


def test_affine_actuators_are_in_joint_order(small_robot):
    model = build_model(small_robot(joints=("elbow", "shoulder")), affine_actuators=True)
    assert [model.actuator(i).name for i in range(model.nu)] == ["elbow", "shoulder"]
    assert model.actuator_forcerange.tolist() == [[-5.0, 5.0], [-5.0, 5.0]]
    assert model.actuator_gainprm[:, 0].tolist() == [1.0, 1.0]
    assert not model.actuator_biasprm.any()
    assert not model.actuator_ctrllimited.any()


@pytest.mark.parametrize(("decision", "hinge"), [("keep", 0.7), ("drop", 0.0)])
def test_the_joints_own_damping(small_robot, decision, hinge):
    """Of the robot's joints: what else the MJCF damps stays as it is."""
    mjcf = WITH_ACTUATORS.replace('name="hinge"', 'name="hinge" damping="0.7"')
    mjcf = mjcf.replace('name="free_wheel"', 'name="free_wheel" damping="0.2"')
    simulation = {"physics_timestep": 0.001, "joint_damping": decision}
    model = build_model(small_robot(mjcf, ("hinge",), simulation=simulation))
    assert model.dof_damping[model.joint("hinge").dofadr[0]] == hinge
    assert model.dof_damping[model.joint("free_wheel").dofadr[0]] == 0.2


def test_measured_joints_take_the_place_of_the_mjcf_s(small_robot):
    robot = small_robot()
    measured = [JointDynamics(armature=0.015, friction=0.3, damping=0.1), JointDynamics(torque_scale=0.5)]
    joints = (replace(joint, dynamics=own) for joint, own in zip(robot.joints, measured, strict=True))
    simulation = replace(robot.simulation, joint_damping="drop")
    model = build_model(replace(robot, joints=tuple(joints), simulation=simulation))
    shoulder, elbow = (model.joint(name).dofadr[0] for name in robot.joint_names)
    found = model.dof_armature[shoulder], model.dof_frictionloss[shoulder], model.dof_damping[shoulder]
    assert found == (0.015, 0.3, 0.1)
    assert model.dof_armature[elbow] == build_model(robot).dof_armature[elbow], "what is not measured stays"


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
