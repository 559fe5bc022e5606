"""A checkpoint that runs: its contract read, its tensors found, one observation in and one action out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract, TensorNames
from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import Checkpoint, file_digest
from humanoid_sim.policy.golden.samples import GOLDEN_KEY
from humanoid_sim.policy.graph_motion import Progress, has_graph_motion, sweep_motion
from humanoid_sim.policy.onnx_model import OnnxModel, Tensor, first_line, has_onnxruntime, read_header, read_metadata
from humanoid_sim.policy.readers.contract_yaml import find_contract
from humanoid_sim.policy.readers.sources import assemble_contract

__all__ = ["OnnxPolicy", "has_onnxruntime", "load_checkpoint", "read_contract", "read_metadata"]

_ACTIONS = ("actions", "action")
_TIME_STEP = "time_step"
_NUMBERS = {"tensor(float)": np.float32, "tensor(int64)": np.int64, "tensor(int32)": np.int32}


class OnnxPolicy:
    """`(observation (N,), frame) -> action (m,)`, float32. A model with a `time_step` input gets the frame there."""

    def __init__(self, model: OnnxModel | Path, tensors: TensorNames | None = None) -> None:
        """Find the tensors of a model and check their form.

        Args:
            model: loaded, or its file.
            tensors: names; those that are empty are found by their place.

        Raises:
            InputError: if there is not exactly one observation, float32 (1, N), beside an optional time_step, or no
                action, float32 (1, M).
        """
        self.model = OnnxModel(model) if isinstance(model, Path) else model
        tensors = TensorNames() if tensors is None else tensors
        path, inputs, outputs = self.model.path, self.model.inputs, self.model.outputs
        time_step = _time_step(path, inputs, tensors.time_step)
        others = [tensor for tensor in inputs if tensor is not time_step]
        observation = _named(path, "input", inputs, tensors.observation) if tensors.observation else None
        if observation is None:
            observation = others[0] if len(others) == 1 else None
        surplus = [tensor.name for tensor in others if tensor is not observation]
        if observation is None or surplus or not outputs:
            names = ", ".join(tensor.name for tensor in inputs) or "none"
            raise InputError(
                f"{path}: has the inputs {names} and {len(outputs)} outputs, expected one input, or one and "
                f"'{_TIME_STEP}', and an output"
            )
        usual = [tensor for tensor in outputs if tensor.name in _ACTIONS]
        action = _named(path, "output", outputs, tensors.action) if tensors.action else (usual or outputs)[0]
        self.observation_width = _vector_width(path, "input", observation)
        self.action_width = _vector_width(path, "output", action)
        self.has_time_step = time_step is not None
        self.action_name = action.name
        self._observation = observation.name
        self._time_step = "" if time_step is None else time_step.name
        self._frame_type = np.float32 if time_step is None else _NUMBERS[time_step.type]

    @property
    def metadata(self) -> dict[str, str]:
        """The model's `custom_metadata_map`."""
        return self.model.metadata

    def __call__(self, observation: npt.NDArray[np.float32], frame: int) -> npt.NDArray[np.float32]:
        """One inference."""
        action: npt.NDArray[np.float32] = self.run([self.action_name], observation, frame)[0][0]
        return action

    def run(
        self, outputs: list[str], observation: npt.NDArray[np.float32], frame: int
    ) -> list[npt.NDArray[np.float32]]:
        """Any outputs of one inference, each as the model gives it, shape (1, …)."""
        return self.model.run(outputs, self.inputs(observation[None], np.array([frame])))

    def inputs(
        self, observation: npt.NDArray[np.float32], frame: npt.NDArray[np.integer]
    ) -> dict[str, npt.NDArray[Any]]:
        """What goes into the model, by the names of its tensors, for observations (B, N) and frames (B,)."""
        inputs: dict[str, npt.NDArray[Any]] = {self._observation: observation}
        if self.has_time_step:
            inputs[self._time_step] = frame.astype(self._frame_type)[:, None]
        return inputs


