import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import SimConfig, build_model
from humanoid_sim.simulation.sim_robot import SimRobot
from humanoid_sim.simulation.stability import DampingStability

# One joint whose inertia about its axis is 0.01 kg m² of rotor and nothing else.
ROTOR = """
<mujoco>
  <worldbody>
    <body name="base">
      <site name="imu"/>
      <body>
        <joint name="rotor" axis="0 0 1" armature="0.01"/>
        <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-12 1e-12 1e-12"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def stability(robot, timestep):
    return DampingStability(build_model(robot, physics_timestep=timestep), robot)


def test_the_measure_of_one_rotor_is_dt_kd_over_inertia(small_robot):
    value, joint = stability(small_robot(ROTOR, ("rotor",)), 0.001).measure(4.0)
    assert value == pytest.approx(0.001 * 4.0 / 0.01, rel=1e-6)
    assert joint == "rotor"


@pytest.mark.parametrize("name", ["lite", "lite_neck"])
def test_the_lite_at_half_a_millisecond(name):
    """Its working gains are far from the limit; the passive 5.0 is stable, and close enough to be mentioned."""
    robot = load_robot(name)
    measured = stability(robot, 0.0005)
    assert measured.measure(robot.damping)[0] == pytest.approx(0.47, abs=0.01)
    assert measured.measure(5.0)[0] == pytest.approx(1.18, abs=0.01)
    (warning,) = measured.check_description()
    assert warning.startswith(f"{name}: damping_controller: dt·M⁻¹·K_d reaches 1.18 at left_wrist_yaw ")


@pytest.mark.parametrize(("timestep", "chatters"), [(0.0005, False), (0.001, True)])
def test_predicted_chatter_happens(timestep, chatters):
    """Above 2 the wrist chatters at its torque limit for ever, without going non-finite; below, it comes to rest."""
    limp = load_robot("lite").to_json().replace('"damping_scalar":5.0', '"damping_scalar":1.0')
    robot = SimRobot(type(load_robot("lite")).from_json(limp), SimConfig(physics_timestep=timestep))
    qvel, zeros = np.zeros(14), np.zeros(14)
    qvel[4] = 2.0
    robot.reset(qvel=qvel)
    for _ in range(200):
        robot.write(MITCommand(zeros, zeros, zeros, zeros, np.full(14, 5.0)))
    assert not robot.fault
    assert bool(abs(robot.data.qvel[4]) > 0.5) is chatters


@pytest.mark.parametrize("damping", [50.0, 1e200, np.nan])
def test_unstable_gains_are_refused_with_joint_and_step(damping):
    measured, gains = stability(load_robot("lite"), 0.0005), np.full(14, 2.0)
    assert measured.check(gains, "policy.onnx") == ""
    gains[13] = damping
    with pytest.raises(InputError, match=r"^policy.onnx: dt·M⁻¹·K_d .* at right_wrist_pitch .*unstable above 2"):
        measured.check(gains, "policy.onnx")


def test_implicit_damping_is_limited_by_stiffness(small_robot):
    """One rotor: unstable where dt·√(K_p / (I + ½·dt·K_d)) exceeds 2, and it is."""
    robot, timestep = small_robot(ROTOR, ("rotor",)), 0.0025
    model = build_model(robot, physics_timestep=timestep, affine_actuators=True, implicit=True, scene=False)
    measured = DampingStability(model, robot)
    limit = 4.0 * (0.01 + 0.5 * timestep * 4.0) / timestep**2
    assert measured.measure(4.0, limit)[0] == pytest.approx(2.0, rel=1e-4)
    for factor, grows in ((0.98, False), (1.02, True)):
        data = mujoco.MjData(model)
        model.actuator_forcelimited[:] = False
        model.actuator_biasprm[0, 1:3] = -factor * limit, -4.0
        data.qpos[0] = 0.01
        mujoco.mj_step(model, data, 100)
        assert bool(abs(data.qpos[0]) > 0.01) is grows
    assert measured.check(4.0, "policy", 0.2 * limit) == ""
    with pytest.raises(InputError, match=r"^policy: dt·√\(\(M \+ ½·dt·K_d\)⁻¹·K_p\) reaches 2.02 at rotor "):
        measured.check(4.0, "policy", 1.02 * limit)
