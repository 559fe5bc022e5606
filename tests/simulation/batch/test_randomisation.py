"""What differs between the environments of a batch."""

import mujoco
import numpy as np
import pytest

from humanoid_sim.controllers.rotation import rotate_inverse
from humanoid_sim.errors import InputError
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch import BatchSimulation, Randomisation

ROBOT, BIPED = load_robot("lite"), load_robot("lite_biped")
PERIOD = 0.02
VARIED = Randomisation(
    mass=(0.8, 1.2), friction=(0.5, 1.5), joint_friction=(0.5, 2.0), stiffness=(0.9, 1.1), command_delay=(0.0, 0.03)
)


def batch(count, randomisation, seeds=None, *, period=PERIOD):
    return BatchSimulation(ROBOT, count, control_period=period, threads=1, randomisation=randomisation, seeds=seeds)


def hold(count, position=0.2):
    shape = (count, ROBOT.joint_count)
    zeros = np.zeros(shape)
    return MITCommand(zeros + position, zeros, zeros, zeros + 50.0, zeros + 2.0)


def test_nothing_differs_unless_asked_for():
    plain = batch(3, Randomisation())
    assert plain.model(0) is plain.model(2)
    for _ in range(3):
        plain.step(hold(3))
    np.testing.assert_array_equal(plain.qpos[1:], plain.qpos[:1].repeat(2, axis=0))
    np.testing.assert_array_equal(plain.state().joint_position, plain.qpos)


def test_an_environment_is_the_same_in_any_batch_and_after_seeding_again():
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


def test_every_episode_is_drawn_anew_and_again_after_seeding():
    def figures(simulation):
        return [simulation.model(i).body_mass.sum() for i in range(simulation.count)]

    varied = batch(3, VARIED)
    first = figures(varied)
    varied.redraw([0, 2])
    second = figures(varied)
    assert second[1] == first[1]
    varied.redraw([0, 2])
    assert len({*first, *second, *figures(varied)}) == 7
    varied.reseed([0, 1, 2])
    assert figures(varied) == first
    varied.redraw([0, 2])
    assert figures(varied) == second


def test_payload_armature_and_centres_of_mass_are_in_the_models():
    options = Randomisation(payload=(1.0, 2.0), armature=(2.0, 3.0), centre_of_mass=0.02)
    for robot, carriers in ((ROBOT, ROBOT.hands), (BIPED, ("pelvis",))):
        varied = BatchSimulation(robot, 5, threads=1, randomisation=options)
        plain = BatchSimulation(robot, 1, threads=1)
        nominal = plain.model(0)
        ids = [nominal.body(name).id for name in carriers]
        others = np.setdiff1d(np.arange(nominal.nbody), ids)
        moves = [nominal.body(i).name for i in others if nominal.body_weldid[i] and nominal.body_mass[i]]
        for i in range(5):
            model = varied.model(i)
            load = model.body_mass - nominal.body_mass
            assert ((load[ids] > 1.0) & (load[ids] < 2.0)).all()
            np.testing.assert_array_equal(load[others], 0.0)
            dof = [model.joint(name).dofadr[0] for name in robot.joint_names]
            factor = model.dof_armature[dof] / nominal.dof_armature[dof]
            assert ((factor > 2.0) & (factor < 3.0)).all()
            np.testing.assert_allclose(model.body_subtreemass[0], model.body_mass.sum())
            shift = np.abs(model.body_ipos - nominal.body_ipos)
            assert 0.01 < shift.max() < 0.02
            data = mujoco.MjData(model)
            mujoco.mj_forward(model, data)
            for name in moves:
                felt = data.body(name).xmat.reshape(3, 3).T @ (data.body(name).xipos - data.body(name).xpos)
                np.testing.assert_allclose(felt, model.body(name).ipos, rtol=0, atol=1e-12)


