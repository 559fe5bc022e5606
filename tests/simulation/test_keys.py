"""Keys of the simulated piano against the figures of the data: at rest, pressed, released, and touched by a finger."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from humanoid_sim.mit import KEY_PRESSED, MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.piano import TRIGGER, key_joint_names
from humanoid_sim.simulation.batch_sim import BatchSim
from humanoid_sim.simulation.model import SimConfig, build_model
from humanoid_sim.simulation.sim_robot import SimRobot

FIGURES = json.loads(Path(__file__).parent.parent.joinpath("data", "piano.json").read_text())
ROBOTS = {"dep20": "lite_piano", "nikomaku": "lite_piano_nikomaku"}
ROBOT = load_robot("lite_piano")
READY = np.array(ROBOT.standby_controller_a.pose_segments[-1])
LEFT, RIGHT = slice(0, 7), slice(7, 14)
STEPS = [(0.0005, False), (0.0025, True)]


KEYS = slice(14, 102)  # in qpos


def travel(model):
    """Shape (88,), rad: the whole travel of each key."""
    return np.array([model.joint(name).range[1] for name in key_joint_names()])


def settled(model, data, torque=None, seconds=1.0):
    """Shape (88,), share of their travel at which keys rest under a torque, N·m; the arms hang."""
    data.qfrc_applied[model.nv - 88 :] = 0.0 if torque is None else torque
    for _ in range(round(seconds / model.opt.timestep)):
        data.qpos[:14] = ROBOT.initial_position
        data.qvel[:14] = 0.0
        mujoco.mj_step(model, data)
    return data.qpos[KEYS] / travel(model)


@pytest.mark.parametrize("figures", ["dep20", "nikomaku"])
@pytest.mark.parametrize(("timestep", "implicit"), STEPS)
def test_rest_travel_force_and_return_are_the_data_s(figures, timestep, implicit):
    robot, data_of = load_robot(ROBOTS[figures]), FIGURES[figures]["rest_and_force"]
    model = build_model(robot, physics_timestep=timestep, implicit=implicit, scene=False)
    data, upper = mujoco.MjData(model), travel(model)
    white = np.array([key["body"].startswith("white") for key in FIGURES[figures]["keys"]])
    rest = settled(model, data)
    for colour, chosen in (("white", white), ("black", ~white)):
        assert (rest * upper)[chosen] == pytest.approx(data_of[colour]["rest_angle_rad"], abs=2e-6)
        assert rest[chosen] == pytest.approx(data_of[colour]["rest_fraction_of_travel"], abs=2e-4)
        lever = data_of[colour]["front_edge_distance_from_hinge_m"]
        assert np.tan(upper[chosen]) * lever == pytest.approx(data_of[colour]["travel_at_front_edge_m"])

    # Two hundredths less than the force of the data at the front edge triggers no key, two hundredths more all.
    force, lever = "static_force_to_trigger_at_front_edge_N", "front_edge_distance_from_hinge_m"
    torque = np.where(white, *(data_of[colour][force] * data_of[colour][lever] for colour in ("white", "black")))
    assert settled(model, data, 0.98 * torque).max() < TRIGGER < settled(model, data, 1.02 * torque).min()


def test_a_key_sounds_strictly_beyond_its_trigger_alone_and_in_a_batch():
    robot, batch = SimRobot(ROBOT), BatchSim(ROBOT, 3)
    assert dict(robot.extern) == dict(batch.extern) == {KEY_PRESSED: 88}
    qpos, trigger = np.tile(robot.qpos, (3, 1)), TRIGGER * travel(robot.model)[40]
    qpos[:, 14 + 40] = [trigger, np.nextafter(trigger, 1.0), 1.4 * trigger]
    batch.reset(qpos=qpos)
    pressed = batch.state().extern[KEY_PRESSED].value
    assert pressed[:, 40].tolist() == [0.0, 1.0, 1.0]
    assert pressed.sum() == 2.0
    robot.reset(qpos[1])
    assert np.flatnonzero(robot.state().extern[KEY_PRESSED].value).tolist() == [40]
    robot.activate()  # releases it
    assert not robot.state().extern[KEY_PRESSED].value.any()


def test_a_batch_has_the_hardest_touch_of_every_physics_step():
    """The right hand comes down on E4 from above: step by step it touches as hard, and only one of two robots does."""
    above, held, low = READY.copy(), READY.copy(), READY.copy()
    above[RIGHT] = -0.5566, 0.4330, 1.1846, -2.0917, 0.1261, 0.4590, 0.4183  # 8 mm above it
    held[RIGHT] = -0.5928, 0.4029, 1.1612, -2.1078, 0.1264, 0.4581, 0.4165  # the command that holds it there
    low[RIGHT] = -0.5245, 0.4851, 1.2053, -2.0317, 0.1270, 0.4748, 0.3810  # 0.9 of its travel down
    batch, fine = (BatchSim(ROBOT, 2, SimConfig(control_period=period), threads=1) for period in (0.02, 0.0005))
    for simulation in (batch, fine):
        simulation.reset(qpos=np.tile(np.concatenate([above, np.zeros(88)]), (2, 1)))
        assert simulation.key_force.tolist() == [0.0, 0.0]
    zeros, gains = np.zeros((2, 14)), (np.stack([ROBOT.stiffness] * 2), np.stack([ROBOT.damping] * 2))
    command, forces = MITCommand(np.stack([low, held]), zeros, zeros, *gains), []
    for _ in range(8):
        batch.step(command)
        hardest = 0.0
        for _ in range(40):
            fine.step(command)
            hardest = max(hardest, fine.key_force[0])
        forces.append([hardest, *batch.key_force])
    found = np.array(forces)
    assert found[:, 0].max() > 2.0
    np.testing.assert_allclose(found[:, 1], found[:, 0], atol=1e-6)
    assert not found[:, 2].any()
