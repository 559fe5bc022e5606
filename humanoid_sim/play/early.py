"""Checks of options before MuJoCo is imported and a model is compiled, which takes seconds."""

from __future__ import annotations

from pathlib import Path

from humanoid_sim.assets import motion_path, policy_path
from humanoid_sim.files import regular_file
from humanoid_sim.play.options import NO_POLICY, PlayConfig
from humanoid_sim.policy.checkpoint import PLACEHOLDER
from humanoid_sim.policy.onnx_policy import check_file
from humanoid_sim.session.sources import velocity_numbers


def refuse_early(config: PlayConfig) -> None:
    """Refuse files that do not exist, and a velocity that is none."""
    path = checkpoint_path(config)
    if path is not None:
        check_file(path)
    if config.contract is not None:
        regular_file(config.contract, "a YAML file")
    if config.motion is not None:
        motion_path(str(config.motion))
    velocity_numbers(config.command)


def checkpoint_path(config: PlayConfig) -> Path | None:
    """Return the file of the checkpoint that the options name; None for the sample policy, the placeholder and none."""
    if config.checkpoint in (None, PLACEHOLDER, NO_POLICY):
        return None
    option = "--policy" if config.shadow is None else "--shadow"
    return policy_path(config.checkpoint or "", option, also=(PLACEHOLDER, NO_POLICY))
