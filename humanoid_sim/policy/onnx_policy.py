"""ONNX Runtime around a checkpoint: one thread, one observation in, one action out."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import InputError
from humanoid_sim.policy.checkpoint import Checkpoint, file_digest
from humanoid_sim.policy.metadata import parse_metadata

__all__ = ["OnnxPolicy", "has_onnxruntime", "load_checkpoint", "read_metadata"]


def _onnxruntime() -> Any:
    """ONNX Runtime, imported when it is first needed, because it is heavy and may be missing.

    By default it keeps a database in the user's home and reports to its makers from a thread of its own: nothing that
    belongs beside a control loop, on a machine that may be offline.
    """
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime  # noqa: PLC0415 - see above

    return onnxruntime


def has_onnxruntime() -> bool:
    """Whether ONNX Runtime can be imported on this machine."""
    try:
        _onnxruntime()
    except ImportError:
        return False
    return True


class OnnxPolicy:
    """`(observation (N,), frame) -> action (m,)`, float32.

    One thread and sequential execution: results do not depend on the machine's load, and no pool of spinning workers
    competes with the control loop.
    """

    def __init__(self, path: Path) -> None:
        """Load a model and check its form.

        Raises:
            InputError: if the file is no ONNX model, its external tensors are missing, or its inputs and outputs are
                not one float32 (1, N) and at least one float32 (1, M).
        """
        onnxruntime = _onnxruntime()
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        options.inter_op_num_threads = 1
        options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
        options.log_severity_level = 4  # what it would log reaches the user through the exception
        try:
            self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        except Exception as error:  # onnxruntime raises its own types, which differ between builds
            raise InputError(f"{path}: is not a model that ONNX Runtime can load: {_first_line(error)}") from None
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        if len(inputs) != 1 or not outputs:
            names = ", ".join(node.name for node in inputs) or "none"
            raise InputError(
                f"{path}: has the inputs {names} and {len(outputs)} outputs, expected one input and an output"
            )
        self.observation_width = _vector_width(path, "input", inputs[0])
        self.action_width = _vector_width(path, "output", outputs[0])
        self.metadata: dict[str, str] = dict(self._session.get_modelmeta().custom_metadata_map)
        self._input = inputs[0].name
        self._outputs = [outputs[0].name]

    def __call__(self, observation: npt.NDArray[np.float32], frame: int) -> npt.NDArray[np.float32]:
        """One inference."""
        action: npt.NDArray[np.float32] = self._session.run(self._outputs, {self._input: observation[None]})[0][0]
        return action


def load_checkpoint(path: Path) -> Checkpoint:
    """A checkpoint with its contract read, its widths checked and its first (slow) inference done.

    Raises:
        InputError: one line that names the file and what is wrong with it.
    """
    _check_file(path)
    policy = OnnxPolicy(path)
    contract = parse_metadata(policy.metadata, str(path))
    if policy.action_width != contract.action_count:
        raise InputError(
            f"{path}: the model's output is {policy.action_width} wide, "
            f"expected {contract.action_count}, one for each of action_joint_names"
        )
    try:
        answer = policy(np.zeros(policy.observation_width, dtype=np.float32), 0)
    except Exception as error:  # onnxruntime's own types: operators that do not fit show only when they run
        raise InputError(f"{path}: the model fails on an observation of zeros: {_first_line(error)}") from None
    if answer.shape != (contract.action_count,):
        raise InputError(f"{path}: the model answers shape {answer.shape}, expected ({contract.action_count},)")
    return Checkpoint(contract, policy, str(path), file_digest(path), policy.observation_width)


def read_metadata(path: Path) -> dict[str, str]:
    """The metadata of a checkpoint without ONNX Runtime.

    Raises:
        InputError: if the file is no ONNX model.
    """
    import onnx  # noqa: PLC0415 - heavy, and only needed where onnxruntime is missing

    _check_file(path)
    try:
        model = onnx.load(str(path), load_external_data=False)
    except Exception as error:  # protobuf's exception type is not part of onnx's interface
        raise InputError(f"{path}: is not an ONNX model: {_first_line(error)}") from None
    return {entry.key: entry.value for entry in model.metadata_props}


def _check_file(path: Path) -> None:
    if path.is_dir():
        raise InputError(f"{path}: is a directory, expected an ONNX file")
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected an ONNX file")
    if path.stat().st_size == 0:
        raise InputError(f"{path}: is empty, expected an ONNX file")


def _vector_width(path: Path, kind: str, node: Any) -> int:
    if node.type != "tensor(float)":
        raise InputError(f"{path}: {kind} '{node.name}' is {node.type}, expected tensor(float)")
    shape = node.shape
    if len(shape) != 2 or (isinstance(shape[0], int) and shape[0] != 1) or not isinstance(shape[1], int):
        raise InputError(f"{path}: {kind} '{node.name}' has shape {shape}, expected (1, width)")
    return int(shape[1])


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
