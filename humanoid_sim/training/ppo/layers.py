"""PyTorch's linear layers as arrays."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from torch import Tensor, nn

from humanoid_sim.errors import InputError
from humanoid_sim.training.ppo.network import ACTIVATIONS, Float32Array

__all__ = ["as_array", "linear_layers"]

_NAMES: dict[type[nn.Module], str] = {
    nn.ELU: "Elu",
    nn.ReLU: "Relu",
    nn.SiLU: "SiLU",
    nn.Sigmoid: "Sigmoid",
    nn.Tanh: "Tanh",
}
assert set(_NAMES.values()) == set(ACTIVATIONS)


def as_array(values: Tensor) -> Float32Array:
    """A copy, wherever the tensor is."""
    array: Float32Array = values.detach().cpu().float().numpy().copy()
    return array


def linear_layers(modules: Iterable[nn.Module]) -> dict[str, Any]:
    """The fields `layers` and `activation` of `Network`.

    Args:
        modules: one after the other: linear layers, and one kind of activation between them.

    Raises:
        InputError: they are something else.
    """
    linear: list[nn.Linear] = []
    activations: list[str] = []
    for module in modules:
        if isinstance(module, nn.Linear):
            linear.append(module)
        elif type(module) in _NAMES and getattr(module, "alpha", 1.0) == 1.0:
            activations.append(_NAMES[type(module)])
        else:
            known = ", ".join(sorted(kind.__name__ for kind in _NAMES))
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


def _bias(layer: nn.Linear) -> Float32Array:
    return as_array(layer.weight.new_zeros(layer.out_features) if layer.bias is None else layer.bias)
