"""The reference: one robot under the MIT law, its timing, its faults."""

import msgspec
import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.messages import SafetyLevel
from humanoid_sim.mit import MITCommand, mit_torque
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.schema import JointDynamics
from humanoid_sim.simulation.sim_robot import SimRobot

STEPS = 5  # physics steps per control period of the small robot: 1 ms in 5 ms


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


def test_it_starts_at_rest_in_the_initial_position():
    description = load_robot("lite")
    state, (status,) = SimRobot(description).read()
    assert state.time == 0.0
    assert state.joint_position.tolist() == list(description.initial_position)
    assert not state.joint_velocity.any()
    assert not state.joint_effort.any()
    assert state.imu_quaternion.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert state.imu_linear_acceleration.tolist() == [0.0, 0.0, 9.81]
    assert (status.source, status.is_ok) == ("mujoco", True)


def with_dynamics(robot, **dynamics):
    joints = (msgspec.structs.replace(joint, dynamics=JointDynamics(**dynamics)) for joint in robot.joints)
    return msgspec.structs.replace(robot, joints=tuple(joints))


def late(robot, steps):
    """A robot whose motors answer after so many physics steps of 1 ms."""
    return with_dynamics(robot, delay=1e-3 * steps)


@pytest.mark.parametrize(
    ("joints", "scale"), [(("shoulder", "elbow"), 1.0), (("elbow", "shoulder"), 1.0), (("shoulder", "elbow"), 0.5)]
)
def test_the_torque_is_that_of_the_law_whatever_the_joints_order(small_robot, joints, scale):
    description = small_robot(joints=joints, simulation={"physics_timestep": 0.001, "control_frequency": 1000})
    robot = SimRobot(with_dynamics(description, torque_scale=scale))
    for command in commands(50):
        state, _ = robot.read()
        expected = scale * mit_torque(command, state.joint_position, state.joint_velocity, description.effort_limit)
        robot.write(command)
        assert robot.read()[0].joint_effort.tolist() == expected.tolist()
        dofs = [robot.model.joint(name).dofadr[0] for name in joints]
        assert robot.data.qfrc_applied[dofs].tolist() == expected.tolist()
    zeros = np.zeros(2)
    robot.write(MITCommand(zeros, zeros, np.array([100.0, -100.0]), zeros, zeros))
    assert robot.read()[0].joint_effort.tolist() == [5.0 * scale, -5.0 * scale]
    assert robot.read()[0] is robot.read()[0]


@pytest.mark.parametrize("delay", [0, 2, 5, 12])
def test_a_command_arrives_as_late_as_its_motors_answer(small_robot, delay):
    """To the bit what plain MuJoCo does under the law, one physics step at a time."""
    description, sent = small_robot(), commands(12)
    robot = SimRobot(late(description, delay))
    data, command = mujoco.MjData(robot.model), MITCommand.zeros(2)
    mujoco.mj_forward(robot.model, data)
    arrivals = {k * STEPS + delay: command for k, command in enumerate(sent)}
    for tick, each in enumerate(sent, start=1):
        robot.write(each)
        for step in range((tick - 1) * STEPS, tick * STEPS):
            command = arrivals.get(step, command)
            torque = mit_torque(command, data.qpos, data.qvel, description.effort_limit)
            data.qfrc_applied[:] = torque
            mujoco.mj_step(robot.model, data)
        state = robot.state()
        assert values(state) == (data.qpos.tolist(), data.qvel.tolist(), torque.tolist())
        assert state.time == pytest.approx(tick * 0.005, abs=1e-12)


def test_a_second_activation_repeats_the_first_run_at_a_later_time_and_an_episode_at_time_0(small_robot):
    robot = SimRobot(late(small_robot(), 7))
    runs = []
    for begin in (robot.activate, robot.activate, robot.reset, robot.reset):
        begin()
        start, run = robot.time, [values(robot.state())]
        for command in commands(10):
            robot.write(command)
            run.append(values(robot.state()))
        runs.append((start, run))
    assert [start for start, _ in runs] == [0.0, 0.05, 0.0, 0.0]
    assert runs[0][1] == runs[1][1]
    assert runs[2][1] == runs[3][1]


def test_until_the_first_command_of_an_episode_arrives_the_start_is_held(small_robot):
    waiting, punctual = SimRobot(late(small_robot(), 5)), SimRobot(small_robot())
    command, start = commands(1)[0], np.array([0.1, -0.2])
    held = MITCommand(start, 0.0 * start, 0.0 * start, command.stiffness, command.damping)
    for robot in (waiting, punctual):
        robot.reset(start)
    for of_waiting, of_punctual in ((command, held), (command, command)):
        waiting.write(of_waiting)
        punctual.write(of_punctual)
        assert waiting.qpos.tolist() == punctual.qpos.tolist()


@pytest.mark.parametrize(("array", "value"), [("qpos", np.nan), ("qvel", 1e11), ("xfrc_applied", 1e30)])
def test_an_unstable_simulation_is_critical_until_activation(small_robot, tmp_path, monkeypatch, capfd, array, value):
    robot = SimRobot(small_robot())
    monkeypatch.chdir(tmp_path)
    files = set(tmp_path.iterdir())
    robot.write(commands(1)[0])
    getattr(robot.data, array)[-1] = value
    for k in range(2, 5):
        robot.write(commands(1)[0])
        state, (status,) = robot.read()
        assert (status.level, status.source) == (SafetyLevel.CRITICAL, "mujoco")
        assert status.message == "simulation unstable: its state is not finite, or huge (t = 0.0100 s)"
        assert state.time == pytest.approx(k * 0.005, abs=1e-12)  # the clock goes on, physics does not
    robot.activate()
    robot.write(commands(1)[0])
    assert robot.read()[1][0].is_ok
    assert capfd.readouterr() == ("", "")
    assert set(tmp_path.iterdir()) == files  # MuJoCo would write MUJOCO_LOG.TXT


def test_a_push_speeds_the_whole_robot_up():
    robot = SimRobot(load_robot("lite_biped"))
    robot.reset(np.r_[0.0, 0.0, 5.0, robot.qpos[3:]])  # high above the floor, where nothing else pushes it
    for tick in range(32):
        if tick == 10:
            robot.push(0.5, -0.25)
        robot.write(MITCommand.zeros(14))
    mujoco.mj_subtreeVel(robot.model, robot.data)
    assert np.allclose(robot.data.subtree_linvel[0][:2], [0.5, -0.25], atol=1e-3)
    assert not robot.data.xfrc_applied.any()
    robot.push(0.5, 0.0)
    robot.activate()
    robot.write(MITCommand.zeros(14))
    assert not robot.data.xfrc_applied.any()


def test_a_robot_whose_base_is_fixed_is_pushed_at_a_body():
    robot = SimRobot(load_robot("lite"))
    body = robot.model.body(robot.pushable[3])
    for speed, name, message in ((1.0, "", "unknown body ''"), (11.0, body.name, "within ±10")):
        with pytest.raises(InputError, match=message):
            robot.push(0.0, speed, name)
    robot.push(0.0, 1.0, body.name)
    robot.write(MITCommand.zeros(14))
    assert robot.data.xfrc_applied[body.id][1] == pytest.approx(body.subtreemass[0] / 0.1)
