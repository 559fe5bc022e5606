"""Contracts, and tiny ONNX models, made as exporters make them."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.policy.readers.own import write_metadata

JOINTS = ("a", "b", "c")


def contract_of(joints: Sequence[str], **changes: Any) -> PolicyContract:
    """A contract of a policy that walks, at 50 Hz, and drives these joints."""
    values: dict[str, Any] = {
        "task_type": "locomotion",
        "joint_names": joints,
        "action_joint_names": joints,
        "joint_stiffness": 1.0,
        "joint_damping": 1.0,
        "default_joint_pos": 0.0,
        "observation": ("joint_pos", "joint_vel", "actions"),
        "command_names": (),
        "action_scale": 1.0,
        "policy_dt": 0.02,
        "body_names": (),
    }
    return PolicyContract(**{**values, **changes})


def contract(**changes: Any) -> PolicyContract:
    """Three joints, two of them driven; the observation is 3 + 3 + 2 = 8 wide."""
    values: dict[str, Any] = {
        "action_joint_names": ("c", "a"),
        "joint_stiffness": [50.0, 40.0, 30.0],
        "joint_damping": [2.0, 1.5, 1.0],
        "default_joint_pos": [0.1, 0.2, 0.3],
        "action_scale": [0.5, 0.25],
    }
    return contract_of(JOINTS, **{**values, **changes})


def weights(rows: int, columns: int) -> np.ndarray:
    """Any fixed numbers that differ."""
    return np.arange(rows * columns, dtype=np.float32).reshape(rows, columns) / (rows * columns)


def linear_model(
    metadata: Mapping[str, str] | None = None,
    *,
    matrix: np.ndarray | None = None,
    inputs: int = 8,
    outputs: int = 2,
    input_shape: Sequence[int | str] | None = None,
    output_shape: Sequence[int | str] | None = None,
    dtype: int = TensorProto.FLOAT,
) -> onnx.ModelProto:
    """`action = observation · weights`; `matrix`: these weights, whose shape then says how many there are."""
    matrix = weights(inputs, outputs) if matrix is None else matrix
    inputs, outputs = matrix.shape
    kind = helper.tensor_dtype_to_np_dtype(dtype)
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["observation", "weights"], ["action"])],
        "policy",
        [helper.make_tensor_value_info("observation", dtype, input_shape or [1, inputs])],
        [helper.make_tensor_value_info("action", dtype, output_shape or [1, outputs])],
        [numpy_helper.from_array(matrix.astype(kind), "weights")],
    )
    return finished(graph, metadata)


def finished(graph: onnx.GraphProto, metadata: Mapping[str, str] | None) -> onnx.ModelProto:
    """A model of a graph, with metadata: by default that of `contract()`."""
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    for key, value in (write_metadata(contract()) if metadata is None else metadata).items():
        entry = model.metadata_props.add()
        entry.key, entry.value = key, value
    return model


def saved(path: Path, model: onnx.ModelProto | None = None) -> Path:
    """Write a model (by default the one that fits `contract()`) and return its path."""
    onnx.save(linear_model() if model is None else model, str(path))
    return path
