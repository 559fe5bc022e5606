"""`params/agent.yaml` of a training: what the learner does to actions and observations (rsl_rl, rl_games, skrl)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import onnx

from humanoid_sim.policy.layers import Layer
from humanoid_sim.policy.readers.trainer_files import find_beside, read_section

_NORMALISES = (
    ("empirical_normalization",),  # rsl_rl, as it was; as it is
    ("policy", "actor_obs_normalization"),
    ("actor", "obs_normalization"),
    ("params", "config", "normalize_input"),  # rl_games
    ("agent", "state_preprocessor"),  # skrl
)


def read_agent(path: Path, _: object) -> list[Layer]:
    """Return the magnitude at which the environment's wrapper clips raw actions."""
    file = read_section(path)
    clip = file.get("clip_actions") or _within(file, "params", "env", "clip_actions")  # rsl_rl, rl_games
    return [Layer(path.name, {"action_clip": clip} if clip else {})]


def _within(value: Any, *keys: str) -> Any:
    """Return the value of the last key; None where another program's file has something else."""
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    return value


def missing_normaliser(path: Path) -> str:
    """Return what is wrong if the trainer normalised observations and the network begins with its first layer."""
    agent = find_beside(path, "agent.yaml")
    if agent is None:
        return ""
    file = read_section(agent)
    said = next((keys[-1] for keys in _NORMALISES if _within(file, *keys)), "")
    graph = onnx.load(str(path), load_external_data=False).graph
    names = {tensor.name for tensor in graph.input}
    first = next((node.op_type for node in graph.node if names.intersection(node.input)), "")
    if not said or first not in ("Gemm", "MatMul"):
        return ""
    return f"{agent.name} says {said}, but the network begins with its first layer: export it with the normaliser"
