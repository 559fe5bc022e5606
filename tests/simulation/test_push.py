import mujoco
import numpy as np
import pytest

from humanoid_sim.errors import InputError
from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.sim_robot import SimRobot


def momentum(robot):
    """Shape (3,), of the whole robot over its mass: the velocity of its centre of mass, m/s."""
    mujoco.mj_subtreeVel(robot.model, robot.data)
    return robot.data.subtree_linvel[robot.model.body(robot.description.base.body).id].copy()


def test_a_push_speeds_the_whole_robot_up():
    robot = SimRobot(load_robot("lite_biped"))
    robot.reset(np.r_[0.0, 0.0, 5.0, robot.qpos[3:]])  # high above the floor, where nothing else pushes it
    for tick in range(32):
        if tick == 10:
            assert np.allclose(momentum(robot)[:2], 0.0, atol=1e-6)
            robot.push(0.5, -0.25)
        robot.write(MITCommand.zeros(14))
    assert np.allclose(momentum(robot)[:2], [0.5, -0.25], atol=1e-3)
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
