import numpy as np

from humanoid_sim.assets import SAMPLE_POLICY, motion_path
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.golden.trace import read_trace
from humanoid_sim.robots.description import load_robot
from tools.samples import main
from tools.samples.trace import trainer_run


def test_the_sample_policy_carries_samples_of_its_trainers_run():
    assert load_checkpoint(SAMPLE_POLICY).golden == "8 samples of the trainer's run (lite_tracking.npz)"


def test_the_trainers_run_follows_the_motion_and_is_a_trace(tmp_path):
    output = tmp_path / "t.npz"
    assert main(["trace", "--output", str(output)]) == 0
    trace = read_trace(output, load_checkpoint(SAMPLE_POLICY).contract)
    assert trace.observation.shape == (200, 78)
    assert (trace.observation[0, 64:] == 0.0).all()  # no action came before the first
    np.testing.assert_array_equal(trace.observation[1:, 64:], trace.action[:-1])
    assert (np.abs(trace.observation[0, 36:64]) > 1e-4).all()
    lag = np.abs(trace.target - trace.arrays["joint_position"])
    assert lag[50:].max() < 0.2


def test_the_same_seed_gives_the_same_run():
    first, again, other = (trainer_run(SAMPLE_POLICY, load_robot("lite"), motion_path("wave"), s) for s in (0, 0, 1))
    np.testing.assert_array_equal(first["qpos"], again["qpos"])
    assert np.abs(first["qpos"][0] - other["qpos"][0]).max() > 0.01
