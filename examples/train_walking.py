"""Train the Lite's legs to walk at a commanded velocity, with PPO of rsl_rl; ends with a policy that `play` runs.

    pip install -e '.[rl]'
    python examples/train_walking.py --minutes 180 --output walk.onnx
    python -m humanoid_sim.policy check walk.onnx --robot lite_biped
    python -m humanoid_sim.play --robot lite_biped --policy walk.onnx --command 0.3,0,0

Ctrl-C and SIGTERM end it after the iteration, with an export. Two things make it learn within hours on a few cores: the
network corrects a simple gait on the contract's clock, and sees the mirror image while the right leg swings, so each
step trains both legs.
"""

from __future__ import annotations

import contextlib
import io
import signal
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
import tyro
from gymnasium.wrappers.vector import RecordEpisodeStatistics
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict
from torch import Tensor, nn

from humanoid_sim.envs.rsl_rl import RslRlVecEnv
from humanoid_sim.envs.trace import record_trace
from humanoid_sim.evaluation.step import StepSample
from humanoid_sim.policy.export import export_policy
from humanoid_sim.policy_tools.stamp import stamp
from humanoid_sim.robots.description import load_robot

EFFORT = load_robot("lite_biped").effort_limit  # N·m


def strain(sample: StepSample) -> np.ndarray:
    """Sum of the squares of |torque| / effort limit beyond 0.8, of each robot."""
    return (np.maximum(np.abs(sample.torque) / EFFORT - 0.8, 0.0) ** 2).sum(axis=-1)


