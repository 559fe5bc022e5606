"""A batch of robots against robots simulated one by one."""

import shutil

import mujoco
import numpy as np
import pytest

from humanoid_sim.assets import asset_path
from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.mit import ANCHOR_POSE, BASE_LINEAR_VELOCITY, COMMAND_FIELDS, MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch import BatchSimulation, Randomisation
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.simulation.push import Push, push_wrench

PERIOD = 0.02


def commands(robot, count, spread, seed=0):
    """Targets around the initial position, gains of the description, a little of everything else."""
    generator = np.random.default_rng(seed)
    shape = (count, robot.joint_count)
    return MITCommand(
        position=robot.initial_position + generator.uniform(-spread, spread, shape),
        velocity=generator.uniform(-0.1, 0.1, shape),
        effort=generator.uniform(-0.1, 0.1, shape),
        stiffness=np.broadcast_to(robot.stiffness, shape),
        damping=np.broadcast_to(robot.damping, shape),
    )


def batch_of(robot, count, **options):
    return BatchSimulation(robot, count, control_period=PERIOD, threads=1, **options)


def alone(robot, **options):
    return MujocoRobot(robot, control_period=PERIOD, actuation="affine", support=False, **options)


def row(command, i):
    return MITCommand(*(getattr(command, name)[i] for name in COMMAND_FIELDS))


def assert_reports(batch, i, alone, tolerance):
    joints = ("joint_position", "joint_velocity", "joint_effort", "joint_age")
    for name in (*joints, "imu_quaternion", "imu_angular_velocity"):
        np.testing.assert_allclose(getattr(batch, name)[i], getattr(alone, name), rtol=0, atol=tolerance, err_msg=name)
    # Accelerations are velocities divided by the timestep.
    np.testing.assert_allclose(
        batch.imu_linear_acceleration[i], alone.imu_linear_acceleration, rtol=0, atol=1e4 * tolerance
    )
    assert set(batch.extern) == set(alone.extern)
    for name, live in alone.extern.items():
        np.testing.assert_allclose(batch.extern[name].value[i], live.value, rtol=0, atol=tolerance)


@pytest.mark.parametrize(
    ("name", "anchor", "spread", "threads"), [("lite", "", 0.8, 2), ("lite_biped", "pelvis", 0.3, 1)]
)
def test_each_robot_moves_as_it_would_alone(name, anchor, spread, threads):
    robot = load_robot(name)
    count = 3
    batch = BatchSimulation(robot, count, control_period=PERIOD, anchor_body=anchor, threads=threads)
    singles = [alone(robot, anchor_body=anchor) for _ in range(count)]
    assert batch.extern == singles[0].extern
    for step in range(12):
        command = commands(robot, count, spread, seed=step)
        for i, single in enumerate(singles):
            assert_reports(batch.state(), i, single.read()[0], 1e-9)
            single.write(row(command, i))
        batch.step(command)
        np.testing.assert_allclose(batch.qpos, [single.qpos for single in singles], rtol=0, atol=1e-9)
    np.testing.assert_allclose(batch.state().time, 12 * PERIOD)
    assert batch.steps.tolist() == [12] * count
    assert not batch.fault.any()


def test_passive_damping_is_no_obstacle(tmp_path):
    """MuJoCo integrates it implicitly, so that the solver's start is known approximately only."""
    for folder in ("mjcf", "robots"):
        shutil.copytree(asset_path(folder), tmp_path / folder)
    style = tmp_path / "mjcf" / "lite_style.xml"
    damped = style.read_text().replace('frictionloss="0.1"/>', 'frictionloss="0.1" damping="0.5"/>')
    style.write_text(damped)
    robot = load_robot(tmp_path / "robots" / "lite_biped.yaml")
    batch = batch_of(robot, 1)
    assert batch.model(0).dof_damping.max() == 0.5
    single = alone(robot)
    for step in range(15):
        command = commands(robot, 1, 0.3, seed=step)
        batch.step(command)
        single.write(row(command, 0))
        np.testing.assert_allclose(batch.qpos[0], single.qpos, rtol=0, atol=1e-9)


