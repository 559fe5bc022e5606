"""Which policy `play` runs, and with which motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from humanoid_sim.assets import SAMPLE_MOTION, SAMPLE_POLICY, motion_path
from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.controllers.sources import takes_velocity_command
from humanoid_sim.errors import InputError
from humanoid_sim.play.config import PlayConfig
from humanoid_sim.policy.checkpoint import (
    PLACEHOLDER,
    Checkpoint,
    load_checkpoint,
    placeholder_checkpoint,
    read_contract,
    zero_policy,
)
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import Motion, read_motion
from humanoid_sim.policy.onnx_policy import has_onnxruntime
from humanoid_sim.robots.description import RobotDescription

__all__ = ["PolicyChoice", "choose_policy"]


@dataclass(frozen=True, slots=True)
class PolicyChoice:
    """The policy of a run, and what the user must be told about it."""

    loaded: LoadedPolicy
    checkpoint: Checkpoint
    motion: Motion | None
    motion_file: Path | None
    warning: str = ""

    @property
    def walks(self) -> bool:
        """Whether it takes a velocity command."""
        return takes_velocity_command(self.loaded.contract)


def choose_policy(
    config: PlayConfig, description: RobotDescription, wrap: Callable[[Policy], Policy] = lambda policy: policy
) -> PolicyChoice:
    """Load the checkpoint and the motion that the options name.

    Args:
        config: the options.
        description: of the robot; the placeholder is made for it.
        wrap: put around the policy's callable, for faults on purpose.

    Raises:
        InputError: naming the file and what is wrong with it.
    """
    path = SAMPLE_POLICY if config.policy is None else Path(config.policy)
    contract_file = None if config.contract is None else Path(config.contract)
    warning = ""
    if config.policy == PLACEHOLDER:
        checkpoint = placeholder_checkpoint(description, config.pose)
        warning = "PLACEHOLDER POLICY: no network runs; the action is zero, and the arms hold one pose"
    elif has_onnxruntime():
        checkpoint = load_checkpoint(path, contract_file, description.joint_names)
    else:
        contract = read_contract(path, contract_file, description.joint_names)
        checkpoint = Checkpoint(contract, zero_policy(contract.action_count), str(path))
        warning = (
            f"PLACEHOLDER POLICY: onnxruntime cannot be imported, so {path.name} does NOT run; "
            "the action is zero. To run it: pip install onnxruntime"
        )
    file = _motion_file(config, checkpoint)
    motion = checkpoint.motion if file is None else read_motion(file)
    loaded = load_policy(
        checkpoint.contract,
        wrap(checkpoint.policy),
        motion,
        checkpoint.observation_width,
        source=checkpoint.source,
        motion_source=str(file),
    )
    return PolicyChoice(loaded, checkpoint, motion, file, warning)


def _motion_file(config: PlayConfig, checkpoint: Checkpoint) -> Path | None:
    task = checkpoint.contract.task_type
    if task == "locomotion":
        if config.motion is not None:
            raise InputError(f"--motion: is '{config.motion}', but {checkpoint.source} follows no motion")
        return None
    if config.motion is not None:
        return motion_path(config.motion)
    if checkpoint.motion is not None:
        return None
    if config.policy is None:
        return motion_path(SAMPLE_MOTION)
    dataset = checkpoint.contract.dataset_repo_id
    hint = f"; its default is the dataset '{dataset}', to be converted to an .mcap motion first" if dataset else ""
    raise InputError(f"--motion: is missing; {checkpoint.source} is a {task} policy and follows a motion{hint}")
