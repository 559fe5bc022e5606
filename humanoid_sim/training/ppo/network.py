"""A trained network of linear layers as plain arrays, and as an ONNX file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx

from humanoid_sim.controllers.contract import PolicyContract, TensorNames
from humanoid_sim.policy.contract_json import STAMP_KEY, encode
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.training.graph import Graph, write_model

__all__ = ["ACTIVATIONS", "Network", "network_graph", "write_network"]

Float32Array = npt.NDArray[np.float32]

_LAYERS = "network"

ACTIVATIONS: Mapping[str, Callable[[Any], Any]] = MappingProxyType(
    {
        "Elu": lambda value: np.where(value > 0.0, value, np.expm1(np.minimum(value, 0.0))),
        "Relu": lambda value: np.maximum(value, 0.0),
        "SiLU": lambda value: value / (1.0 + np.exp(-value)),
        "Sigmoid": lambda value: 1.0 / (1.0 + np.exp(-value)),
        "Tanh": np.tanh,
    }
)
"""What may be between linear layers, by the name that `Graph.perceptron` takes."""


@dataclass(frozen=True, slots=True, eq=False)
class Network:
    """Normalised observations through linear layers with an activation between them."""

    mean: Float32Array
    """Shape (N,), in the observation's units."""
    deviation: Float32Array
    """Shape (N,), > 0: what observations are divided by."""
    layers: tuple[tuple[Float32Array, Float32Array], ...]
    """Weights (out, in) and bias (out,) of each."""
    bounds: tuple[Float32Array, Float32Array] | None = None
    """Least and greatest raw action, shape (m,) each, that the library let pass; None: any."""
    activation: str = "Elu"
    """One of `ACTIVATIONS`."""
    largest: float | None = None
    """Magnitude to which normalised observations are clipped; None: not at all."""

    def __call__(self, observation: Float32Array) -> Float32Array:
        """Raw actions (..., m) for observations (..., N)."""
        value = (observation - self.mean) / self.deviation
        if self.largest is not None:
            value = np.clip(value, -self.largest, self.largest)
        for i, (weight, bias) in enumerate(self.layers):
            value = value @ weight.T + bias
            if i < len(self.layers) - 1:
                value = ACTIVATIONS[self.activation](value)
        return (value if self.bounds is None else np.clip(value, *self.bounds)).astype(np.float32)


def network_graph(network: Network, name: str) -> onnx.GraphProto:
    """The network as a graph from `obs` (B, N) to `actions` (B, m)."""
    weights = {}
    for i, (weight, bias) in enumerate(network.layers):
        weights[f"{_LAYERS}.{i}.weight"], weights[f"{_LAYERS}.{i}.bias"] = weight, bias
    g = Graph(weights)
    seen = g("Div", g("Sub", "obs", g.constant(network.mean)), g.constant(network.deviation))
    if network.largest is not None:
        seen = g("Clip", seen, *(g.constant(bound) for bound in (-network.largest, network.largest)))
    answer = g.perceptron(_LAYERS, seen, network.activation)
    if network.bounds is None:
        g("Identity", answer, name="actions")
    else:
        low, high = (g.constant(bound) for bound in network.bounds)
        g("Min", g("Max", answer, low), high, name="actions")
    return g.build(name, obs=len(network.mean), actions=len(network.layers[-1][1]))


def write_network(path: Path, network: Network, contract: PolicyContract, name: str) -> None:
    """Write a policy that describes itself, without golden vectors; an existing file is replaced only by a whole one.

    Raises:
        InputError: the file cannot be written.
    """
    contract = replace(contract, tensors=TensorNames())  # of the model that the contract was taken from
    metadata = {**write_metadata(contract), STAMP_KEY: encode(contract)}
    write_model(path, network_graph(network, name), metadata)
