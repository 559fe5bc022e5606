import msgspec
import mujoco
import numpy as np
import pytest

from humanoid_sim.mit import MITCommand, mit_torque
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.plant import make_plant

EXACT = ("qfrc_applied", "affine")
ACTUATIONS = (*EXACT, "implicit")


def random_command(robot, generator, strength=1.0):
    n = robot.joint_count
    return MITCommand(
        position=generator.uniform(robot.lower, robot.upper),
        velocity=generator.normal(0.0, 1.0, n),
        effort=generator.normal(0.0, strength, n),
        stiffness=generator.uniform(0.0, 80.0 * strength, n),
        damping=generator.uniform(0.0, 4.0, n),
    )


@pytest.mark.parametrize("name", ["lite", "lite_neck"])
@pytest.mark.parametrize("strength", [0.02, 3.0])
def test_both_forms_agree_step_for_step(name, strength):
    """To 1e-9 per physics step from the same state, over commands that saturate and commands that do not."""
    robot = load_robot(name)
    reference = make_plant(robot, actuation="qfrc_applied")
    affine = make_plant(robot, actuation="affine")
    generator = np.random.default_rng(1)
    saturated = 0
    for _ in range(40):
        command = random_command(robot, generator, strength)
        reference.apply(command)
        affine.apply(command)
        for _ in range(10):
            reference.step(1)
            affine.step(1)
            np.testing.assert_allclose(affine.effort, reference.effort, rtol=0, atol=1e-9)
            np.testing.assert_allclose(affine.data.qpos, reference.data.qpos, rtol=0, atol=1e-9)
            np.testing.assert_allclose(affine.data.qvel, reference.data.qvel, rtol=0, atol=1e-9)
            saturated += int((np.abs(reference.effort) == robot.effort_limit).sum())
            affine.data.qpos[:], affine.data.qvel[:] = reference.data.qpos, reference.data.qvel
            affine.data.qacc_warmstart[:] = reference.data.qacc_warmstart
    share = saturated / (400 * robot.joint_count)
    assert share > 0.3 if strength > 1.0 else share < 0.3
    assert not reference.fault()
    assert not affine.fault()


@pytest.mark.parametrize("actuation", ACTUATIONS)
@pytest.mark.parametrize("joints", [("shoulder", "elbow"), ("elbow", "shoulder")])
def test_the_torque_is_that_of_the_law(small_robot, actuation, joints):
    """Whatever the joints' order in the model."""
    robot = small_robot(joints=joints)
    plant = make_plant(robot, actuation=actuation)
    generator = np.random.default_rng(2)
    for _ in range(200):
        command = random_command(robot, generator)
        plant.apply(command)
        expected = mit_torque(command, plant.position, plant.velocity, robot.effort_limit)
        plant.step(1)
        if actuation == "qfrc_applied":
            assert plant.effort.tolist() == expected.tolist()
        else:
            np.testing.assert_allclose(plant.effort, expected, rtol=0, atol=1e-12)
        address = [plant.model.joint(name).dofadr[0] for name in joints]
        assert (plant.data.qfrc_applied + plant.data.qfrc_actuator)[address].tolist() == plant.effort.tolist()


@pytest.mark.parametrize("actuation", ACTUATIONS)
def test_effort_saturates_at_the_hardwares_limit_and_one_that_is_not_finite_is_a_fault(actuation):
    robot = load_robot("lite")
    plant = make_plant(robot, actuation=actuation)
    zeros = np.zeros(14)
    sign = np.where(np.arange(14) % 2 == 0, 1.0, -1.0)
    plant.apply(MITCommand(zeros, zeros, 1000.0 * sign, zeros, zeros))
    plant.step(1)
    assert plant.effort.tolist() == (sign * robot.effort_limit).tolist()
    assert robot.effort_limit[4] == 4.0
    assert plant.fault() == ""
    plant.apply(MITCommand(zeros, zeros, np.where(np.arange(14) == 3, np.nan, 0.0), zeros, zeros))
    plant.step(10)
    assert plant.fault().endswith(" is not finite, or huge")


@pytest.mark.parametrize("actuation", ACTUATIONS)
def test_damping_dissipates_energy(small_robot, actuation):
    robot = small_robot()
    plant = make_plant(robot, actuation=actuation)
    plant.model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    plant.data.qpos[:] = 1.0, -0.5
    plant.data.qvel[:] = 2.0, -3.0
    zeros = np.zeros(2)
    plant.apply(MITCommand(zeros, zeros, zeros, zeros, np.array([0.3, 0.2])))
    energy = []
    for _ in range(12000):
        plant.step(1)
        energy.append(float(plant.data.energy.sum()))  # at the start of the step
    assert (np.diff(energy) < 1e-6).all()
    assert energy[-1] < energy[0] - 1.0
    assert np.abs(plant.velocity).max() < 0.01


