"""Train the Lite's arms to follow a motion, with PPO of stable-baselines3; ends with a policy that `play` runs.

    pip install -e '.[rl]'
    python examples/train_tracking.py --minutes 20 --output arms.onnx
    python -m humanoid_sim.policy check arms.onnx --robot lite
    python -m humanoid_sim.play --robot lite --policy arms.onnx --motion wave

Ctrl-C and SIGTERM end it after the iteration, with an export.
The rewards are those of the task `tracking`.
"""

from __future__ import annotations

import signal
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import gymnasium
import numpy as np
import torch
import tyro
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize
from torch import nn

from humanoid_sim.assets import motion_path
from humanoid_sim.envs.sb3 import Sb3VecEnv
from humanoid_sim.envs.trace import record_trace
from humanoid_sim.policy.export import export_policy
from humanoid_sim.policy_tools.stamp import stamp

STEPS = 32  # policy steps of each robot in an update
MOTION = "wave"


@dataclass
class Options:
    """Train the Lite's arms to follow a motion."""

    output: Path = Path("arms.onnx")
    minutes: float = 20.0
    iterations: int = 1_000_000  # the end too, if they come first
    envs: int = 64  # robots simulated at once
    seed: int = 0


class Actor(nn.Module):
    """The part of PPO that acts, from observations as the environment has them to clipped actions."""

    def __init__(self, model: PPO, normalise: VecNormalize) -> None:
        super().__init__()
        statistics, space = normalise.obs_rms, model.policy.action_space
        self.clip = normalise.clip_obs
        self.register_buffer("mean", torch.as_tensor(statistics.mean, dtype=torch.float32))
        deviation = np.sqrt(statistics.var + normalise.epsilon)
        self.register_buffer("deviation", torch.as_tensor(deviation, dtype=torch.float32))
        self.register_buffer("low", torch.as_tensor(space.low.copy()))
        self.register_buffer("high", torch.as_tensor(space.high.copy()))
        self.hidden, self.last = model.policy.mlp_extractor.policy_net, model.policy.action_net

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Raw actions (B, m) for observations (B, N)."""
        seen = ((observation - self.mean) / self.deviation).clamp(-self.clip, self.clip)
        return torch.minimum(torch.maximum(self.last(self.hidden(seen)), self.low), self.high)


def main(options: Options) -> None:
    """Train and export."""
    torch.set_num_threads(1)  # physics takes all processors
    envs = gymnasium.make_vec(
        "humanoid_sim/LiteTracking-v0", options.envs, autoreset_mode="SameStep", motion=MOTION, implicit=True
    )
    scenario = envs.unwrapped.scenario
    normalise = VecNormalize(VecMonitor(Sb3VecEnv(envs)), norm_reward=False)
    deviation = np.log(0.2 / np.median(scenario.contract.action_scale))  # 0.2 rad at the start
    network = {"net_arch": [256, 128], "activation_fn": nn.ELU, "log_std_init": float(deviation)}
    size = {"n_steps": STEPS, "batch_size": STEPS * options.envs // 4, "n_epochs": 5, "learning_rate": 5e-4}
    kinds = {"ent_coef": 0.001, "target_kl": 0.04, "seed": options.seed, "device": "cpu"}
    model = PPO("MlpPolicy", normalise, **size, **kinds, policy_kwargs=network)

    ended: list[bool] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.append(True))
    begin = shown = time.monotonic()
    iteration, per_iteration = 0, STEPS * options.envs
    while iteration < options.iterations and time.monotonic() < begin + 60.0 * options.minutes and not ended:
        model.learn(per_iteration, reset_num_timesteps=False)
        iteration, now = iteration + 1, time.monotonic()
        if now - shown >= 60.0 and model.ep_info_buffer:
            shown, rate = now, iteration * per_iteration / (now - begin)
            returned = np.mean([episode["r"] for episode in model.ep_info_buffer])
            print(f"{iteration} iterations, {rate:.0f} steps/s: return {returned:.2f}", flush=True)

    def answer(observation: np.ndarray) -> np.ndarray:
        return model.predict(normalise.normalize_obs(observation), deterministic=True)[0]

    with tempfile.TemporaryDirectory() as folder:
        plain, trace = Path(folder) / options.output.name, Path(folder) / "trace.npz"
        export_policy(Actor(model, normalise), scenario.contract_as_read, plain)
        record_trace(scenario, answer, trace)
        motion = motion_path(MOTION)
        stamp(plain, options.output, description=scenario.description, trace=trace, motion=motion, overwrite=True)
    normalise.close()
    print(f"{options.output}: after {iteration} iterations")


if __name__ == "__main__":
    main(tyro.cli(Options))
