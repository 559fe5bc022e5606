"""A checkpoint: everything that speaks about it read and joined to a contract, and the policy that runs."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import Policy
from humanoid_sim.errors import FieldError, InputError, blaming
from humanoid_sim.policy.graph_motion import sweep_motion
from humanoid_sim.policy.layers import MALFORMED, Layer, Reading, join
from humanoid_sim.policy.loaded_policy import LoadedPolicy, contract_layout, load_policy
from humanoid_sim.policy.motion import Motion
from humanoid_sim.policy.onnx_policy import Header, OnnxModel, OnnxPolicy, external_file, read_header
from humanoid_sim.policy.readers import berkeley, holosoma, isaaclab, mjlab, own, unitree
from humanoid_sim.policy.readers.trainer_files import find_beside
from humanoid_sim.robots.description import RobotDescription

PLACEHOLDER = "placeholder"  # source of the stand-in that runs where no policy can run
_ANCHOR_QUATERNION = "ref_quat_xyzw"  # holosoma's output
_METADATA = (own.read_stamp, own.read_own, mjlab.read_mjlab, holosoma.read_holosoma)  # the first whose keys are there
_FILES: tuple[tuple[Callable[[Path], Path | None], Callable[..., list[Layer]]], ...] = (
    (partial(find_beside, name="env.yaml"), isaaclab.read_env),
    (partial(find_beside, name="deploy.yaml"), unitree.read_deploy),
    (berkeley.find_berkeley, berkeley.read_berkeley),
)


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """A policy that is ready to run."""

    contract: PolicyContract
    policy: Policy
    source: str  # path, or `placeholder`
    sha256: str = ""  # of the file and of the external tensors beside it
    observation_width: int | None = None  # N as the model declares it; None if any width will do
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
        return {} if self.model is None else self.model.header.metadata

    def limit_inference(self, seconds: float) -> None:
        """End an inference after so many s, where the graph can loop: it is then a fault of the policy controller."""
        if self.model is not None:
            self.model.time_limit = seconds

    def with_motion(self, motion: Motion | None = None, motion_source: str = "motion") -> LoadedPolicy:
        """Load the policy with a motion; None: that of its graph, or none. Raises `InputError` if they do not fit."""
        motion, width = self.motion if motion is None else motion, self.observation_width
        return load_policy(self.contract, self.policy, motion, width, source=self.source, motion_source=motion_source)


def load_checkpoint(
    path: Path, contract_file: Path | None = None, robot_joints: tuple[str, ...] | None = None, *, verify: bool = True
) -> Checkpoint:
    """Return a checkpoint with its contract complete, its widths checked and its first (slow) inference done.

    `robot_joints` are for joints named by their places; `verify`: refuse a model whose golden vectors do not come out.
    """
    model = OnnxModel(path)
    reading = read_checkpoint(model.header, contract_file, robot_joints)
    contract = required_contract(reading, path)
    policy = OnnxPolicy(model, contract.tensors)
    with blaming(f"{path}: the model fails on an observation of zeros", Exception):  # operators may fit only in shape
        width = len(policy(np.zeros(policy.observation_width, dtype=np.float32), 0))
    if not width == policy.action_width == contract.action_count:
        expected = f"{contract.action_count}, one for each of action_joint_names"
        raise InputError(f"{path}: the model's output is {width} wide, expected {expected}")
    file = own.find_contract(path) if contract_file is None else contract_file
    motion, width = sweep_motion(policy, contract), policy.observation_width
    checkpoint = Checkpoint(contract, policy, str(path), file_digest(path), width, motion, file, reading=reading)
    if not verify or own.GOLDEN_KEY not in checkpoint.metadata:
        return checkpoint
    from humanoid_sim.policy.traces import verify_golden  # noqa: PLC0415 - it needs to know what a checkpoint is

    return replace(checkpoint, golden=verify_golden(checkpoint))


def read_contract(
    path: Path, contract_file: Path | None = None, robot_joints: tuple[str, ...] | None = None
) -> PolicyContract:
    """Return the contract alone, without ONNX Runtime; nothing checks that the model's tensors fit it."""
    return required_contract(read_checkpoint(read_header(path), contract_file, robot_joints), path)


def read_checkpoint(
    header: Header, contract_file: Path | None = None, robot_joints: tuple[str, ...] | None = None
) -> Reading:
    """Return what everything that speaks about a checkpoint states together, a `contract.yaml` beside it, too.

    A stamped one needs no trainer's file; a trainer's file of another network is recognised by the model's width.
    """
    path, where = header.path, str(header.path)
    layers: list[Layer] = []
    if _ANCHOR_QUATERNION in header.output_names:
        layers.append(Layer(f"assumed (output {_ANCHOR_QUATERNION})", {"reference_quaternion": "xyzw"}))
    with blaming(f"{path}: metadata", MALFORMED):
        layers += next((found for read in _METADATA if (found := read(header.metadata, where))), [])
    files: list[Layer] = []
    if own.STAMP_KEY not in header.metadata:
        for find, read_file in _FILES:
            if file := find(path):
                with blaming(file, MALFORMED):
                    files += read_file(file, robot_joints)
    chosen = own.find_contract(path) if contract_file is None else contract_file
    hand = [] if chosen is None else [own.read_contract_file(chosen)]
    reading = join([*layers, *files, *hand], where)
    if header.width is not None and reading.differences and _width(reading) != header.width:
        inside = join([*layers, *hand], where)
        if _width(inside) == header.width:
            names = ", ".join(layer.source for layer in files if "observation" in layer.values)
            line = f"{names} is of another network than this model of {header.width} inputs, and is not read"
            return replace(inside, unused=(*inside.unused, line))
    return reading


def _width(reading: Reading) -> int | None:
    with suppress(FieldError):
        return None if reading.outline is None else contract_layout(reading.outline).width
    return None


def required_contract(reading: Reading, path: Path) -> PolicyContract:
    """Return the contract. Raises `InputError` with everything that keeps it from being one."""
    problems = reading.problems(own.own_contract(path).name)
    if problems or reading.contract is None:
        lines = (text if field == "contract" else f"{field}: {text}" for field, text in problems.items())
        raise InputError(f"{path}: {'; '.join(lines)}")
    return reading.contract


def file_digest(path: Path) -> str:
    """SHA-256 of a checkpoint: its bytes, followed by those of `<name>.data` if that lies beside it."""
    digest = hashlib.sha256(path.read_bytes())
    external = external_file(path)
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
