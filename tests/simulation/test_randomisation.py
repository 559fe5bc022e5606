"""Robots that differ: each draw is its generator's alone, within its range, and changes what it says."""

import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.randomisation import Randomisation
from humanoid_sim.simulation.sim_robot import SimRobot

LITE, BIPED = load_robot("lite"), load_robot("lite_biped")
RANGES = {
    "mass": (0.5, 2.0),
    "friction": (0.2, 0.4),
    "effort": (0.5, 0.6),
    "armature": (2.0, 3.0),
    "gains": (0.8, 1.2),
    "delay": (0.001, 0.02),
}


def drawn(robot=LITE, seed=0, **ranges):
    model = build_model(robot, affine_actuators=True, scene="floor")
    return model, Randomisation(**ranges).draw(np.random.default_rng(seed), model, robot.joint_count)


def test_the_model_has_what_was_drawn():
    nominal, variation = drawn(BIPED, centre_of_mass=0.02, **RANGES)
    robot, batch = SimRobot(BIPED), BatchSim(BIPED, 1, randomisation=Randomisation(centre_of_mass=0.02, **RANGES))
    robot.vary(Randomisation(centre_of_mass=0.02, **RANGES), np.random.default_rng(0))
    for model in (robot.model, batch.model(0)):
        np.testing.assert_allclose(model.body_mass, nominal.body_mass * variation.mass)
        np.testing.assert_allclose(model.body_inertia, nominal.body_inertia * variation.mass[:, None])
        np.testing.assert_allclose(model.geom_friction, nominal.geom_friction * variation.friction)
        np.testing.assert_allclose(model.dof_armature[6:], nominal.dof_armature[6:] * variation.armature)
        np.testing.assert_array_equal(model.dof_armature[:6], nominal.dof_armature[:6])
        shifted = model.body_ipos - nominal.body_ipos
        assert shifted[1:].any(axis=1).sum() == BIPED.joint_count + 1
        np.testing.assert_allclose(shifted[shifted != 0.0], variation.centre_of_mass[shifted != 0.0])
        assert model.body_subtreemass[1] == pytest.approx((nominal.body_mass * variation.mass)[1:].sum())
    effort = nominal.actuator_forcerange * variation.effort[:, None]
    np.testing.assert_allclose(batch.model(0).actuator_forcerange, effort)


def test_a_shifted_centre_of_mass_acts():
    """The mass matrix holds the energy of the bodies' motion."""
    robot = SimRobot(LITE)
    robot.vary(Randomisation(centre_of_mass=0.05), np.random.default_rng(1))
    robot.reset(np.full(14, 0.3), np.ones(14))
    model, data = robot.model, robot.data
    mass, moving, turning, energy = np.empty((14, 14)), np.empty((3, 14)), np.empty((3, 14)), 0.0
    mujoco.mj_fullM(model, data, mass)
    for body in range(1, model.nbody):
        mujoco.mj_jacBodyCom(model, data, moving, turning, body)
        spin = data.ximat[body].reshape(3, 3).T @ turning @ data.qvel
        energy += 0.5 * model.body_mass[body] * float((moving @ data.qvel) @ (moving @ data.qvel))
        energy += 0.5 * float(spin @ (model.body_inertia[body] * spin))
    armature = 0.5 * float(model.dof_armature.sum())
    assert 0.5 * float(data.qvel @ mass @ data.qvel) == pytest.approx(energy + armature, rel=1e-12)


def test_pushes_come_once_in_each_stretch():
    ranges = Randomisation(push=(0.2, 0.4), push_interval=0.5)
    batch, still = BatchSim(BIPED, 4, randomisation=ranges), BatchSim(BIPED, 4)
    zeros = np.zeros((4, 14))
    stand = MITCommand(zeros + np.array(BIPED.initial_position), zeros, zeros, zeros + 80.0, zeros + 2.0)
    speeds = []
    for _ in range(100):  # 0.5 s
        batch.step(stand)
        still.step(stand)
        speeds.append(np.linalg.norm((batch.qvel - still.qvel)[:, :2], axis=1))
    found = np.array(speeds)
    assert (found.max(axis=0) > 0.1).all()
    begins = (found > 1e-9).argmax(axis=0)
    assert len(set(begins.tolist())) > 1
    with pytest.raises(InputError, match="'lite' has a fixed base, which no push moves"):
        BatchSim(LITE, 1, randomisation=ranges)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mas": (1, 2)}, "unknown field 'mas'"),
        ({"mass": (2.0, 1.0)}, r"mass is \(2.0, 1.0\), expected the least and the greatest"),
        ({"mass": 1.0}, r"mass: is 1.0, expected a list"),
        ({"encoder_offset": -0.1}, r"encoder_offset: is -0.1, expected `float` >= 0.0"),
        ({"delay": (0.0, 60.0)}, r"is 60.0, expected `float` <= 1.0"),
        ({"push_interval": 0.1}, r"is 0.1, expected `float` >= 0.2"),
    ],
)
def test_what_is_no_range_is_refused(values, message):
    with pytest.raises(InputError, match=f"^randomisation: .*{message}"):
        Randomisation.of(values)