BAD_STATES = [
    ("qpos", np.nan, "position"),
    ("qvel", np.inf, "velocity"),
    ("qvel", 1e11, "velocity"),
    ("qfrc_applied", 1e30, "acceleration"),
]


@pytest.mark.parametrize(("array", "value", "quantity"), BAD_STATES)
def test_a_bad_state_is_a_fault_and_leaves_no_log(tmp_path, monkeypatch, capfd, array, value, quantity):
    monkeypatch.chdir(tmp_path)
    plant = make_plant(load_robot("lite"), actuation="affine")  # which leaves qfrc_applied alone
    getattr(plant.data, array)[3] = value
    plant.step(1)
    assert plant.fault() == f"simulation unstable: {quantity} is not finite, or huge"
    plant.step(10)
    assert plant.fault() == f"simulation unstable: {quantity} is not finite, or huge"
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []  # MuJoCo would write MUJOCO_LOG.TXT
    plant.reset()
    assert plant.fault() == ""


@pytest.mark.parametrize("actuation", ACTUATIONS)
@pytest.mark.parametrize("damping", ["", 'damping="0.4"'])
def test_the_acceleration_is_the_change_of_velocity(small_robot, actuation, damping):
    """MuJoCo's `qacc` leaves out what damping takes within the step, where that is implicit."""
    robot = small_robot()
    robot.mjcf_path.write_text(robot.mjcf_path.read_text().replace('name="elbow"', f'name="elbow" {damping}'))
    plant = make_plant(robot, actuation=actuation, physics_timestep=0.001)
    command = random_command(robot, np.random.default_rng(3), 0.2)
    plant.apply(command)
    plant.step(4)
    before = plant.velocity.copy()
    plant.step(1)
    change = (plant.velocity - before) / 0.001
    np.testing.assert_allclose(plant.acceleration, change, rtol=0, atol=1e-9)
    assert bool(np.abs(plant.data.qacc - change).max() > 0.1) is (bool(damping) or actuation == "implicit")
    plant.reset()
    assert plant.acceleration.tolist() == [0.0, 0.0]


def test_the_implicit_plant_takes_longer_steps_unless_told_otherwise():
    robot = load_robot("lite")
    implicit = make_plant(robot, actuation="implicit")
    assert implicit.model.opt.timestep == 0.0025
    assert implicit.model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert make_plant(robot, actuation="implicit", physics_timestep=0.005).model.opt.timestep == 0.005
    assert make_plant(robot, actuation="affine").model.opt.timestep == 0.0005
    slower = msgspec.structs.replace(
        robot, simulation=msgspec.structs.replace(robot.simulation, physics_timestep=0.005)
    )
    assert make_plant(slower, actuation="implicit").model.opt.timestep == 0.005


def test_damping_that_chatters_when_explicit_comes_to_rest_when_implicit():
    """The wrist of `test_stability`, at two and a half times the step at which it chatters for ever."""
    robot = load_robot("lite")
    plant = make_plant(robot, actuation="implicit")
    zeros = np.zeros(14)
    plant.apply(MITCommand(zeros, zeros, zeros, zeros, np.full(14, 5.0)))
    plant.data.qvel[4] = 0.5
    plant.step(400)
    assert not plant.fault()
    assert abs(float(plant.velocity[4])) < 0.01


def test_the_implicit_plant_comes_closer_to_the_others_as_its_steps_get_shorter():
    robot = load_robot("lite")
    command = random_command(robot, np.random.default_rng(4), 0.3)
    ends = {}
    for actuation, timestep in (("affine", 0.0000625), ("implicit", 0.0025), ("implicit", 0.00125)):
        plant = make_plant(robot, actuation=actuation, physics_timestep=timestep)
        plant.apply(command)
        plant.step(round(0.1 / timestep))
        ends[actuation, timestep] = plant.position.copy()
    true = ends["affine", 0.0000625]
    far = float(np.abs(ends["implicit", 0.0025] - true).max())
    near = float(np.abs(ends["implicit", 0.00125] - true).max())
    assert 1e-4 < far < 0.05
    assert 0.3 * far < near < 0.7 * far