def test_a_heavier_hand_hangs_lower():
    simulations = [batch(1, Randomisation(payload=(load, load))) for load in (0.0, 0.5)]
    heights = []
    for simulation in simulations:
        for _ in range(50):
            simulation.step(hold(1, 0.0))
        data = mujoco.MjData(simulation.model(0))
        data.qpos[:] = simulation.qpos[0]
        mujoco.mj_kinematics(simulation.model(0), data)
        heights.append([data.body(name).xpos[2] for name in ROBOT.hands])
    assert (np.array(heights[1]) < np.array(heights[0]) - 0.005).all()


def test_a_weak_motor_gives_a_share_of_its_torque_and_of_its_limit():
    weak = batch(1, Randomisation(motor_strength=(0.25, 0.25)))
    limited = batch(1, Randomisation(effort_limit=(0.25, 0.25)))
    plain = batch(1, Randomisation())
    far, near = hold(1, 1.5), hold(1, 0.01)
    for simulation in (weak, limited, plain):
        simulation.step(far)
    limit = ROBOT.effort_limit
    step = batch(1, Randomisation(), period=0.0005)
    step.step(near)
    small = batch(1, Randomisation(motor_strength=(0.25, 0.25)), period=0.0005)
    small.step(near)
    np.testing.assert_allclose(small.effort, 0.25 * step.effort, rtol=1e-12)
    assert np.abs(step.effort).max() > 0.1
    for simulation in (weak, limited):
        model = simulation.model(0)
        np.testing.assert_allclose(model.actuator_forcerange[:, 1], 0.25 * limit)
        assert (np.abs(simulation.effort[0]) <= 0.25 * limit).all()
        assert (np.abs(simulation.effort[0]) == 0.25 * limit).any()
    assert (np.abs(plain.effort[0]) > 0.25 * limit).any()


def test_an_encoder_that_is_off_moves_the_motor_as_well():
    off = batch(1, Randomisation(joint_position_bias=0.05))
    plain = batch(1, Randomisation())
    bias = off.state().joint_position - off.truth().joint_position
    assert 0.03 < np.abs(bias).max() < 0.05
    command = hold(1)
    aimed = MITCommand(command.position - bias, *(getattr(command, f) for f in COMMAND_FIELDS[1:]))
    for _ in range(3):
        off.step(command)
        plain.step(aimed)
        np.testing.assert_allclose(off.qpos, plain.qpos, rtol=0, atol=1e-12)
        np.testing.assert_allclose(off.state().joint_position, off.qpos + bias, rtol=0, atol=1e-12)


def test_an_imu_that_is_off_stays_off_by_the_same():
    biases = Randomisation(orientation_bias=0.05, angular_velocity_bias=0.1, linear_acceleration_bias=0.2)
    off = BatchSimulation(BIPED, 8, control_period=PERIOD, threads=1, randomisation=biases)
    errors = []
    for _ in range(2):
        true, seen = off.truth(), off.state()
        dot = np.abs((true.imu_quaternion * seen.imu_quaternion).sum(axis=1))
        angle = 2.0 * np.arccos(np.minimum(dot, 1.0))
        assert 0.01 < angle.max() < 0.05 * np.sqrt(3.0) + 1e-6
        # It feels gravity where it takes the vertical to be.
        felt = [
            np.linalg.norm(
                state.imu_linear_acceleration - rotate_inverse(state.imu_quaternion, np.array([0.0, 0.0, 9.81])), axis=1
            )
            for state in (true, seen)
        ]
        np.testing.assert_allclose(*felt, rtol=0, atol=0.2 * np.sqrt(3.0))
        errors.append(angle)
        off.step(MITCommand.zeros(8, 14))
    np.testing.assert_allclose(*errors, rtol=0, atol=1e-9)


