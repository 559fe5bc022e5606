"""Copies of a policy that are worse on purpose, and small networks of other shapes than exporters usually write."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
from onnx import helper, numpy_helper

from humanoid_sim.assets import asset_path
from humanoid_sim.policy.golden.samples import GOLDEN_KEY

__all__ = ["SAMPLE", "failing_copy", "noisy_copy", "swapped_copy"]

SAMPLE = asset_path("policies", "lite_tracking.onnx")


def noisy_copy(path: Path, output: Path, scale: float, seed: int = 0) -> Path:
    """Every weight multiplied by 1 + scale · N(0, 1)."""
    model = _load(path)
    generator = np.random.default_rng(seed)
    for tensor in model.graph.initializer:
        values = numpy_helper.to_array(tensor)
        if tensor.name.endswith(".weight"):
            noisy = values * (1.0 + scale * generator.standard_normal(values.shape))
            tensor.CopyFrom(numpy_helper.from_array(noisy.astype(values.dtype), tensor.name))
    return _save(model, output)


def swapped_copy(path: Path, output: Path, first: int, second: int) -> Path:
    """Two of the action's values in each other's place."""
    model = _load(path)
    width = model.graph.output[0].type.tensor_type.shape.dim[1].dim_value
    order = np.arange(width)
    order[[first, second]] = second, first
    model.graph.initializer.append(numpy_helper.from_array(order, "swapped_order"))
    _behind_output(
        model, lambda source, target: helper.make_node("Gather", [source, "swapped_order"], [target], axis=1)
    )
    return _save(model, output)


def failing_copy(path: Path, output: Path, value: float = float("nan")) -> Path:
    """Every action plus a value: not a number, or beyond the limit."""
    model = _load(path)
    model.graph.initializer.append(numpy_helper.from_array(np.array([value], dtype=np.float32), "failing_value"))
    _behind_output(model, lambda source, target: helper.make_node("Add", [source, "failing_value"], [target]))
    return _save(model, output)


def _behind_output(model, node) -> None:
    """Put an operator between what computes the action and the model's output."""
    name = model.graph.output[0].name
    for other in model.graph.node:
        for i, output in enumerate(other.output):
            if output == name:
                other.output[i] = "before_the_change"
    model.graph.node.append(node("before_the_change", name))


def _load(path: Path):
    model = onnx.load(str(path))
    kept = [entry for entry in model.metadata_props if entry.key != GOLDEN_KEY]
    copies = [type(entry).FromString(entry.SerializeToString()) for entry in kept]
    del model.metadata_props[:]
    model.metadata_props.extend(copies)
    return model


def _save(model, output: Path) -> Path:
    onnx.save(model, str(output))
    return output