ENVIRONMENT: dict[str, Any] = {
    "implicit": True,  # four times as fast as damping that agrees with the reference
    "physics_timestep": 0.005,  # s
    "rewards": {"alive": 3.0, "linear_velocity": 6.0, "yaw_rate": 3.0, "strain": (-10.0, strain)},  # 1/s
    "randomisation": {
        **{"mass": (0.9, 1.1), "friction": (0.6, 1.8), "gains": (0.93, 1.07), "armature": (0.9, 1.1)},
        **{"delay": (0.0, 0.01), "push": (0.0, 0.3), "encoder_offset": 0.01},
    },
}
STEPS = 24  # policy steps of each robot in an iteration
NETWORK = {"class_name": "MLPModel", "hidden_dims": [192, 128], "activation": "elu", "obs_normalization": True}
PPO = {
    **{"class_name": "PPO", "num_learning_epochs": 5, "num_mini_batches": 4, "learning_rate": 5e-4},
    **{"desired_kl": 0.015, "gamma": 0.985, "lam": 0.95, "entropy_coef": 0.001, "value_loss_coef": 1.0},
}
CONFIGURATION = {
    "num_steps_per_env": STEPS,
    "obs_groups": {"actor": ["policy"], "critic": ["policy", "truth"]},
    "actor": {**NETWORK, "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 0.4}},
    "critic": dict(NETWORK),
    "algorithm": PPO,
}

COMMAND, PHASE = slice(6, 9), slice(51, 53)  # in the observation: m/s, m/s, rad/s; sine and cosine of the gait's phase
LEG = [1.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0]  # signs in the mirror: hip pitch, roll, yaw, knee, ankle yaw, pitch, roll
SWAP = [*range(7, 14), *range(7)]
ACTION_SIGN = torch.tensor(LEG * 2)
SOURCE = [*range(9), *(first + i for first in (9, 23, 37) for i in SWAP), 51, 52]
SIGN = torch.tensor([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0, *(LEG * 6), -1.0, -1.0])
SCALE = 0.25  # rad for an action of 1, the contract's
SWING = torch.tensor([-0.25, 0.03, 0.0, 0.5, 0.0, -0.25, -0.03, 0.0, 0.03, 0.0, 0.0, 0.0, 0.0, -0.03]) / SCALE
AHEAD = torch.tensor([-0.1, *[0.0] * 6] * 2) / SCALE
STRIDE = [0.43, 0.0, 0.0, 0.0, 0.0, -0.43, 0.0]
ASIDE = [0.0, -0.24, 0.14, 0.0, 0.0, 0.0, 0.24]
TURN = [0.0, 0.0, -0.16, 0.0, 0.0, 0.0, 0.0]
STEP = torch.tensor([[*leg, *(-joint for joint in leg)] for leg in (STRIDE, ASIDE, TURN)]) / SCALE


def seen_by_network(observation: Tensor) -> tuple[Tensor, Tensor]:
    """(B, 53), mirrored where the right leg swings, the clock zero where it is to stand; and (B, 1), where mirrored."""
    moves = (observation[:, COMMAND].norm(dim=1, keepdim=True) > 0.05).float()
    awake = torch.cat([observation[:, :51], moves * observation[:, PHASE]], dim=1)
    is_mirrored = awake[:, 51:52] < 0.0
    return torch.where(is_mirrored, awake[:, SOURCE] * SIGN, awake), is_mirrored


def action_of(seen: Tensor, answer: Tensor, is_mirrored: Tensor) -> Tensor:
    """Raw actions (B, 14): the gait while the left leg swings, corrected by the network, and mirrored back."""
    sine, cosine, command = seen[:, 51:52], seen[:, 52:53], seen[:, COMMAND]
    gait = sine * SWING + cosine * (command @ STEP) + command[:, :1].clamp(min=0.0) * AHEAD
    action = gait + answer.clamp(-5.0, 5.0)
    return torch.where(is_mirrored, action[:, SWAP] * ACTION_SIGN, action)


class Walker(nn.Module):
    """The whole policy, from what the robot observes to its action, around the network that was trained."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, observation: Tensor) -> Tensor:
        """Raw actions (B, 14) for observations (B, 53)."""
        seen, is_mirrored = seen_by_network(observation)
        return action_of(seen, self.network(seen), is_mirrored)


class WalkingEnv(RslRlVecEnv):
    """The network's view of the robots; the critic also sees the base's true velocity and height."""

    def get_observations(self) -> TensorDict:
        """Return the latest, (N, …) each."""
        self.seen, self.is_mirrored = seen_by_network(super().get_observations()["policy"])
        base = self.envs.unwrapped.simulation.base
        truth = np.column_stack([base.planar_velocity, base.height, base.linear_velocity[:, 2]])
        side = torch.where(self.is_mirrored, torch.tensor([1.0, -1.0, -1.0, 1.0, 1.0]), torch.ones(5))
        return TensorDict({"policy": self.seen, "truth": torch.tensor(truth).float() * side}, [self.num_envs])

    def step(self, actions: Tensor) -> Any:
        """One policy step, of the gait and the network's correction."""
        _, *rest = super().step(action_of(self.seen, actions, self.is_mirrored))
        return self.get_observations(), *rest


@dataclass
class Options:
    """Train the Lite's legs to walk."""

    output: Path = Path("walk.onnx")
    minutes: float = 180.0
    iterations: int = 1_000_000  # the end too, if they come first
    envs: int = 256  # robots simulated at once
    seed: int = 0


def export(runner: OnPolicyRunner, scenario: Any, output: Path) -> None:
    """Write the policy with its contract, and golden vectors of a run in the trainer's environment."""
    walker = Walker(runner.alg.get_policy().as_onnx(verbose=False)).eval()

    def answer(observation: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return walker(torch.from_numpy(observation)).numpy()

    with tempfile.TemporaryDirectory() as folder:
        plain, trace = Path(folder) / output.name, Path(folder) / "trace.npz"
        export_policy(walker, scenario.contract_as_read, plain)
        record_trace(scenario, answer, trace)
        stamp(plain, output, description=scenario.description, trace=trace, overwrite=True)


def main(options: Options) -> None:
    """Train and export."""
    torch.manual_seed(options.seed)
    torch.set_num_threads(1)  # physics takes all processors
    robots = gymnasium.make_vec("humanoid_sim/BipedVelocity-v0", options.envs, autoreset_mode="SameStep", **ENVIRONMENT)
    meter = RecordEpisodeStatistics(robots)
    envs = WalkingEnv(meter, seed=options.seed)
    with contextlib.redirect_stdout(io.StringIO()):  # it prints its networks
        runner = OnPolicyRunner(envs, CONFIGURATION, log_dir=None)
    actor = runner.alg.get_policy()
    actor.mlp[-1].weight.data *= 0.01  # begin with the gait alone
    for model in (actor, runner.alg.critic):
        model.obs_normalizer.eps = 0.2  # added to standard deviations: what rarely changes is not blown up

    ended: list[bool] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.append(True))
    begin = shown = time.monotonic()
    iteration, per_iteration = 0, STEPS * options.envs
    envs.episode_length_buf = torch.randint(0, envs.max_episode_length, (options.envs,))  # they end one by one
    while iteration < options.iterations and time.monotonic() < begin + 60.0 * options.minutes and not ended:
        runner.learn(1)
        iteration, now = iteration + 1, time.monotonic()
        if now - shown >= 60.0 and meter.return_queue:
            shown, rate = now, iteration * per_iteration / (now - begin)
            text = f"return {np.mean(meter.return_queue):.2f}, {0.02 * np.mean(meter.length_queue):.1f} s an episode"
            print(f"{iteration} iterations, {rate:.0f} steps/s: {text}", flush=True)
    export(runner, robots.unwrapped.scenario, options.output)
    envs.close()
    print(f"{options.output}: after {iteration} iterations")


if __name__ == "__main__":
    main(tyro.cli(Options))
