import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.push import Push, parse_pushes
from humanoid_sim.simulation.sim_robot import SimRobot

PLANNED = SimConfig(support=False, base_height=5.0, pushes=parse_pushes(["0.5,-0.25@0.05"]))
"""High above the floor, where nothing else pushes the robot."""


def momentum(robot):
    """Shape (3,), of the whole robot over its mass: the velocity of its centre of mass, m/s."""
    mujoco.mj_subtreeVel(robot.model, robot.data)
    return robot.data.subtree_linvel[robot.model.body(robot.description.base.body).id].copy()


def test_a_push_speeds_the_whole_robot_up():
    robot = SimRobot(load_robot("lite_biped"), PLANNED)
    for _ in range(10):
        robot.write(MITCommand.zeros(14))
    assert np.allclose(momentum(robot)[:2], 0.0, atol=1e-6)
    for _ in range(22):
        robot.write(MITCommand.zeros(14))
    assert np.allclose(momentum(robot)[:2], [0.5, -0.25], atol=1e-3)
    assert not robot.data.xfrc_applied.any()


def test_a_push_as_it_comes_is_the_planned_one_bit_for_bit():
    biped = load_robot("lite_biped")
    planned, given = SimRobot(biped, PLANNED), SimRobot(biped, SimConfig(support=False, base_height=5.0))
    for tick in range(30):
        if tick == round(0.05 / given.control_period):
            given.pushes.add(Push(0.5, -0.25, given.time))
            with pytest.raises(InputError, match=r"the push before has not ended; each takes 0.1 s"):
                given.pushes.add(Push(0.5, 0.0, given.time))
        for robot in (planned, given):
            robot.write(MITCommand.zeros(14))
        assert np.array_equal(planned.qpos, given.qpos)
    given.pushes.add(Push(0.5, 0.0, given.time))
    given.activate()
    given.write(MITCommand.zeros(14))
    assert not given.data.xfrc_applied.any()


def test_a_robot_whose_base_is_fixed_is_pushed_at_a_body():
    robot = SimRobot(load_robot("lite"))
    body = robot.model.body(robot.pushes.bodies[3])
    with pytest.raises(InputError, match="unknown body ''"):
        robot.pushes.add(Push(0.0, 1.0, 0.0))
    robot.pushes.add(Push(0.0, 1.0, 0.0, body.name))
    robot.write(MITCommand.zeros(14))
    assert robot.data.xfrc_applied[body.id][1] == pytest.approx(body.subtreemass[0] / 0.1)
    with pytest.raises(InputError, match="push: 'lite' has a fixed base"):
        SimRobot(load_robot("lite"), SimConfig(pushes=(Push(1.0, 0.0, 1.0),)))