def test_gains_may_differ_between_robots_and_change():
    robot = load_robot("lite")
    batch = batch_of(robot, 2)
    singles = [alone(robot) for _ in range(2)]
    for step, factors in enumerate([(1.0, 1.0), (0.5, 0.8), (0.5, 0.2), (1.0, 1.0)]):
        plain = commands(robot, 2, 0.5, seed=step)
        stiffness = plain.stiffness * np.array(factors)[:, None]
        command = MITCommand(plain.position, plain.velocity, plain.effort, stiffness, plain.damping)
        batch.step(command)
        for i, single in enumerate(singles):
            single.write(row(command, i))
            assert_reports(batch.state(), i, single.read()[0], 1e-9)


@pytest.mark.parametrize("delay", [0.0005, 0.013, 0.02, 0.0475])
def test_a_late_command_is_as_late_as_on_one_robot(delay):
    robot = load_robot("lite")
    batch = batch_of(robot, 2, randomisation=Randomisation(command_delay=(delay, delay)))
    single = alone(robot, command_delay=delay)
    # Gains do not arrive late in the batch, and one robot has none before its first command: effort alone shows when
    # a command takes effect.
    none = np.zeros((2, robot.joint_count))
    for step in range(8):
        command = MITCommand(none, none, 20.0 * commands(robot, 2, 0.5, seed=step).effort, none, none)
        batch.step(command)
        single.write(row(command, 1))
        assert_reports(batch.state(), 1, single.read()[0], 1e-9)


@pytest.mark.parametrize(("name", "delay"), [("lite", 0.0005), ("lite", 0.02), ("lite_biped", 0.0275)])
def test_a_late_report_is_as_late_as_on_one_robot(name, delay):
    robot, late = load_robot(name), Randomisation(state_delay=(delay, delay))
    anchor = "pelvis" if name == "lite_biped" else ""
    batch = batch_of(robot, 2, randomisation=late, anchor_body=anchor)
    single = alone(robot, state_delay=delay, anchor_body=anchor)
    for step in range(6):
        assert_reports(batch.state(), 1, single.read()[0], 1e-9)
        command = commands(robot, 2, 0.2, seed=step)
        batch.step(command)
        single.write(row(command, 1))
    assert np.abs(batch.state().joint_position - batch.truth().joint_position).max() > 1e-5
    assert np.abs(batch.state().joint_effort - batch.truth().joint_effort).max() > 1e-3
    batch.reset()
    batch.step(commands(robot, 2, 0.2))
    if delay >= PERIOD:
        np.testing.assert_array_equal(batch.state().joint_effort, 0.0)


def test_until_the_first_command_arrives_the_start_is_held():
    robot = load_robot("lite")
    late = batch_of(robot, 1, randomisation=Randomisation(command_delay=(PERIOD, PERIOD)))
    punctual = batch_of(robot, 1)
    start = np.full((1, robot.joint_count), 0.1)
    late.reset(joint_position=start)
    punctual.reset(joint_position=start)
    command = commands(robot, 1, 0.5)
    held = MITCommand(start, 0.0 * start, 0.0 * start, command.stiffness, command.damping)
    late.step(command)
    punctual.step(held)
    np.testing.assert_allclose(late.qpos, punctual.qpos, rtol=0, atol=1e-12)
    late.step(held)
    punctual.step(command)
    np.testing.assert_allclose(late.qpos, punctual.qpos, rtol=0, atol=1e-12)


def test_robots_outside_the_choice_stand_still_and_miss_nothing():
    robot = load_robot("lite_biped")
    delayed = Randomisation(command_delay=(0.03, 0.03))
    both = batch_of(robot, 2, randomisation=delayed)
    one = batch_of(robot, 1, randomisation=delayed)
    for step in range(6):
        command = commands(robot, 2, 0.2, seed=step)
        is_second = step % 2 == 1
        before = both.qpos[0].copy()
        both.step(command, where=np.array([not is_second, True]))
        if is_second:
            np.testing.assert_array_equal(both.qpos[0], before)
        else:
            one.step(MITCommand(*(getattr(command, name)[:1] for name in COMMAND_FIELDS)))
        np.testing.assert_allclose(both.qpos[0], one.qpos[0], rtol=0, atol=1e-9)
    assert both.steps.tolist() == [3, 6]


