"""The walking policy as an ONNX file: mirror, network, gait and mirror again in one graph."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import onnx

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.policy.metadata import write_metadata
from humanoid_sim.training.graph import Graph, write_model
from humanoid_sim.training.walking.aim import NO_AIM, Aim
from humanoid_sim.training.walking.gait import (
    ACTION_MIRROR,
    ACTIONS,
    AHEAD,
    COMMAND,
    LEAN,
    MOST,
    OBSERVATION_MIRROR,
    OBSERVATIONS,
    PHASE,
    SIDESTEP,
    STRIDE,
    SWING,
    TURN,
)

__all__ = ["export_walking", "walking_graph"]

NETWORK = "network"
"""Name of the perceptron among the weights."""


def export_walking(
    path: Path, weights: Mapping[str, npt.NDArray[np.float32]], contract: PolicyContract, aim: Aim = NO_AIM
) -> None:
    """Write the policy with its contract's metadata; an existing file is replaced only by a whole one.

    Args:
        path: of the .onnx file.
        weights: `network.<i>.weight` and `network.<i>.bias` of the linear layers, ELU between them.
        contract: of the environment that it was trained in.
        aim: what the network is told for what is asked.

    Raises:
        InputError: if the file cannot be written.
    """
    write_model(path, walking_graph(weights, aim), write_metadata(contract))


def walking_graph(weights: Mapping[str, npt.NDArray[np.float32]], aim: Aim = NO_AIM) -> onnx.GraphProto:
    """A graph from `obs` (B, 53) to `actions` (B, 14); `gait.py` says what it computes, and why."""
    g = Graph(weights)
    mirrored = g("Less", g.columns("obs", PHASE, PHASE + 1), g.constant(0.0))

    def mirror(value: str, mirror: tuple[npt.NDArray[np.intp], npt.NDArray[np.float32]], name: str = "") -> str:
        source, sign = mirror
        image = g("Mul", g("Gather", value, g.constant(source, dtype=np.int64), axis=1), g.constant(sign))
        return g("Where", mirrored, image, value, name=name)

    asked = g.columns("obs", COMMAND, COMMAND + 1)
    forward = g("Mul", g("Relu", asked), g.constant(aim.ahead))
    backward = g("Mul", g("Relu", g("Neg", asked)), g.constant(aim.back))
    aside = g("MatMul", g.columns("obs", COMMAND + 1, COMMAND + 3), g.constant(aim.aside.T))
    told = g("Concat", g("Sub", forward, backward), aside, axis=-1)
    told = g("Min", g("Max", told, g.constant(aim.most[:, 0])), g.constant(aim.most[:, 1]))
    before, after = g.columns("obs", 0, COMMAND), g.columns("obs", COMMAND + 3, OBSERVATIONS)
    seen = mirror(g("Concat", before, told, after, axis=-1), OBSERVATION_MIRROR)
    sine, cosine = g.columns(seen, PHASE, PHASE + 1), g.columns(seen, PHASE + 1, PHASE + 2)
    commanded = g("Mul", g.columns(seen, COMMAND, COMMAND + 3), cosine)
    stride = g("MatMul", commanded, g.constant(np.stack([STRIDE, SIDESTEP, TURN])))
    ahead = g("Mul", g("Relu", g.columns(seen, COMMAND, COMMAND + 1)), g.constant(AHEAD))
    step = g("Add", g("Mul", sine, g.constant(LEAN + SWING)), g("Add", stride, ahead))
    added = g("Clip", g.perceptron(NETWORK, seen, "Elu"), g.constant(-MOST), g.constant(MOST))
    mirror(g("Add", step, added), ACTION_MIRROR, name="actions")
    return g.build("lite_biped_velocity", obs=OBSERVATIONS, actions=ACTIONS)
