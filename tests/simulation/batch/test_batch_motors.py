"""The line of commands under way."""

import numpy as np
import pytest

from humanoid_sim.mit import MITCommand
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.batch.draws import Draws
from humanoid_sim.simulation.batch.motors import BatchMotors, MotorDifferences
from humanoid_sim.simulation.batch.physics import ModelPool
from humanoid_sim.simulation.batch.randomisation import Randomisation
from humanoid_sim.simulation.model import build_model

ROBOT = load_robot("lite")
MODEL = build_model(ROBOT, affine_actuators=True, scene=False)
STEPS = 40


def motors(delay, jitter=0):
    count = len(delay)
    pool = ModelPool(MODEL, count)
    differences = MotorDifferences.none(count, np.array(ROBOT.effort_limit))
    differences.delay[:] = delay
    draws = Draws(Randomisation(), count)
    draws.seed(np.arange(count), np.arange(count))
    line = BatchMotors(pool, STEPS, differences, draws, longest_delay=max(delay), jitter=jitter)
    return line, pool


def effort(values):
    """Feed-forward effort alone, one value for all joints of each robot."""
    column = np.repeat(np.asarray(values, dtype=np.float64)[:, None], ROBOT.joint_count, axis=1)
    none = np.zeros_like(column)
    return MITCommand(none, none, column, none, none)


def test_commands_arrive_in_their_own_step_or_later():
    line, _ = motors([0, 1, 39, 40, 100])
    seen = []
    for step in range(5):
        control = line.send(effort([step + 1.0] * 5), np.full(5, step), None)
        assert control.shape == (5, STEPS, ROBOT.joint_count)
        np.testing.assert_array_equal(control, control[:, :, :1].repeat(ROBOT.joint_count, axis=2))
        seen.append(control[:, :, 0].copy())
    path = np.concatenate(seen, axis=1)
    for row, delay in zip(path, [0, 1, 39, 40, 100], strict=True):
        expected = np.repeat(np.arange(1.0, 6.0), STEPS)
        np.testing.assert_array_equal(row, np.concatenate([np.zeros(delay), expected])[: len(row)])


def test_jitter_is_drawn_anew_for_every_command():
    count = 300
    line, _ = motors([0] * count, jitter=20)
    arrivals = []
    for step in range(6):
        value = float(step % 2 + 1)
        control = line.send(effort([value] * count), np.full(count, step), None)
        arrivals.append((control[:, :, 0] != value).sum(axis=1))
    late = np.array(arrivals)
    assert late.min() == 0
    assert late.max() == 20
    assert late.mean() == pytest.approx(10.0, abs=0.5)
    assert np.abs(np.corrcoef(late) - np.eye(6)).max() < 0.2


def test_a_command_that_is_overtaken_is_dropped():
    line, _ = motors([0] * 64, jitter=2 * STEPS)
    last = np.zeros(64)
    overtaken = 0
    for step in range(20):
        control = line.send(effort([step + 1.0] * 64), np.full(64, step), None)[:, :, 0]
        path = np.concatenate([last[:, None], control], axis=1)
        assert (np.diff(path, axis=1) >= 0.0).all()
        overtaken += int((np.diff(path, axis=1) > 1.0).sum())
        last = control[:, -1].copy()
    assert overtaken > 20


def test_torque_is_the_mit_law_saturated():
    line, _ = motors([0])
    ones = np.ones((1, ROBOT.joint_count))
    line.send(
        MITCommand(0.1 * ones, 0.2 * ones, 0.3 * ones, 10.0 * ones, 2.0 * ones), np.zeros(1, dtype=np.int64), None
    )
    np.testing.assert_allclose(line.torque(0.0 * ones, 0.5 * ones), 10.0 * 0.1 + 2.0 * (0.2 - 0.5) + 0.3)
    np.testing.assert_array_equal(line.torque(-100.0 * ones, ones)[0], ROBOT.effort_limit)
