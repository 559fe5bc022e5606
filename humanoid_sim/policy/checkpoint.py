"""A checkpoint: everything that speaks about it read and joined to a contract, and the policy that runs."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.policy.graph_motion import sweep_motion
from humanoid_sim.policy.layers import MALFORMED, Layer, Reading, join
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.onnx_policy import OnnxModel, OnnxPolicy, read_metadata
from humanoid_sim.policy.readers import agent, berkeley, holosoma, isaaclab, mjlab, own, unitree
from humanoid_sim.policy.readers.trainer_files import find_beside
from humanoid_sim.robots.description import RobotDescription

PLACEHOLDER = "placeholder"  # source of the stand-in that runs where no policy can run
_METADATA = (own.read_stamp, mjlab.read_csv, holosoma.read_holosoma)  # the first whose keys are there
_FILES: Mapping[str, Callable[[Path, tuple[str, ...] | None], list[Layer]]] = {
    "agent.yaml": agent.read_agent,
    "env.yaml": isaaclab.read_env,
    "deploy.yaml": unitree.read_deploy,
    "{stem}.yaml": berkeley.read_berkeley,
}


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A policy that is ready to run."""

    contract: PolicyContract
    policy: Policy
    source: str  # path, or `placeholder`
    sha256: str = ""  # of the file and of the external tensors beside it
    motion: Motion | None = None  # in the model's graph
    contract_file: Path | None = None  # that took part, beside the model or named
    golden: str = ""  # worth of the golden vectors that were computed again, in words
    reading: Reading | None = None  # all that its sources state

    @property
    def model(self) -> OnnxModel | None:
        """The ONNX model; None for a policy without one."""
        return self.policy.model if isinstance(self.policy, OnnxPolicy) else None

    @property
    def metadata(self) -> Mapping[str, str]:
        """The model's metadata; empty for a policy without one."""
        return {} if self.model is None else self.model.metadata

    @property
    def observation_width(self) -> int | None:
        """N as the model declares it; None if any width will do."""
        return self.policy.observation_width if isinstance(self.policy, OnnxPolicy) else None

    def limit_inference(self, seconds: float) -> None:
        """End an inference after so many s, where the graph can loop: it is then a fault of the policy controller."""
        if self.model is not None:
            self.model.time_limit = seconds

    def with_motion(self, motion: Motion | None = None) -> LoadedPolicy:
        """Load the policy with a motion; None: that of its graph, or none. Raises `InputError` if they do not fit."""
        followed = self.motion if motion is None else motion
        return load_policy(self.contract, self.policy, followed, self.observation_width, source=self.source)


def load_checkpoint(
    path: Path, contract_file: Path | None = None, robot_joints: tuple[str, ...] | None = None, *, verify: bool = True
) -> Checkpoint:
    """Return a checkpoint with its contract complete, its widths checked and its first (slow) inference done.

    `robot_joints` are for joints named by their places; `verify`: refuse a model whose golden vectors do not come out.
    """
    model = OnnxModel(path)
    reading = read_checkpoint(path, model.metadata, contract_file, robot_joints)
    contract = reading.required_contract()
    policy = OnnxPolicy(model, contract.tensors)
    with blaming(f"{path}: the model fails on an observation of zeros", Exception):  # operators may fit only in shape
        width = len(policy(np.zeros(policy.observation_width, dtype=np.float32), 0))
    if not width == policy.action_width == contract.action_count:
        expected = f"{contract.action_count}, one for each of action_joint_names"
        raise InputError(f"{path}: the model's output is {width} wide, expected {expected}")
    file, motion = own.find_contract(path) if contract_file is None else contract_file, sweep_motion(policy, contract)
    checkpoint = Checkpoint(contract, policy, str(path), file_digest(path), motion, file, reading=reading)
    if not verify or own.GOLDEN_KEY not in checkpoint.metadata:
        return checkpoint
    from humanoid_sim.policy.traces import verify_golden  # noqa: PLC0415 - it needs to know what a checkpoint is

    return replace(checkpoint, golden=verify_golden(checkpoint))


def read_contract(
    path: Path, contract_file: Path | None = None, robot_joints: tuple[str, ...] | None = None
) -> PolicyContract:
    """Return the contract alone, without ONNX Runtime; nothing checks that the model's tensors fit it."""
    return read_checkpoint(path, read_metadata(path), contract_file, robot_joints).required_contract()


def read_checkpoint(
    path: Path,
    metadata: Mapping[str, str],
    contract_file: Path | None = None,
    robot_joints: tuple[str, ...] | None = None,
) -> Reading:
    """Return what everything that speaks about a checkpoint states together, a `contract.yaml` beside it, too.

    A stamped one needs no trainer's file.
    """
    layers: list[Layer] = []
    with blaming(f"{path}: metadata", MALFORMED):
        layers += next((found for read in _METADATA if (found := read(metadata, str(path)))), [])
    for name, read_file in _FILES.items() if own.STAMP_KEY not in metadata else ():
        if file := find_beside(path, name.format(stem=path.stem)):
            with blaming(file, MALFORMED):
                found = read_file(file, robot_joints)
            if read_file is not agent.read_agent and not any(layer.values or layer.unused for layer in found):
                found = [Layer(file.name, {}, unused=(f"{file.name}, which is of no kind that is known",))]
            layers += found
    chosen = own.find_contract(path) if contract_file is None else contract_file
    return join(layers if chosen is None else [*layers, own.read_contract_file(chosen)], path)


def file_digest(path: Path) -> str:
    """SHA-256 of a checkpoint: its bytes, followed by those of `<name>.data` if that lies beside it."""
    digest = hashlib.sha256(path.read_bytes())
    external = path.with_name(f"{path.name}.data")
    if os.path.isfile(external):
        digest.update(external.read_bytes())
    return digest.hexdigest()


def zero_policy(action_count: int) -> Policy:
    """Return a policy that answers zeros of shape (m,), whatever it observes."""
    return lambda _observation, _frame: np.zeros(action_count, dtype=np.float32)


def placeholder_checkpoint(description: RobotDescription, policy_dt: float = 0.02) -> Checkpoint:
    """Return a zero policy for any robot: it observes the joints and holds the final pose of standby A."""
    joints = description.joint_names
    contract = PolicyContract(
        task_type="locomotion",
        joint_names=joints,
        action_joint_names=joints,
        joint_stiffness=description.stiffness,
        joint_damping=description.damping,
        default_joint_pos=np.asarray(description.standby_controller_a.pose_segments[-1]),
        observation=("joint_pos", "joint_vel", "actions"),
        command_names=(),
        action_scale=np.ones(len(joints)),
        policy_dt=policy_dt,
    )
    return Checkpoint(contract, zero_policy(len(joints)), PLACEHOLDER)
