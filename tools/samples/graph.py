"""Networks of the sample policies as ONNX, written operator by operator."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx
from onnx import TensorProto, helper, numpy_helper

from humanoid_sim.files import whole_file

__all__ = ["SampleGraph", "write_model"]

_OPSET = 17
_IR_VERSION = 8  # of the time of opset 17: runtimes from 2022 on read it


def write_model(path: Path, graph: onnx.GraphProto, metadata: Mapping[str, str]) -> None:
    """Write a graph with its metadata; an existing file is replaced only by a whole one.

    Raises `InputError` if the file cannot be written.
    """
    model = helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("", _OPSET)],
        ir_version=_IR_VERSION,
        producer_name="humanoid_sim.training",
    )
    helper.set_model_props(model, dict(metadata))
    onnx.checker.check_model(model, full_check=True)
    with whole_file(path) as file:
        file.write(model.SerializeToString())


class SampleGraph:
    """Collects nodes and constants; every method returns the name of a value."""

    def __init__(self, weights: Mapping[str, npt.NDArray[np.float32]]) -> None:
        """Begin.

        Args:
            weights: of the network, by the names of its parameters.
        """
        self._weights = weights
        self._nodes: list[onnx.NodeProto] = []
        self._constants: dict[str, npt.NDArray[np.generic]] = {}

    def __call__(self, operator: str, *inputs: str, name: str = "", **attributes: Any) -> str:
        """Return a node's output."""
        output = name or f"{operator.lower()}_{len(self._nodes)}"
        self._nodes.append(helper.make_node(operator, list(inputs), [output], name=output, **attributes))
        return output

    def constant(self, value: npt.ArrayLike, name: str = "", dtype: type = np.float32) -> str:
        """Return an array that is stored in the graph."""
        name = name or f"constant_{len(self._constants)}"
        self._constants[name] = np.asarray(value, dtype=dtype)
        return name

    def perceptron(self, name: str, value: str, activation: str = "SiLU") -> str:
        """Add linear layers with an activation between them: SiLU, or an operator's name."""
        layers = sorted({int(key.split(".")[1]) for key in self._weights if key.startswith(f"{name}.")})
        for layer in layers:
            kernel, bias = (
                self.constant(self._weights[f"{name}.{layer}.{kind}"], f"{name}.{layer}.{kind}")
                for kind in ("weight", "bias")
            )
            value = self("Gemm", value, kernel, bias, name=f"{name}.{layer}", transB=1)
            if layer != layers[-1]:
                value = self("Mul", value, self("Sigmoid", value)) if activation == "SiLU" else self(activation, value)
        return value

    def columns(self, value: str, start: int, stop: int) -> str:
        """Part of the second axis."""
        bounds = [self.constant([bound], dtype=np.int64) for bound in (start, stop, 1)]
        return self("Slice", value, *bounds)

    def reshape(self, value: str, *shape: int, name: str = "") -> str:
        """Return the same values in another shape."""
        return self("Reshape", value, self.constant(shape, dtype=np.int64), name=name)

    def pick(self, value: str, body: int) -> str:
        """One body of (arms, bodies, ...)."""
        return self("Gather", value, self.constant(body, dtype=np.int64), axis=1)

    def cross(self, columns: str) -> str:
        """Third columns (2 B, 2, 3, 1) of rotation matrices from the first two, (2 B, 2, 3, 2)."""
        x, y = (self("Gather", columns, self.constant([i], dtype=np.int64), axis=3) for i in (0, 1))
        forward, backward = (self.constant(order, dtype=np.int64) for order in ([1, 2, 0], [2, 0, 1]))
        plus = self("Mul", self("Gather", x, forward, axis=2), self("Gather", y, backward, axis=2))
        minus = self("Mul", self("Gather", x, backward, axis=2), self("Gather", y, forward, axis=2))
        return self("Sub", plus, minus)

    def build(self, name: str, **ends: int) -> onnx.GraphProto:
        """Build the graph; `ends` are its input and output, with widths. The number of rows is left open."""
        (source, sink) = (
            helper.make_tensor_value_info(name, TensorProto.FLOAT, ("batch", width)) for name, width in ends.items()
        )
        constants = [numpy_helper.from_array(value, name) for name, value in self._constants.items()]
        return helper.make_graph(self._nodes, name, [source], [sink], constants)
