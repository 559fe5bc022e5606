import numpy as np

from humanoid_sim.assets import WALKING_POLICY
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.robots.description import load_robot
from tools.samples.walking.trace import walking_run, write_walking_trace


def test_a_run_begins_standing_and_then_steps():
    run = walking_run(WALKING_POLICY, load_robot("lite_biped"))
    assert run["obs"].shape == (150, 53)
    assert run["qpos"].shape == (150, 21)
    assert not run["obs"][:50, 6:9].any()
    assert run["obs"][50:, 6:9].any(axis=1).all()
    np.testing.assert_allclose(run["obs"][:, 51], np.sin(2.0 * np.pi * np.arange(1, 151) / 32), atol=1e-5)
    knee = run["qpos"][:, 7 + 3]
    assert float(np.ptp(knee[:50])) < 0.15
    assert float(np.ptp(knee[50:])) > 0.3
    assert float(run["qpos"][:, 2].min()) > 0.6


def test_the_shipped_policy_carries_a_trainers_samples(tmp_path):
    output = tmp_path / "trace.npz"
    assert write_walking_trace(WALKING_POLICY, output) == 0
    with np.load(output) as stored:
        assert set(stored.files) >= {"obs", "action", "qpos", "qvel", "cmd", "target", "walked", "joint_names"}
    checkpoint = load_checkpoint(WALKING_POLICY)
    assert "trainer" in checkpoint.golden
