from itertools import islice

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from tools.samples.closed_loop import ClosedLoop, linearise, train_closed_loop  # noqa: E402
from tools.samples.random_motions import random_motions  # noqa: E402
from tools.samples.statics import PoseBatches, patient, quadratic, soft, tensor, train_statics  # noqa: E402
from tools.samples.student import ArmNetwork  # noqa: E402
from tools.samples.teacher import training_motions, training_poses  # noqa: E402


def _linearised(arm, period):
    mass, _ = arm.dynamics(arm.home[None], np.zeros((1, 7)))
    flow, drive = linearise(mass, arm.stiffness[None], arm.damping[None], period)
    return flow[0].numpy().astype(float), drive[0].numpy().astype(float), mass[0]


def test_two_half_steps_are_one(arm):
    half, push, _ = _linearised(arm, 0.01)
    whole, drive, _ = _linearised(arm, 0.02)
    np.testing.assert_allclose(half @ half, whole, atol=1e-4)
    np.testing.assert_allclose(half @ push + push, drive, atol=1e-4)


def test_at_rest_at_its_command_an_arm_stays(arm):
    flow, drive, _ = _linearised(arm, 0.01)
    command = np.linspace(-0.3, 0.3, 7)
    rest = np.concatenate([command, np.zeros(7)])
    np.testing.assert_allclose(flow @ rest + drive @ command, rest, atol=1e-5)


def test_the_first_instant_obeys_the_law(arm):
    flow, drive, mass = _linearised(arm, 1e-6)
    inverse = np.linalg.inv(mass)
    np.testing.assert_allclose(drive[7:] / 1e-6, inverse * arm.stiffness, rtol=1e-2, atol=5.0)
    np.testing.assert_allclose((flow[7:, 7:] - np.eye(7)) / 1e-6, -inverse * arm.damping, rtol=1e-2, atol=0.5)


def test_the_pull_of_a_cost_fades_with_its_size():
    cost = torch.tensor([1.0, 400.0])
    assert soft(cost)[0] == 1.0
    assert patient(cost)[1] < soft(cost)[1] < 100.0
    assert quadratic(torch.ones(2, 7), torch.eye(7).expand(2, 7, 7)).tolist() == [7.0, 7.0]


def test_both_parts_of_training_lower_their_cost(arm):
    torch.manual_seed(0)
    generator = torch.Generator().manual_seed(0)
    rng = np.random.default_rng(0)
    motions = training_motions(arm, list(islice(random_motions(arm, rng), 4)), rng)
    network = ArmNetwork(arm.shoulder)
    poses = PoseBatches(training_poses(arm, 400, rng), tensor(arm.home), generator)
    costs = []

    def report(done, cost):
        costs.append(cost)

    train_statics(network, poses, 150, batch_size=128, report=report)
    assert len(costs) == 150
    assert costs[-1] < 0.3 * costs[0]
    loop = ClosedLoop(motions, tensor(arm.home), 64, generator)
    costs.clear()
    train_closed_loop(network, loop, poses, 60, window=10, report=report)
    # The mean of the last 25 updates against the mean of the first.
    assert costs[-1] < 0.8 * costs[24]
