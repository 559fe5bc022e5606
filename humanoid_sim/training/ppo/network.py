"""A trained network of linear layers as plain arrays, and as an ONNX file, written operator by operator."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx
from onnx import TensorProto, helper, numpy_helper

from humanoid_sim.controllers.contract import PolicyContract, TensorNames
from humanoid_sim.errors import HumanoidSimError, InputError
from humanoid_sim.files import whole_file
from humanoid_sim.policy.checkpoint import Checkpoint
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.metadata import write_metadata

Float32Array = npt.NDArray[np.float32]

_OPSET = 17
_IR_VERSION = 8  # of the time of opset 17: runtimes from 2022 on read it
_TOLERANCE = 1e-4
"""Difference of an action, absolute up to 1 and relative beyond: ONNX Runtime adds up in another order than PyTorch."""

_OPERATORS = {"ELU": "Elu", "ReLU": "Relu", "SiLU": "SiLU", "Sigmoid": "Sigmoid", "Tanh": "Tanh"}
"""Activations between linear layers: PyTorch's names, and those that `Graph.perceptron` takes."""


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """Normalised observations through linear layers with an activation between them."""

    mean: Float32Array
    """Shape (N,), in the observation's units."""
    deviation: Float32Array
    """Divisor of observations, shape (N,), > 0."""
    layers: tuple[tuple[Float32Array, Float32Array], ...]
    """Weights (out, in) and bias (out,) of each."""
    bounds: tuple[Float32Array, Float32Array] | None = None
    """Least and greatest raw action, shape (m,) each, that the library let pass; None: any."""
    activation: str = "Elu"
    """Activation as `Graph.perceptron` takes it."""
    largest: float | None = None
    """Magnitude to which normalised observations are clipped; None: not at all."""


def as_array(values: Any) -> Float32Array:
    """Copy a tensor of PyTorch, wherever it is."""
    array: Float32Array = values.detach().cpu().float().numpy().copy()
    return array


def linear_layers(modules: Iterable[Any]) -> dict[str, Any]:
    """Return the fields `layers` and `activation` of `Network` for modules of PyTorch.

    Args:
        modules: one after the other: linear layers, and one kind of activation between them.

    Raises:
        InputError: they are something else.
    """
    from torch import nn  # noqa: PLC0415 - whoever has such modules has it

    operators = {getattr(nn, name): operator for name, operator in _OPERATORS.items()}
    linear: list[Any] = []
    activations: list[str] = []
    for module in modules:
        if isinstance(module, nn.Linear):
            linear.append(module)
        elif type(module) in operators and getattr(module, "alpha", 1.0) == 1.0:
            activations.append(operators[type(module)])
        else:
            known = ", ".join(sorted(_OPERATORS))
            raise InputError(
                f"model: its actor has a {module}, expected linear layers with one of {known} between them"
            )
    if len(set(activations)) > 1 or len(linear) != len(activations) + 1:
        found = f"{len(linear)} linear layers with {', '.join(activations) or 'nothing'} between them"
        raise InputError(f"model: its actor has {found}, expected one activation between every two")
    return {
        "layers": tuple((as_array(layer.weight), _bias(layer)) for layer in linear),
        "activation": activations[0] if activations else "Elu",
    }


def _bias(layer: Any) -> Float32Array:
    return as_array(layer.weight.new_zeros(layer.out_features) if layer.bias is None else layer.bias)


def write_model(path: Path, graph: onnx.GraphProto, metadata: Mapping[str, str]) -> None:
    """Write a graph with its metadata; an existing file is replaced only by a whole one.

    Raises:
        InputError: if the file cannot be written.
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


class Graph:
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

    def build(self, name: str, **ends: int) -> onnx.GraphProto:
        """Build the graph; `ends` are its input and output, with widths. The number of rows is left open."""
        (source, sink) = (
            helper.make_tensor_value_info(name, TensorProto.FLOAT, ("batch", width)) for name, width in ends.items()
        )
        constants = [numpy_helper.from_array(value, name) for name, value in self._constants.items()]
        return helper.make_graph(self._nodes, name, [source], [sink], constants)


def write_network(path: Path, network: Network, contract: PolicyContract, name: str) -> None:
    """Write a policy that describes itself, from `obs` (B, N) to `actions` (B, m), without golden vectors.

    An existing file is replaced only by a whole one.

    Raises:
        InputError: the file cannot be written.
    """
    weights = {}
    for i, (weight, bias) in enumerate(network.layers):
        weights[f"network.{i}.weight"], weights[f"network.{i}.bias"] = weight, bias
    g = Graph(weights)
    seen = g("Div", g("Sub", "obs", g.constant(network.mean)), g.constant(network.deviation))
    if network.largest is not None:
        seen = g("Clip", seen, *(g.constant(bound) for bound in (-network.largest, network.largest)))
    answer = g.perceptron("network", seen, network.activation)
    if network.bounds is None:
        g("Identity", answer, name="actions")
    else:
        low, high = (g.constant(bound) for bound in network.bounds)
        g("Min", g("Max", answer, low), high, name="actions")
    contract = replace(contract, tensors=TensorNames())  # of the model that the contract was taken from
    metadata = {**write_metadata(contract), STAMP_KEY: encode(contract)}
    graph = g.build(name, obs=len(network.mean), actions=len(network.layers[-1][1]))
    write_model(path, graph, metadata)


def require_same_answers(
    checkpoint: Checkpoint, observations: npt.NDArray[np.float32], expected: npt.NDArray[np.float32]
) -> None:
    """Compare the checkpoint's actions on observations (k, N) with those of the network, (k, m).

    Raises:
        HumanoidSimError: they differ: a defect of the export.
    """
    actual = np.array([checkpoint.policy(observation, 0) for observation in observations])
    worst = float((np.abs(actual - expected) / np.maximum(np.abs(expected), 1.0)).max())
    if not worst <= _TOLERANCE:
        raise HumanoidSimError(f"{checkpoint.source}: its actions differ from the network's by up to {worst:g}")
