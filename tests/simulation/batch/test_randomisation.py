"""What differs between the environments of a batch."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch import BatchSimulation, Randomisation

ROBOT = load_robot("lite")
PERIOD = 0.02
VARIED = Randomisation(
    mass=(0.8, 1.2), friction=(0.5, 1.5), joint_friction=(0.5, 2.0), stiffness=(0.9, 1.1), command_delay=(0.0, 0.03)
)


def batch(count: int, randomisation: Randomisation, seeds: Any = None, *, period: float = PERIOD) -> BatchSimulation:
    return BatchSimulation(ROBOT, count, control_period=period, threads=1, randomisation=randomisation, seeds=seeds)


def hold(count: int, position: float = 0.2) -> MITCommand:
    shape = (count, ROBOT.joint_count)
    zeros = np.zeros(shape)
    return MITCommand(zeros + position, zeros, zeros, zeros + 50.0, zeros + 2.0)


def test_nothing_differs_unless_asked_for() -> None:
    plain = batch(3, Randomisation())
    assert plain.model(0) is plain.model(2)
    for _ in range(3):
        plain.step(hold(3))
    np.testing.assert_array_equal(plain.qpos[1:], plain.qpos[:1].repeat(2, axis=0))
    np.testing.assert_array_equal(plain.state().joint_position, plain.qpos)
    plain.close()


def test_models_are_copied_once_and_keep_their_ranges() -> None:
    varied = batch(6, VARIED)
    models = [varied.model(i) for i in range(6)]
    assert len({id(model) for model in models}) == 6
    nominal = batch(1, Randomisation()).model(0)
    has_mass = nominal.body_mass > 0.0
    masses = np.array([model.body_mass[has_mass] / nominal.body_mass[has_mass] for model in models])
    inertias = np.array([model.body_inertia[has_mass] / nominal.body_inertia[has_mass] for model in models])
    np.testing.assert_allclose(inertias, masses[:, :, None].repeat(3, axis=2))
    losses = np.array([model.dof_frictionloss / nominal.dof_frictionloss for model in models])
    frictions = np.array([model.geom_friction / nominal.geom_friction for model in models])
    np.testing.assert_allclose(frictions, frictions[:, :1, :1].repeat(3, axis=2).repeat(nominal.ngeom, axis=1))
    for values, (low, high) in ((masses, (0.8, 1.2)), (losses, (0.5, 2.0)), (frictions[:, 0], (0.5, 1.5))):
        assert low <= values.min() < low + 0.3 * (high - low)
        assert high - 0.3 * (high - low) < values.max() <= high
        assert len({tuple(row) for row in values.tolist()}) == 6
    for _ in range(3):
        varied.step(hold(6))
    assert [varied.model(i) for i in range(6)] == models
    varied.close()


def test_derived_quantities_follow_the_masses() -> None:
    varied = batch(2, Randomisation(mass=(2.0, 2.0)))
    model = varied.model(1)
    data = mujoco.MjData(model)
    np.testing.assert_allclose(model.body_subtreemass[0], model.body_mass.sum())
    before = model.dof_invweight0.copy()
    mujoco.mj_setConst(model, data)
    np.testing.assert_array_equal(model.dof_invweight0, before)
    varied.close()


def test_an_environment_is_the_same_in_any_batch_and_after_seeding_again() -> None:
    several, alone = batch(4, VARIED, seeds=[3, 4, 5, 6]), batch(1, VARIED, seeds=5)
    again = batch(4, VARIED)
    again.step(hold(4))
    again.reseed([3, 4, 5, 6])
    for step in range(4):
        several.step(hold(4, 0.1 * step))
        again.step(hold(4, 0.1 * step))
        alone.step(hold(1, 0.1 * step))
        np.testing.assert_array_equal(several.qpos[2:3], alone.qpos)
        np.testing.assert_array_equal(several.qpos, again.qpos)
    assert len(np.unique(several.qpos[:, 0])) == 4
    for simulation in (several, alone, again):
        simulation.close()


def test_factors_on_gains_are_the_motors() -> None:
    weak = batch(1, Randomisation(stiffness=(0.5, 0.5), damping=(0.25, 0.25)))
    reference = batch(1, Randomisation())
    command = hold(1)
    halved = MITCommand(
        command.position, command.velocity, command.effort, 0.5 * command.stiffness, 0.25 * command.damping
    )
    for _ in range(3):
        weak.step(command)
        reference.step(halved)
    np.testing.assert_array_equal(weak.qpos, reference.qpos)
    np.testing.assert_array_equal(weak.effort, reference.effort)
    weak.close()
    reference.close()


def test_noise_is_seen_and_not_felt() -> None:
    step = 0.0005  # as little physics as there can be
    quiet = batch(200, Randomisation(), period=step)
    noisy = batch(
        200,
        Randomisation(
            joint_position_noise=0.01,
            joint_velocity_noise=0.1,
            orientation_noise=0.02,
            angular_velocity_noise=0.3,
            linear_acceleration_noise=0.5,
        ),
        period=step,
    )
    reports = []
    for _ in range(2):
        quiet.step(hold(200))
        noisy.step(hold(200))
        np.testing.assert_array_equal(quiet.qpos, noisy.qpos)
        true, seen = quiet.state(), noisy.state()
        np.testing.assert_array_equal(true.joint_effort, seen.joint_effort)
        for name, deviation in (
            ("joint_position", 0.01),
            ("joint_velocity", 0.1),
            ("imu_angular_velocity", 0.3),
            ("imu_linear_acceleration", 0.5),
        ):
            error = getattr(seen, name) - getattr(true, name)
            assert error.std() == pytest.approx(deviation, rel=0.1)
            assert error.mean() == pytest.approx(0.0, abs=0.1 * deviation)
        dot = np.abs((true.imu_quaternion * seen.imu_quaternion).sum(axis=1))
        angle = 2.0 * np.arccos(np.minimum(dot, 1.0))
        assert np.sqrt((angle * angle).mean() / 3.0) == pytest.approx(0.02, rel=0.1)
        np.testing.assert_allclose(np.linalg.norm(seen.imu_quaternion, axis=1), 1.0, rtol=0, atol=1e-12)
        reports.append(seen.joint_position - true.joint_position)
    assert noisy.state() is seen  # asked for twice, it is the same report
    assert abs(np.corrcoef(reports[0].ravel(), reports[1].ravel())[0, 1]) < 0.05
    quiet.close()
    noisy.close()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mass": (1.2, 0.8)}, r"randomisation: mass is \(1.2, 0.8\), expected two finite numbers >= 0, the least and"),
        ({"friction": 2.0}, "randomisation: friction is 2.0, expected two finite numbers"),
        ({"stiffness": (-1.0, 1.0)}, "randomisation: stiffness is"),
        ({"damping": (1.0, float("inf"))}, "randomisation: damping is"),
        ({"command_delay": (0.0, 0.1, 0.2)}, "randomisation: command_delay is"),
        ({"command_jitter": -0.1}, "randomisation: command_jitter is -0.1, expected a finite number >= 0"),
        ({"joint_position_noise": float("nan")}, "randomisation: joint_position_noise is nan"),
        ({"orientation_noise": True}, "randomisation: orientation_noise is True"),
    ],
)
def test_a_bad_value_is_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Randomisation(**options)


def test_jitter_is_in_whole_physics_steps() -> None:
    with pytest.raises(InputError, match=r"command_jitter: 0\.0007 s is not a multiple of the physics step"):
        batch(1, Randomisation(command_jitter=0.0007))


def test_ranges_of_lists_are_tuples() -> None:
    assert Randomisation(mass=[0.5, 1]).mass == (0.5, 1.0)  # type: ignore[arg-type]