def load_checkpoint(
    path: Path,
    contract_file: Path | None = None,
    robot_joints: tuple[str, ...] | None = None,
    progress: Progress | None = None,
    *,
    verify: bool = True,
) -> Checkpoint:
    """A checkpoint with its contract complete, its widths checked and its first (slow) inference done.

    Args:
        path: the model.
        contract_file: a contract.yaml; None: the one beside the model, if there is one.
        robot_joints: the joints in the robot's own order; only needed where no source names the policy's joints.
        progress: told of each frame while a motion in the graph is read.
        verify: compute the golden vectors that the model carries again, and refuse it if something else comes out.

    Raises:
        InputError: one line that names the file and what is wrong with it.
    """
    model = OnnxModel(path)
    outputs = [tensor.name for tensor in model.outputs]
    contract = assemble_contract(path, model.metadata, contract_file, robot_joints, outputs)
    policy = OnnxPolicy(model, contract.tensors)
    if policy.action_width != contract.action_count:
        raise InputError(
            f"{path}: the model's output is {policy.action_width} wide, "
            f"expected {contract.action_count}, one for each of action_joint_names"
        )
    try:
        answer = policy(np.zeros(policy.observation_width, dtype=np.float32), 0)
    except Exception as error:  # onnxruntime's own types: operators that do not fit show only when they run
        raise InputError(f"{path}: the model fails on an observation of zeros: {first_line(error)}") from None
    if answer.shape != (contract.action_count,):
        raise InputError(f"{path}: the model answers shape {answer.shape}, expected ({contract.action_count},)")
    motion = sweep_motion(policy, contract, progress) if has_graph_motion(policy, contract) else None
    used = find_contract(path) if contract_file is None else contract_file
    checkpoint = Checkpoint(contract, policy, str(path), file_digest(path), policy.observation_width, motion, used)
    if verify and GOLDEN_KEY in model.metadata:
        from humanoid_sim.policy.golden.verify import verify_golden  # noqa: PLC0415 - only stamped models need it

        return replace(checkpoint, golden=verify_golden(checkpoint, model.metadata))
    return checkpoint


def read_contract(
    path: Path, contract_file: Path | None = None, robot_joints: tuple[str, ...] | None = None
) -> PolicyContract:
    """The contract alone, without ONNX Runtime; nothing checks that the model's tensors fit it.

    Raises:
        InputError: as `load_checkpoint`.
    """
    metadata, outputs = read_header(path)
    return assemble_contract(path, metadata, contract_file, robot_joints, outputs)


def _time_step(path: Path, inputs: tuple[Tensor, ...], name: str) -> Tensor | None:
    """The input that selects a frame, by its name; by default the one that is called time_step."""
    tensor = _named(path, "input", inputs, name) if name else None
    if tensor is None:
        tensor = next((tensor for tensor in inputs if tensor.name == _TIME_STEP and len(inputs) > 1), None)
    if tensor is not None and (tensor.type not in _NUMBERS or tensor.width != 1):
        raise InputError(
            f"{path}: input '{tensor.name}' is {tensor.type} of shape {list(tensor.shape)}, "
            "expected a number of shape (1, 1)"
        )
    return tensor


def _named(path: Path, kind: str, tensors: tuple[Tensor, ...], name: str) -> Tensor:
    for tensor in tensors:
        if tensor.name == name:
            return tensor
    raise InputError(f"{path}: has no {kind} '{name}'; its {kind}s are {', '.join(t.name for t in tensors) or 'none'}")


def _vector_width(path: Path, kind: str, tensor: Tensor) -> int:
    if tensor.type != "tensor(float)":
        raise InputError(f"{path}: {kind} '{tensor.name}' is {tensor.type}, expected tensor(float)")
    if tensor.width is None:
        raise InputError(f"{path}: {kind} '{tensor.name}' has shape {list(tensor.shape)}, expected (1, width)")
    return tensor.width
