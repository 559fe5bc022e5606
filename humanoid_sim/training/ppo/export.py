"""A trained policy as a checkpoint that needs no other file: graph, contract, golden vectors."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorActionWrapper, VectorObservationWrapper

from humanoid_sim.assets import motion_path
from humanoid_sim.envs.policy_env import PolicyEnv
from humanoid_sim.envs.scenario import Motions
from humanoid_sim.envs.vector_env import PolicyVectorEnv
from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.motion import Motion, write_motion
from humanoid_sim.policy_tools.stamp import stamp
from humanoid_sim.training.ppo.actor import actor_of
from humanoid_sim.training.ppo.network import Network, require_same_answers, write_network
from humanoid_sim.training.ppo.trace import training_run

__all__ = ["export"]

_CHANGING = (gymnasium.ObservationWrapper, gymnasium.ActionWrapper, VectorObservationWrapper, VectorActionWrapper)
_INSIDE = ("env", "venv", "envs")
"""Where wrappers of Gymnasium and of the libraries keep what they wrap."""
_PROBES = 64


def export(model: Any, envs: Any, output: str | os.PathLike[str]) -> Path:
    """See `humanoid_sim.training.export_policy`."""
    path = output_file(output, "output", ".onnx")
    env = _environment(envs)
    scenario, actor = env.scenario, actor_of(model, envs)
    contract = scenario.contract_as_read
    if scenario.motion is None and contract.task_type != "locomotion":
        raise InputError("envs: their policy carries its motion itself, which a new one will not; give them motion=")
    network = actor.network()
    _check_widths(network, env)
    probes = np.random.default_rng(0).normal(size=(_PROBES, len(network.mean))) * network.deviation + network.mean
    observations = probes.astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        plain, trace = Path(folder) / "plain.onnx", Path(folder) / f"{path.stem}.npz"
        write_network(plain, network, contract, path.stem)
        require_same_answers(load_checkpoint(plain), observations, actor.answer(observations))
        if contract.live_inputs:  # nobody here can make them: no golden vectors
            stamp(plain, path, overwrite=True)
            return path
        np.savez_compressed(trace, **training_run(scenario, actor, seed=0))  # type: ignore[arg-type]
        motion = motion_file(scenario.motion, Path(folder))
        stamp(plain, path, description=scenario.description, trace=trace, motion=motion, overwrite=True)
    return path


def motion_file(motion: Motions | None, folder: Path) -> Path | None:
    """The file of a motion, of several the first; one that has no file is written into `folder`. None: there is none.

    Raises:
        InputError: it cannot be written.
    """
    first = motion[0] if isinstance(motion, list | tuple) else motion
    if first is None or isinstance(first, str | Path):
        return None if first is None else motion_path(str(first))
    assert isinstance(first, Motion)
    path = folder / "motion.mcap"
    write_motion(path, first)
    return path


def _environment(envs: Any) -> PolicyEnv | PolicyVectorEnv:
    """What is inside the libraries' and Gymnasium's wrappers.

    Raises:
        InputError: it is no environment of a policy, or a wrapper changes what the policy sees or commands.
    """
    inner = envs
    while not isinstance(inner, PolicyEnv | PolicyVectorEnv):
        if isinstance(inner, _CHANGING):
            raise InputError(
                f"envs: {type(inner).__name__} changes observations or actions, which the file would not; train "
                "without it: stable-baselines3's VecNormalize and rsl_rl's obs_normalization go into the file"
            )
        inner = _inside(inner)
        if inner is None:
            raise InputError(f"envs: is a {type(envs).__name__}, expected the environments that the policy learned in")
    return inner


def _inside(wrapper: Any) -> Any:
    """What is wrapped; of several environments the first. None: nothing."""
    own = getattr(wrapper, "__dict__", {})
    inside = next((own[name] for name in _INSIDE if name in own), None)
    return next(iter(inside), None) if isinstance(inside, list | tuple) else inside


def _check_widths(network: Network, env: PolicyEnv | PolicyVectorEnv) -> None:
    seen, made = env.scenario.wiring.layout.width, env.scenario.contract.action_count
    widths = len(network.mean), len(network.layers[-1][1])
    if widths != (seen, made):
        raise InputError(
            f"model: takes {widths[0]} values and gives {widths[1]}, expected {seen} and {made} of these environments"
        )
