"""Many robots at once: each does what the reference, one `SimRobot`, does alone."""

import mujoco
import numpy as np
import pytest
from alike import EVERYTHING
from msgspec.structs import replace

from humanoid_sim.assets import shipped
from humanoid_sim.controllers.contract import HeightScan
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.schema import JointDynamics
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.kinematics import ForwardKinematics
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.randomisation import Randomisation
from humanoid_sim.simulation.sim_robot import SimRobot

STATE = (
    "joint_position",
    "joint_velocity",
    "joint_effort",
    "joint_age",
    "imu_quaternion",
    "imu_angular_velocity",
    "imu_linear_acceleration",
)


def rows(command, count):
    return MITCommand(*(np.tile(getattr(command, name), (count, 1)) for name in COMMAND_FIELDS))


def waving(robot, step, spread=0.1):
    position = np.array(robot.initial_position) + spread * np.sin(0.05 * step + np.arange(robot.joint_count))
    zeros = np.zeros_like(position)
    return MITCommand(position, zeros, zeros, robot.stiffness, robot.damping)


def assert_equal(batch, i, robot):
    state, expected = batch.state(), robot.read()[0]
    pairs = [(name, getattr(state, name)[i], getattr(expected, name)) for name in STATE]
    assert set(state.extern) == set(expected.extern) == set(batch.extern)
    pairs += [(name, state.extern[name].value[i], live.value) for name, live in expected.extern.items()]
    for in_base in (False, True):
        pairs += [
            (f"bodies, {in_base}", of_batch[i], of_one)
            for of_batch, of_one in zip(
                batch.body_poses(in_base=in_base), robot.body_poses(in_base=in_base), strict=True
            )
        ]
    if robot.base is not None:
        pairs.append(("centre of mass", batch.base.centre_of_mass[i], robot.base.centre_of_mass))
    for name, found, wanted in pairs:
        # an acceleration is a velocity divided by the timestep
        tolerance = 1e-6 if "acceleration" in name else 1e-9
        np.testing.assert_allclose(found, wanted, rtol=0, atol=tolerance, err_msg=name)


def measured(robot):
    """The robot, with joints of another dynamics than its MJCF's."""
    dynamics = JointDynamics(armature=0.015, friction=0.3, damping=0.1, torque_scale=0.9, delay=0.005)
    return replace(robot, joints=tuple(replace(joint, dynamics=dynamics) for joint in robot.joints))


ROBOTS = {name: load_robot(name) for name in shipped("robots")}


@pytest.mark.parametrize("robot", [*ROBOTS.values(), measured(ROBOTS["lite"])], ids=[*ROBOTS, "measured"])
def test_a_robot_moves_as_the_reference_does(robot):
    config = SimConfig(
        anchor_body=robot.hands[0],
        bodies=robot.hands,
        velocity_at=("imu",),
        height_scan=HeightScan(at=robot.hands[0], resolution=0.4) if robot.is_floating else None,
    )
    alone, batch = SimRobot(robot, config), BatchSim(robot, 2, config, threads=1)
    alone.reset()
    for step in range(200):
        command = waving(robot, step)
        alone.write(command)
        batch.step(rows(command, 2))
        if step % 20 == 19:
            assert_equal(batch, 1, alone)
    assert not batch.fault.any()
    assert np.abs(batch.qpos[1] - alone.start_pose.qpos()).max() > 0.05


@pytest.mark.parametrize("name", ["lite", "lite_biped"])
def test_a_drawn_robot_is_the_same_alone_and_in_a_batch(name):
    robot, generator = load_robot(name), np.random.default_rng(6)
    pushed = {"push": (0.1, 0.3), "push_interval": 0.4} if robot.is_floating else {}
    ranges = Randomisation(**EVERYTHING | pushed)
    alone, batch = SimRobot(robot), BatchSim(robot, 3, randomisation=ranges, seeds=[5, 6, 7], threads=1)
    for _ in range(2):
        alone.vary(ranges, generator)
        alone.reset()
        batch.reset()
        for step in range(100):
            alone.write(waving(robot, step))
            batch.step(rows(waving(robot, step), 3))
        assert_equal(batch, 1, alone)
        assert np.abs(batch.qpos[0] - batch.qpos[1]).max() > 1e-3
        batch.redraw()


def test_robots_outside_the_choice_stand_still_and_miss_nothing():
    robot = load_robot("lite_biped")
    late = Randomisation(delay=(0.015, 0.015))
    batch, alone = BatchSim(robot, 2, randomisation=late, threads=1), SimRobot(robot)
    alone.vary(late, np.random.default_rng(0))
    alone.reset()
    for step in range(6):
        before, command = batch.qpos[0].copy(), waving(robot, step)
        batch.step(rows(command, 2), where=np.array([step % 2 == 0, True]))
        if step % 2:
            np.testing.assert_array_equal(batch.qpos[0], before)
        else:
            alone.write(command)
        np.testing.assert_allclose(batch.qpos[0], alone.qpos, rtol=0, atol=1e-9)


def test_a_broken_simulation_stands_still_and_disturbs_nobody(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)  # where MuJoCo would leave its MUJOCO_LOG.TXT
    robot = load_robot("lite")
    batch, alone = BatchSim(robot, 4, threads=2), SimRobot(robot)
    alone.reset()
    batch.reset([1], qvel=np.full((1, 14), 1e12))
    for step in range(3):
        command, before = rows(waving(robot, step), 4), batch.qpos.copy()
        position = command.position.copy()
        position[2, 3] = np.nan if step == 1 else position[2, 3]
        batch.step(MITCommand(position, *(getattr(command, name) for name in COMMAND_FIELDS[1:])))
        alone.write(waving(robot, step))
        assert batch.fault.tolist() == [False, True, step >= 1, False]
        np.testing.assert_array_equal(batch.qpos[1], before[1])
        np.testing.assert_allclose(batch.qpos[0], alone.qpos, rtol=0, atol=1e-9)
        assert np.isfinite(batch.qpos).all()
        assert np.isfinite(batch.state().joint_position).all()
    batch.reset([2, 1])
    batch.step(rows(waving(robot, 0), 4))
    assert not batch.fault.any()
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []


def test_implicit_damping_takes_longer_steps_and_stays_within_half_a_millimetre_at_the_hands():
    robot = load_robot("lite")
    batch, exact = BatchSim(robot, 1, implicit=True), BatchSim(robot, 1)
    assert batch.model(0).opt.timestep == 0.0025
    assert batch.model(0).opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    forward, errors = ForwardKinematics(robot), []
    for step in range(200):
        for simulation in (batch, exact):
            simulation.step(rows(waving(robot, step), 1))
        ours, theirs = (forward(simulation.state().joint_position[0])[0] for simulation in (batch, exact))
        errors.append(np.sqrt(((ours - theirs) ** 2).sum(axis=-1)))
    assert 0.0 < np.sqrt(np.mean(np.square(errors))) < 0.5e-3  # m RMS
