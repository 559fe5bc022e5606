import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.simulation.plant import make_plant
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
    measure = stability(small_robot(ROTOR, ("rotor",)), 0.001).measure(4.0)
    assert measure.eigenvalue == pytest.approx(0.001 * 4.0 / 0.01, rel=1e-6)
    assert measure.joint == "rotor"


def test_exceeding_a_limit_is_what_the_measure_says():
    robot = load_robot("lite")
    measured = stability(robot, 0.0005)
    rng = np.random.default_rng(3)
    seen = []
    for _ in range(40):
        damping = rng.uniform(0.0, 8.0, 14)
        eigenvalue = measured.measure(damping).eigenvalue
        for limit in (0.5 * eigenvalue, 0.999 * eigenvalue, 1.001 * eigenvalue, 3.0 * eigenvalue, 1.0):
            assert measured.exceeds(damping, limit) is (eigenvalue > limit)
            seen.append(eigenvalue > limit)
    assert 80 <= sum(seen) < 200
    assert measured.exceeds(0.0, 1.0) is False
    assert measured.exceeds(1e200, 1.0) is True
    assert measured.exceeds(np.nan, 1.0) is True


@pytest.mark.parametrize("name", ["lite", "lite_neck"])
def test_the_lite_at_half_a_millisecond(name):
    """Its working gains are far from the limit; the passive 5.0 is stable, and close enough to be mentioned."""
    robot = load_robot(name)
    measured = stability(robot, 0.0005)
    assert measured.measure(robot.damping).eigenvalue == pytest.approx(0.47, abs=0.01)
    assert measured.measure(5.0).eigenvalue == pytest.approx(1.18, abs=0.01)
    assert measured.check_description() == (
        f"{name}: damping_controller, remote_policy_controller: dt·M⁻¹·K_d reaches 1.18 at left_wrist_yaw with a "
        "physics step of 0.0005 s: stable, but the velocity changes sign from step to step above 1",
    )


@pytest.mark.parametrize(("timestep", "chatters"), [(0.0005, False), (0.001, True)])
def test_what_the_measure_predicts_happens(timestep, chatters):
    """Above 2 the wrist chatters at its torque limit for ever, without going non-finite; below, it comes to rest."""
    robot = load_robot("lite")
    plant = make_plant(robot, physics_timestep=timestep)
    zeros = np.zeros(14)
    plant.apply(MITCommand(zeros, zeros, zeros, zeros, np.full(14, 5.0)))
    plant.data.qvel[4] = 2.0
    plant.step(round(1.0 / timestep))
    speeds = []
    for _ in range(20):
        plant.step(1)
        speeds.append(float(plant.velocity[4]))
    assert not plant.fault()
    assert bool(np.abs(speeds).max() > 0.5) is chatters


def test_a_policys_gains_are_checked_by_name():
    robot = MujocoRobot(load_robot("lite"))
    gains = np.full(14, 2.0)
    assert robot.stability.check(gains, "policy.onnx: joint_damping") == ""
    gains[13] = 50.0
    with pytest.raises(InputError, match=r"^policy.onnx: joint_damping: dt·M⁻¹·K_d reaches .* at right_wrist_pitch "):
        robot.stability.check(gains, "policy.onnx: joint_damping")


def test_implicit_damping_is_limited_by_stiffness(small_robot):
    """One rotor: unstable where dt·√(K_p / (I + ½·dt·K_d)) exceeds 2, and it is."""
    robot, timestep = small_robot(ROTOR, ("rotor",)), 0.0025
    model = build_model(robot, physics_timestep=timestep, affine_actuators=True, implicit=True, scene=False)
    measured = DampingStability(model, robot)
    assert measured.is_implicit
    limit = 4.0 * (0.01 + 0.5 * timestep * 4.0) / timestep**2
    assert measured.measure_stiffness(limit, 4.0).eigenvalue == pytest.approx(2.0, rel=1e-4)
    for factor, grows in ((0.98, False), (1.02, True)):
        data = mujoco.MjData(model)
        model.actuator_forcelimited[:] = False
        model.actuator_biasprm[0, 1:3] = -factor * limit, -4.0
        data.qpos[0] = 0.01
        mujoco.mj_step(model, data, 100)
        assert bool(abs(data.qpos[0]) > 0.01) is grows
    assert measured.check(4.0, "policy", 0.2 * limit) == ""
    told = r"^policy: dt·√\(\(M \+ ½·dt·K_d\)⁻¹·K_p\) reaches 2.02 at rotor with implicit "
    with pytest.raises(InputError, match=told):
        measured.check(4.0, "policy", 1.02 * limit)
    assert "oscillations are far off above 1" in measured.check(4.0, "policy", 0.5 * limit)
    with pytest.raises(InputError, match="beyond all measure"):
        measured.check(1e200, "policy", 1.0)


def test_implicit_damping_says_where_a_joint_may_chatter():
    """A motor at its limit is not damped: the ankle roll of the legs, thrown to it at 2.5 ms, stays there."""
    robot = load_robot("lite_biped")
    model = build_model(robot, physics_timestep=0.0025, affine_actuators=True, implicit=True, scene=False)
    (joints, passive) = DampingStability(model, robot).check_description()
    assert joints == (
        "lite_biped: joints, standby_controller_a, standby_controller_b: dt·M⁻¹·K_d reaches 3.42 at right_ankle_roll "
        "with implicit steps of 0.0025 s: stable, but a joint that is thrown to its effort limit may chatter there "
        "above 2"
    )
    assert passive.startswith("lite_biped: damping_controller, remote_policy_controller: dt·M⁻¹·K_d reaches 3.42 ")
    shorter = build_model(robot, physics_timestep=0.001, affine_actuators=True, implicit=True, scene=False)
    assert DampingStability(shorter, robot).check_description() == ()
