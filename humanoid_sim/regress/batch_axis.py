"""A batch axis in front of every tensor of a graph that was exported for one observation at a time.

Unlike opening the declared shapes alone, this also serves graphs that fold their batch of one away, for instance to
treat two arms as a batch of two.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import onnx
from onnx import helper, numpy_helper, shape_inference

from humanoid_sim.regress.free_batch import BATCH, UnsupportedGraphError, attribute_of, constants_of, free_first

__all__ = ["with_batch_axis"]

_ELEMENTWISE = frozenset(
    {
        "Abs",
        "Add",
        "And",
        "Cast",
        "Ceil",
        "Clip",
        "Cos",
        "Div",
        "Elu",
        "Equal",
        "Erf",
        "Exp",
        "Floor",
        "Gelu",
        "Greater",
        "HardSigmoid",
        "HardSwish",
        "Identity",
        "LeakyRelu",
        "Less",
        "Log",
        "Max",
        "Min",
        "Mish",
        "Mod",
        "Mul",
        "Neg",
        "Not",
        "Or",
        "Pow",
        "Reciprocal",
        "Relu",
        "Round",
        "Selu",
        "Sigmoid",
        "Sign",
        "Sin",
        "Softplus",
        "Softsign",
        "Sqrt",
        "Sub",
        "Sum",
        "Tanh",
        "Where",
    }
)


def with_batch_axis(model: onnx.ModelProto) -> onnx.ModelProto:
    """A copy in which every tensor that depends on an input has a batch axis in front of its own.

    Matrix products keep their operator, so that they round as before.

    Raises:
        UnsupportedGraphError: if there is an operator that is not known here.
    """
    inferred = shape_inference.infer_shapes(model, strict_mode=True)
    return _Rewriting(inferred).run()


@dataclass
class _Rewriting:
    """One pass over a graph in its (topological) order."""

    model: onnx.ModelProto
    nodes: list[onnx.NodeProto] = field(default_factory=list)
    extra: list[onnx.TensorProto] = field(default_factory=list)
    dynamic: dict[str, str] = field(default_factory=dict)
    """Of each tensor that depends on an input, the name of its batched form."""
    shapes: dict[str, tuple[int, ...]] = field(default_factory=dict)
    """Of the original's tensors."""
    constants: Mapping[str, np.ndarray[Any, Any]] = field(default_factory=dict)

    def run(self) -> onnx.ModelProto:
        graph = self.model.graph
        self.constants = constants_of(graph)
        for value in [*graph.value_info, *graph.input, *graph.output]:
            dimensions = value.type.tensor_type.shape.dim
            if all(dimension.HasField("dim_value") for dimension in dimensions):
                self.shapes[value.name] = tuple(dimension.dim_value for dimension in dimensions)
        inputs = [value for value in graph.input if value.name not in self.constants]
        outputs = list(graph.output)
        for value in inputs:
            # Outside stays (batch, width); inside it is (batch, 1, width).
            self.dynamic[value.name] = self._reshaped(value.name, (-1, *self._shape(value.name)))
        for node in graph.node:
            if any(name in self.dynamic for name in node.input):
                self._rewrite(node)
            else:
                self.nodes.append(node)
        for value in outputs:
            if value.name not in self.dynamic:
                raise UnsupportedGraphError(f"'{value.name}' does not depend on an input")
            inner = self.dynamic[value.name]
            shape = self.constant(np.array([-1, *self._shape(value.name)[1:]]))
            self.nodes.append(helper.make_node("Reshape", [inner, shape], [value.name]))
        for value in [*inputs, *outputs]:
            free_first(value)
        rewritten = helper.make_graph(
            self.nodes, graph.name, inputs, outputs, initializer=[*graph.initializer, *self.extra]
        )
        opsets = self.model.opset_import
        return helper.make_model(rewritten, opset_imports=opsets, ir_version=self.model.ir_version)

    def _rewrite(self, node: onnx.NodeProto) -> None:
        if len(node.output) != 1 or node.domain not in ("", "ai.onnx"):
            raise UnsupportedGraphError(f"operator {node.domain}.{node.op_type} '{node.name}'")
        rule = _RULES.get(node.op_type, _elementwise if node.op_type in _ELEMENTWISE else None)
        if rule is None:
            raise UnsupportedGraphError(f"operator {node.op_type}")
        rule(self, node)

    def _shape(self, name: str) -> tuple[int, ...]:
        if name in self.constants:
            return tuple(self.constants[name].shape)
        if name not in self.shapes:
            raise UnsupportedGraphError(f"'{name}', whose shape is not known")
        return self.shapes[name]

    def constant(self, value: np.ndarray[Any, Any]) -> str:
        """Name of a new constant of whole numbers."""
        name = f"{BATCH}_constant_{len(self.extra)}"
        self.extra.append(numpy_helper.from_array(value.astype(np.int64), name))
        return name

    def known(self, node: onnx.NodeProto, index: int) -> np.ndarray[Any, Any]:
        """The constant that an operator must have as one of its inputs."""
        name = node.input[index]
        if name not in self.constants:
            raise UnsupportedGraphError(f"operator {node.op_type} with a computed {index + 1}. input")
        return self.constants[name]

    def _reshaped(self, name: str, shape: tuple[int, ...]) -> str:
        output = f"{BATCH}_{len(self.nodes)}_{name}"
        self.nodes.append(helper.make_node("Reshape", [name, self.constant(np.array(shape))], [output]))
        return output

    def add(self, node: onnx.NodeProto, inputs: list[str], **attributes: Any) -> None:
        """The operator with other inputs, and some of its attributes replaced."""
        output = f"{BATCH}_{node.output[0]}"
        kept = {a.name: helper.get_attribute_value(a) for a in node.attribute}
        self.nodes.append(helper.make_node(node.op_type, inputs, [output], **(kept | attributes)))
        self.dynamic[node.output[0]] = output

    def batched(self, name: str) -> str:
        """The batched form of an input that must depend on the model's inputs."""
        if name not in self.dynamic:
            raise UnsupportedGraphError(f"'{name}', which is constant where it should not be")
        return self.dynamic[name]

    def padded(self, name: str, rank: int) -> str:
        """An input of an elementwise operator: its own axes lie as far right as before, the batch before all."""
        if name not in self.dynamic:
            return name
        missing = rank - len(self._shape(name))
        batched = self.dynamic[name]
        return self._reshaped(batched, (-1, *[1] * missing, *self._shape(name))) if missing else batched

    def rank(self, name: str) -> int:
        """Number of axes of one of the original's tensors."""
        return len(self._shape(name))

    def reshape(self, node: onnx.NodeProto) -> None:
        """To the same shape as in the original, which is known, whatever the operator's own input says."""
        name = self._reshaped(self.batched(node.input[0]), (-1, *self._shape(node.output[0])))
        self.dynamic[node.output[0]] = name

    def gemm(self, node: onnx.NodeProto) -> None:
        """Two axes are all that the operator knows: batch and rows become one, and two again."""
        if any(name in self.dynamic for name in node.input[1:]) or attribute_of(node, "transA", 0):
            raise UnsupportedGraphError("operator Gemm with computed weights")
        rows = self._shape(node.input[0])
        flat = self._reshaped(self.batched(node.input[0]), (-1, rows[1]))
        bias = self._shape(node.input[2]) if len(node.input) > 2 else ()
        if len(bias) == 2 and bias[0] != 1:
            raise UnsupportedGraphError("operator Gemm with a bias per row")
        self.add(node, [flat, *node.input[1:]])
        self.dynamic[node.output[0]] = self._reshaped(self.dynamic[node.output[0]], (-1, *self._shape(node.output[0])))