def test_a_broken_simulation_stands_still_and_disturbs_nobody(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)  # where MuJoCo would leave its MUJOCO_LOG.TXT
    robot = load_robot("lite")
    batch = BatchSimulation(robot, 4, control_period=PERIOD, threads=2)
    lone = batch_of(robot, 1)
    start = np.zeros((1, robot.joint_count))
    start_velocity = np.array([1e12] * robot.joint_count)
    batch.reset([1], joint_position=start, joint_velocity=start_velocity)
    for step in range(3):
        command = commands(robot, 4, 0.5, seed=step)
        position = command.position.copy()
        position[2, 3] = np.nan if step == 1 else position[2, 3]
        before = batch.qpos.copy()
        batch.step(MITCommand(position, *(getattr(command, name) for name in COMMAND_FIELDS[1:])))
        lone.step(MITCommand(*(getattr(command, name)[:1] for name in COMMAND_FIELDS)))
        assert batch.fault.tolist() == [False, True, step >= 1, False]
        np.testing.assert_array_equal(batch.qpos[1], before[1])
        np.testing.assert_allclose(batch.qpos[0], lone.qpos[0], rtol=0, atol=1e-9)
        assert np.isfinite(batch.qpos).all()
    assert batch.steps.tolist() == [3, 0, 1, 3]
    batch.reset([1, 2])
    batch.step(commands(robot, 4, 0.5))
    assert not batch.fault.any()
    assert batch.steps.tolist() == [4, 1, 1, 4]
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []


