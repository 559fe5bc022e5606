"""LeRobot makes the example's environment as if it were on its hub, and evaluates the sample policy in it."""

from pathlib import Path

import numpy as np
import pytest

from humanoid_sim.assets import SAMPLE_POLICY
from humanoid_sim.policy.checkpoint import load_checkpoint

pytestmark = [pytest.mark.lerobot, pytest.mark.filterwarnings("ignore")]

EXAMPLE = Path(__file__).parent.parent.parent / "examples" / "lerobot_hub" / "env.py"


@pytest.mark.parametrize("use_async_envs", [False, True])
def test_the_hub_s_make_env_takes_it(use_async_envs, monkeypatch):
    from lerobot.envs import utils  # noqa: PLC0415
    from lerobot.envs.factory import make_env  # noqa: PLC0415

    asked = []
    monkeypatch.setattr(utils, "hf_hub_download", lambda **of: asked.append(of["filename"]) or str(EXAMPLE))
    suites = make_env("me/waving", n_envs=2, use_async_envs=use_async_envs, trust_remote_code=True)
    assert asked == ["env.py"]
    (envs,) = suites["humanoid_sim/LiteTracking-v0"].values()
    observation, _ = envs.reset(seed=[0, 1])
    state = utils.preprocess_observation(observation)["observation.state"]
    assert state.shape == (2, 78)
    np.testing.assert_array_equal(state.numpy(), observation["agent_pos"])
    envs.close()


def test_the_sample_policy_succeeds_in_lerobot_s_rollout(monkeypatch):
    import torch  # noqa: PLC0415
    from lerobot.envs import utils  # noqa: PLC0415
    from lerobot.envs.factory import make_env  # noqa: PLC0415
    from lerobot.scripts.lerobot_eval import rollout  # noqa: PLC0415

    class Sample(torch.nn.Module):
        """The shipped checkpoint as LeRobot calls policies."""

        def __init__(self):
            super().__init__()
            self.policy = load_checkpoint(SAMPLE_POLICY).policy

        def reset(self):
            pass

        def select_action(self, batch):
            assert batch["task"] == ["Wave with both arms."] * 2
            rows = batch["observation.state"].numpy().astype(np.float32)
            return torch.from_numpy(np.stack([self.policy(row, 0) for row in rows]))

    monkeypatch.setattr(utils, "hf_hub_download", lambda **_: str(EXAMPLE))
    (envs,) = make_env("me/waving", n_envs=2, trust_remote_code=True)["humanoid_sim/LiteTracking-v0"].values()
    same = [lambda value: value] * 4
    result = rollout(envs, Sample(), *same, seeds=[0, 1])
    assert result["success"].any(dim=1).tolist() == [True, True]
    assert result["done"].shape == (2, 400)
    assert float(result["reward"].sum(dim=1).min()) > 11.0
    envs.close()
