"""Give a model that was exported for one observation at a time a free batch dimension, in memory.

Exporters write the batch of one into the graph: into the declared shapes, and often into the constants of `Reshape`.
`with_free_shapes` opens the declared shapes, which is enough for most plain networks, whatever their operators;
`humanoid_sim.regress.batch_axis` serves more graphs, of known operators. Whoever runs the result of either must compare
it with the original.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import helper, numpy_helper

__all__ = [
    "BATCH",
    "UnsupportedGraphError",
    "attribute_of",
    "constants_of",
    "free_first",
    "read_graph",
    "with_free_shapes",
]

BATCH = "batch"
"""Name of the free dimension."""


class UnsupportedGraphError(Exception):
    """The graph has an operator, or a use of one, that the rewriting does not know; the message names it."""


def read_graph(path: Path, output: str) -> onnx.ModelProto:
    """The part of a model that `output` is computed by: a motion that shares the graph costs time at every step."""
    model = onnx.load(str(path))
    wanted, nodes = {output}, []
    for node in reversed(model.graph.node):
        if wanted.intersection(node.output):
            nodes.append(node)
            wanted.update(node.input)
            for attribute in node.attribute:
                if attribute.type in (onnx.AttributeProto.GRAPH, onnx.AttributeProto.GRAPHS):
                    raise UnsupportedGraphError(f"{node.op_type} with a graph inside")
    graph = model.graph
    _keep(graph.node, list(reversed(nodes)))
    _keep(graph.output, [value for value in graph.output if value.name == output])
    _keep(graph.input, [value for value in graph.input if value.name in wanted])
    _keep(graph.initializer, [value for value in graph.initializer if value.name in wanted])
    return model


def _keep(field_: Any, values: list[Any]) -> None:
    copies = [type(value).FromString(value.SerializeToString()) for value in values]
    del field_[:]
    field_.extend(copies)


def with_free_shapes(model: onnx.ModelProto) -> onnx.ModelProto:
    """A copy whose declared shapes leave the first dimension open, and whose `Reshape`s do not fix it."""
    freed: onnx.ModelProto = onnx.ModelProto.FromString(model.SerializeToString())
    graph = freed.graph
    constants = constants_of(graph)
    del graph.value_info[:]
    names = {value.name for value in graph.initializer}
    for value in [*graph.input, *graph.output]:
        if value.name not in names:
            free_first(value)
    for i, node in enumerate(graph.node):
        shape = constants.get(node.input[1]) if node.op_type == "Reshape" else None
        if shape is not None and shape.size and shape[0] == 1:
            open_shape = np.concatenate([[0 if -1 in shape else -1], shape[1:]]).astype(np.int64)
            name = f"{BATCH}_shape_{i}"
            graph.initializer.append(numpy_helper.from_array(open_shape, name))
            node.input[1] = name
    return freed


def free_first(value: onnx.ValueInfoProto) -> None:
    """Leave the first dimension of a model's input or output open."""
    dimensions = value.type.tensor_type.shape.dim
    if not len(dimensions):
        raise UnsupportedGraphError(f"'{value.name}' has no dimension")
    dimensions[0].dim_param = BATCH


def attribute_of(node: onnx.NodeProto, name: str, default: Any) -> Any:
    """An operator's attribute, or its default."""
    return next((helper.get_attribute_value(a) for a in node.attribute if a.name == name), default)


def constants_of(graph: onnx.GraphProto) -> dict[str, np.ndarray[Any, Any]]:
    """Initializers and `Constant` nodes by name."""
    found = {value.name: numpy_helper.to_array(value) for value in graph.initializer}
    for node in graph.node:
        if node.op_type == "Constant":
            value = attribute_of(node, "value", None)
            if value is not None:
                found[node.output[0]] = numpy_helper.to_array(value)
    return found