def _elementwise(rewriting: _Rewriting, node: onnx.NodeProto) -> None:
    rank = max(rewriting.rank(name) for name in node.input if name)
    rewriting.add(node, [rewriting.padded(name, rank) if name else name for name in node.input])


def _transpose(rewriting: _Rewriting, node: onnx.NodeProto) -> None:
    order = attribute_of(node, "perm", list(reversed(range(rewriting.rank(node.input[0])))))
    rewriting.add(node, [rewriting.batched(node.input[0])], perm=[0, *(axis + 1 for axis in order)])


def _concat(rewriting: _Rewriting, node: onnx.NodeProto) -> None:
    axis = attribute_of(node, "axis", 0) % rewriting.rank(node.input[0])
    rewriting.add(node, [rewriting.batched(name) for name in node.input], axis=axis + 1)


def _gather(rewriting: _Rewriting, node: onnx.NodeProto) -> None:
    rewriting.known(node, 1)
    axis = attribute_of(node, "axis", 0) % rewriting.rank(node.input[0])
    rewriting.add(node, [rewriting.batched(node.input[0]), node.input[1]], axis=axis + 1)


def _slice(rewriting: _Rewriting, node: onnx.NodeProto) -> None:
    if len(node.input) < 3:
        raise UnsupportedGraphError("operator Slice of an old kind")
    starts, rank = rewriting.known(node, 1), rewriting.rank(node.input[0])
    has_axes = len(node.input) > 3 and node.input[3]
    axes = rewriting.known(node, 3) if has_axes else np.arange(len(starts))
    shifted = rewriting.constant(axes % rank + 1)
    steps = list(node.input[4:5])
    rewriting.add(node, [rewriting.batched(node.input[0]), *node.input[1:3], shifted, *steps])


def _matmul(rewriting: _Rewriting, node: onnx.NodeProto) -> None:
    left, right = node.input
    ranks = rewriting.rank(left), rewriting.rank(right)
    if min(ranks) < 2 or (right in rewriting.dynamic and ranks[0] != ranks[1]):
        raise UnsupportedGraphError("operator MatMul of unequal ranks")
    if left not in rewriting.dynamic and ranks[0] > ranks[1]:
        raise UnsupportedGraphError("operator MatMul of unequal ranks")
    rewriting.add(node, [rewriting.dynamic.get(name, name) for name in node.input])


_RULES: Mapping[str, Callable[[_Rewriting, onnx.NodeProto], None]] = {
    "Reshape": _Rewriting.reshape,
    "Flatten": _Rewriting.reshape,
    "Squeeze": _Rewriting.reshape,
    "Unsqueeze": _Rewriting.reshape,
    "Gemm": _Rewriting.gemm,
    "Transpose": _transpose,
    "Concat": _concat,
    "Gather": _gather,
    "Slice": _slice,
    "MatMul": _matmul,
}
