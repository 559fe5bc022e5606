from itertools import product

import numpy as np
import pytest

from humanoid_sim.messages import SafetyLevel
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.simulation.plant import make_plant

STEPS = 5
"""Physics steps per control period of the small robot: 1 ms in 5 ms."""


def commands(count, n=2):
    generator = np.random.default_rng(7)
    return [
        MITCommand(
            generator.uniform(-1, 1, n), np.zeros(n), generator.normal(0, 1, n), np.full(n, 20.0), np.full(n, 0.5)
        )
        for _ in range(count)
    ]


def values(state):
    return state.joint_position.tolist(), state.joint_velocity.tolist(), state.joint_effort.tolist()


def test_starts_at_the_initial_position():
    description = load_robot("lite")
    robot = MujocoRobot(description)
    state, safety = robot.read()
    assert state.time == 0.0
    assert state.joint_position.tolist() == list(description.initial_position)
    assert not state.joint_velocity.any()
    assert not state.joint_effort.any()
    assert not state.joint_age.any()
    assert state.imu_quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert state.imu_angular_velocity.tolist() == [0.0, 0.0, 0.0]
    assert state.imu_linear_acceleration.tolist() == [0.0, 0.0, 9.81]
    assert [(status.source, status.is_ok) for status in safety] == [("mujoco", True)]


def oracle(robot, sent, command_steps, state_steps, sampling):
    """What every read must give, from a plant stepped one physics step at a time: the step sampled, and its values."""
    plant = make_plant(robot)
    arrivals = {k * STEPS + command_steps: command for k, command in enumerate(sent)}
    history = []
    for step in range(len(sent) * STEPS + 1):
        history.append((plant.position.tolist(), plant.velocity.tolist(), plant.effort.tolist()))
        if step in arrivals:
            plant.apply(arrivals[step])
        plant.step(1)
    expected = []
    for tick in range(1, len(sent) + 1):
        now = tick * STEPS
        candidates = arrivals if sampling == "on_command" else range(now + 1)
        # A command that arrives exactly at the end of a period is dealt with at the start of the next one.
        seen = [s for s in candidates if s + state_steps <= now and (sampling == "now" or s < now)]
        sampled = max(seen, default=0)
        expected.append((sampled, history[sampled]))
    return expected


@pytest.mark.parametrize("sampling", ["now", "on_command"])
@pytest.mark.parametrize(("command_steps", "state_steps"), list(product([0, 2, 4, 5, 12], [0, 1, 3, 5, 11])))
def test_delays_and_sampling_are_exact(small_robot, command_steps, state_steps, sampling):
    description = small_robot()
    sent = commands(12)
    robot = MujocoRobot(
        description, command_delay=command_steps * 1e-3, state_delay=state_steps * 1e-3, state_sampling=sampling
    )
    expected = oracle(description, sent, command_steps, state_steps, sampling)
    for tick, (command, (sampled, sample)) in enumerate(zip(sent, expected, strict=True), start=1):
        robot.write(command)
        state, _ = robot.read()
        assert values(state) == sample
        assert state.time == pytest.approx(tick * 0.005, abs=1e-12)
        assert state.joint_age == pytest.approx(tick * 0.005 - sampled * 0.001, abs=1e-12)


@pytest.mark.parametrize("actuation", ["qfrc_applied", "affine"])
def test_the_same_commands_give_the_same_bits(actuation):
    description = load_robot("lite")
    runs = []
    for _ in range(2):
        robot = MujocoRobot(description, actuation=actuation, command_delay=0.001, state_delay=0.002)
        run = []
        for command in commands(40, 14):
            robot.write(command)
            state, _ = robot.read()
            run.append([array.tobytes() for array in (state.joint_position, state.joint_velocity, state.joint_effort)])
        runs.append(run)
    assert runs[0] == runs[1]


def test_a_second_activation_repeats_the_first_run_at_a_later_time(small_robot):
    robot = MujocoRobot(small_robot(), command_delay=0.007, state_delay=0.003)
    runs = []
    for _ in range(2):
        robot.activate()
        start = robot.time
        run = [values(robot.read()[0])]
        for command in commands(10):
            robot.write(command)
            run.append(values(robot.read()[0]))
        runs.append((start, run))
    (first_start, first), (second_start, second) = runs
    assert (first_start, second_start) == (0.0, 0.05)
    assert first == second
    assert robot.data.time == pytest.approx(0.1, abs=1e-9)


def test_joint_effort_is_the_saturated_torque_and_reading_twice_gives_the_same_state(small_robot):
    robot = MujocoRobot(small_robot())
    zeros = np.zeros(2)
    robot.write(MITCommand(zeros, zeros, np.array([100.0, -100.0]), zeros, zeros))
    assert robot.read()[0].joint_effort.tolist() == [5.0, -5.0]
    assert robot.read()[0] is robot.read()[0]


def test_an_unstable_simulation_is_critical_until_activation(small_robot):
    robot = MujocoRobot(small_robot())
    robot.write(commands(1)[0])
    robot.data.qvel[1] = np.nan
    for k in range(2, 5):
        robot.write(commands(1)[0])
        state, safety = robot.read()
        assert [(status.level, status.source) for status in safety] == [(SafetyLevel.CRITICAL, "mujoco")]
        assert safety[0].message == ("simulation unstable: velocity is not finite, or huge (t = 0.0100 s)")
        assert state.time == pytest.approx(k * 0.005, abs=1e-12)  # the clock goes on, physics does not
        assert np.isnan(state.joint_position).all()
    robot.activate()
    state, safety = robot.read()
    assert safety[0].is_ok
    assert state.joint_position.tolist() == [0.0, 0.0]
    robot.write(commands(1)[0])
    assert robot.read()[1][0].is_ok


def test_standby_reaches_its_pose_and_sags_little():
    """The description's own gains hold pose A against gravity."""
    description = load_robot("lite")
    robot = MujocoRobot(description)
    standby = description.standby_controller_a
    zeros = np.zeros(14)
    start, pose = np.array(description.initial_position), np.array(standby.pose_segments[1])
    for share in np.linspace(0.0, 1.0, 400):
        target = start + share * (pose - start)
        robot.write(MITCommand(target, zeros, zeros, np.array(standby.target_stiffness), description.damping))
    for _ in range(400):
        robot.write(MITCommand(pose, zeros, zeros, np.array(standby.target_stiffness), description.damping))
    state, safety = robot.read()
    assert safety[0].is_ok
    assert np.abs(state.joint_position - pose).max() < 0.05
    assert np.abs(state.joint_velocity).max() < 0.01