@pytest.mark.parametrize("robot", [ROBOT, BIPED], ids=lambda robot: robot.name)
def test_gravity_that_is_tilted_is_felt_by_body_and_imu(robot):
    tilted = BatchSimulation(robot, 30, control_period=PERIOD, threads=1, randomisation=Randomisation(gravity_tilt=0.2))
    plain = BatchSimulation(robot, 1, control_period=PERIOD, threads=1)
    gravity = np.array([tilted.model(i).opt.gravity for i in range(30)])
    np.testing.assert_allclose(np.linalg.norm(gravity, axis=1), 9.81)
    angle = np.arccos(-gravity[:, 2] / 9.81)
    assert 0.15 < angle.max() < 0.2
    assert gravity[:, 0].max() > 0.1
    assert gravity[:, :2].min(axis=0).max() < -0.1
    true = plain.truth()
    felt = tilted.truth()
    for i in range(30):
        expected = rotate_inverse(true.imu_quaternion[0], gravity[i])
        found = rotate_inverse(felt.imu_quaternion[i], np.array([0.0, 0.0, -9.81]))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
        change = felt.imu_linear_acceleration[i] - true.imu_linear_acceleration[0]
        np.testing.assert_allclose(
            change, rotate_inverse(true.imu_quaternion[0], np.array([0.0, 0.0, -9.81]) - gravity[i]), rtol=0, atol=1e-9
        )


def test_pushes_speed_a_robot_up_by_what_was_drawn_once_in_every_interval():
    pushed = BatchSimulation(
        BIPED, 6, control_period=PERIOD, threads=1, randomisation=Randomisation(push=(0.2, 0.4), push_interval=0.5)
    )
    mass = pushed.model(0).body_subtreemass[0]
    forces = []
    for step in range(75):
        wrench = pushed._pushes.wrench(np.full(6, step))
        np.testing.assert_array_equal(wrench[:, 2:], 0.0)
        forces.append(wrench[:, :2])
    impulse = np.array(forces).reshape(3, 25, 6, 2)
    speeds = np.linalg.norm(impulse.sum(axis=1) * PERIOD / mass, axis=-1)
    assert ((speeds > 0.2) & (speeds < 0.4)).all()
    assert len(np.unique(speeds)) == 18
    assert ((np.linalg.norm(impulse, axis=-1) > 0.0).sum(axis=1) == 5).all()
    assert len({tuple(np.argmax(stretch.any(axis=-1), axis=0).tolist()) for stretch in impulse}) == 3
    still = BatchSimulation(BIPED, 6, control_period=PERIOD, threads=1)
    for simulation in (pushed, still):
        for _ in range(25):
            simulation.step(MITCommand.zeros(6, 14))
    assert np.abs(pushed.base.linear_velocity - still.base.linear_velocity)[:, :2].max() > 0.1


def test_factors_on_gains_are_the_motors():
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


def test_noise_is_seen_and_not_felt():
    step = 0.0005  # as little physics as there can be
    quiet = batch(200, Randomisation(), period=step)
    deviations = {
        "joint_position": 0.01,
        "joint_velocity": 0.1,
        "imu_angular_velocity": 0.3,
        "imu_linear_acceleration": 0.5,
    }
    noises = {f"{name.removeprefix('imu_')}_noise": deviation for name, deviation in deviations.items()}
    noisy = batch(200, Randomisation(orientation_noise=0.02, **noises), period=step)
    reports = []
    for _ in range(2):
        quiet.step(hold(200))
        noisy.step(hold(200))
        np.testing.assert_array_equal(quiet.qpos, noisy.qpos)
        true, seen = quiet.state(), noisy.state()
        np.testing.assert_array_equal(true.joint_effort, seen.joint_effort)
        for name, deviation in deviations.items():
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
        ({"state_delay": (0.0, 1.5)}, r"randomisation: state_delay is \(0.0, 1.5\), expected at most 1 s"),
        ({"gravity_tilt": 0.6}, "randomisation: gravity_tilt is 0.6, expected at most 0.5 rad"),
        ({"push_interval": 0.1}, "randomisation: push_interval is 0.1, expected at least 0.2 s"),
        ({"payload": 1.0}, "randomisation: payload is 1.0, expected two finite numbers"),
    ],
)
def test_a_bad_value_is_named(options, message):
    with pytest.raises(InputError, match=message):
        Randomisation(**options)