def test_starts():
    robot = load_robot("lite_biped")
    batch = batch_of(robot, 3)
    turned = MujocoRobot(robot, support=False, base_yaw=0.7)
    joints = np.linspace(0.0, 0.2, robot.joint_count)
    batch.reset(
        [2], joint_position=joints[None], joint_velocity=np.ones((1, robot.joint_count)), base_yaw=np.array([0.7])
    )
    np.testing.assert_allclose(batch.qpos[2, :7], turned.qpos[:7], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(batch.state().joint_position[2], joints)
    np.testing.assert_array_equal(batch.qvel[2], [0.0] * 6 + [1.0] * robot.joint_count)
    qpos, qvel = np.arange(21.0), np.arange(20.0)
    batch.reset([0], qpos=qpos[None], qvel=qvel[None])
    np.testing.assert_array_equal(batch.qpos[0], qpos)
    np.testing.assert_array_equal(batch.state().extern[BASE_LINEAR_VELOCITY].value[0], qvel[:3])
    np.testing.assert_array_equal(batch.state().joint_position[1], robot.initial_position)


def test_a_push_moves_what_it_pushes():
    robot = load_robot("lite_biped")
    batch = batch_of(robot, 3)
    foot = batch_of(robot, 1, push_body="left_foot")
    still = commands(robot, 1, 0.0)
    command = MITCommand(*(getattr(still, name).repeat(3, axis=0) for name in COMMAND_FIELDS))
    wrench = np.zeros((3, 6))
    wrench[1, 1] = 50.0
    batch.step(command, wrench=wrench)
    velocity = batch.qvel[:, 1]
    # The pelvis moves at least as fast as the momentum of the whole robot says.
    assert velocity[1] - velocity[0] > 50.0 * PERIOD / batch.model(0).body_mass.sum()
    np.testing.assert_array_equal(batch.qvel[2], batch.qvel[0])
    foot.step(still, wrench=wrench[1:2])
    assert not np.allclose(foot.qvel[0], batch.qvel[1], atol=1e-3)


def test_a_change_of_velocity_moves_the_whole_robot_at_once():
    robot = load_robot("lite_biped")
    batch = batch_of(robot, 2)
    batch.reset()
    qvel = batch.qvel.copy()
    batch.speed_up(np.array([[0.0, 0.0, 0.0], [0.4, -0.1, 0.0]]))
    np.testing.assert_array_equal(batch.qvel[0], qvel[0])
    np.testing.assert_allclose(batch.qvel[1, :3] - qvel[1, :3], [0.4, -0.1, 0.0], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(batch.qvel[1, 3:], qvel[1, 3:])
    np.testing.assert_allclose(
        batch.base.linear_velocity[1] - batch.base.linear_velocity[0], [0.4, -0.1, 0.0], atol=1e-15
    )
    batch.step(commands(robot, 2, 0.0))
    assert batch.qpos[1, 0] - batch.qpos[0, 0] > 0.005
    fixed = batch_of(load_robot("lite"), 1)
    with pytest.raises(RobotError, match="has a fixed base, whose velocity does not change"):
        fixed.speed_up(np.zeros((1, 3)))


@pytest.mark.parametrize("actuation", ["affine", "implicit"])
def test_a_push_on_the_base_does_what_it_does_in_play(actuation):
    robot = load_robot("lite_biped")
    velocities = np.array([[0.4, 0.0], [-0.1, 0.3], [0.0, 0.0]])
    batch = BatchSimulation(robot, 3, control_period=PERIOD, actuation=actuation, threads=1)
    singles = [
        MujocoRobot(robot, control_period=PERIOD, actuation=actuation, support=False, pushes=[Push(*velocity, 0.04)])
        for velocity in velocities.tolist()
    ]
    wrench = push_wrench(velocities, float(batch.model(0).body_mass.sum()))
    assert wrench[0].tolist() == pytest.approx([45.92, 0.0, 0.0, 0.0, 0.0, 0.0])  # 11.48 kg
    still = commands(robot, 3, 0.0)
    for step in range(12):
        batch.step(still, wrench=wrench if 2 <= step < 7 else None)  # 0.1 s
        for i, single in enumerate(singles):
            single.write(row(still, i))
        np.testing.assert_allclose(batch.qpos, [single.qpos for single in singles], rtol=0, atol=1e-9)
    # It turns the robot as well: the pelvis is above the centre of mass.
    assert batch.qvel[0, 0] > 0.4
    assert batch.qvel[0, 4] > 0.05


def test_body_poses_in_world_and_base():
    lite = load_robot("lite")
    kinematics = ForwardKinematics(lite)
    batch = BatchSimulation(lite, 4, bodies=kinematics.bodies, threads=1)
    q = np.random.default_rng(0).uniform(-0.5, 0.5, (4, 14))
    batch.reset(joint_position=q)
    position, quaternion = batch.body_poses(in_base=True)
    expected, rotation = kinematics(q)
    np.testing.assert_allclose(position, expected, rtol=0, atol=1e-12)
    matrix = np.empty(9)
    for i in range(4):
        for b in range(2):
            mujoco.mju_quat2Mat(matrix, quaternion[i, b])
            np.testing.assert_allclose(matrix.reshape(3, 3), rotation[i, b], rtol=0, atol=1e-12)

    biped = load_robot("lite_biped")
    walker = BatchSimulation(biped, 2, bodies=("left_foot", "pelvis"), anchor_body="left_foot", threads=1)
    walker.reset(base_yaw=np.array([0.0, 1.5]))
    feet, _ = walker.body_poses()
    in_base, turns = walker.body_poses(in_base=True)
    np.testing.assert_allclose(feet[:, 1], walker.qpos[:, :3], rtol=0, atol=1e-15)
    np.testing.assert_allclose(in_base[:, 1], 0.0, atol=1e-15)
    np.testing.assert_allclose(turns[:, 1], [[1.0, 0.0, 0.0, 0.0]] * 2, rtol=0, atol=1e-15)
    np.testing.assert_allclose(in_base[0, 0], in_base[1, 0], rtol=0, atol=1e-12)  # the heading does not show
    assert np.abs(feet[0, 0] - feet[1, 0]).max() > 0.05
    np.testing.assert_array_equal(walker.state().extern[ANCHOR_POSE].value[:, :3], feet[:, 0])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"count": 0}, "count: is 0, expected a whole number >= 1"),
        ({"threads": 0}, "threads: is 0, expected a whole number >= 1"),
        ({"physics_timestep": 0.003}, "physics_timestep: 0.003 s does not divide"),
        ({"anchor_body": "nose"}, "anchor body: unknown body 'nose'"),
        ({"bodies": ("nose",)}, "unknown body 'nose'"),
        ({"push_body": "nose"}, "unknown body 'nose'"),
    ],
)
def test_bad_options_are_named(options, message):
    with pytest.raises(InputError, match=message):
        BatchSimulation(load_robot("lite"), **{"count": 1, **options})


def test_wrong_commands_writing_and_a_closed_simulation_are_refused():
    batch = BatchSimulation(load_robot("lite"), 2, threads=2)
    for array in (batch.qpos, batch.qvel, batch.effort, batch.steps, batch.fault):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 1
    with pytest.raises(RobotError, match=r"lite: command has shape \(14,\), expected \(2, 14\)"):
        batch.step(MITCommand.zeros(14))
    for _ in range(2):  # every robot may be broken at once
        batch.step(MITCommand(*[np.full((2, 14), np.nan)] * 5))
    assert batch.fault.all()
    assert batch.steps.tolist() == [0, 0]
    batch.close()
    batch.close()
    with pytest.raises(RobotError, match="closed"):
        batch.step(MITCommand.zeros(2, 14))
