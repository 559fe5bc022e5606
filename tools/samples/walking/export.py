"""The walking policy as an ONNX file: mirror, network, gait and mirror again in one graph."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import onnx

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.policy.metadata import write_metadata
from tools.samples.graph import SampleGraph, write_model
from tools.samples.walking.aim import NO_AIM, SPEEDS, Aim
from tools.samples.walking.gait import (
    ACTION_MIRROR,
    ACTIONS,
    AHEAD,
    ANSWER_SCALES,
    ANSWERS,
    BIGGEST,
    COMMAND,
    LEAN,
    MOST,
    OBSERVATION_MIRROR,
    OBSERVATIONS,
    PHASE,
    SENSING,
    SIDESTEP,
    STANDS,
    STIRRED,
    STRIDE,
    SWAP,
    SWING,
    TURN,
    VELOCITY_SCALE,
)

__all__ = ["export_walking", "walking_graph"]

NETWORK = "network"
"""Name of the perceptron among the weights."""


def export_walking(
    path: Path, weights: Mapping[str, npt.NDArray[np.float32]], contract: PolicyContract, aim: Aim = NO_AIM
) -> None:
    """Write the policy with its contract's metadata; an existing file is replaced only by a whole one.

    Raises `InputError` if the file cannot be written.

    Args:
        path: of the .onnx file.
        weights: `network.<i>.weight` and `network.<i>.bias` of the linear layers, ELU between them.
        contract: of the environment that it was trained in.
        aim: what the network is told for what is asked.
    """
    write_model(path, walking_graph(weights, aim), write_metadata(contract))


def walking_graph(weights: Mapping[str, npt.NDArray[np.float32]], aim: Aim = NO_AIM) -> onnx.GraphProto:
    """Return a graph from `obs` (B, 53) to `actions` (B, 14); `gait.py` says what it computes, and why."""
    g = SampleGraph(weights)
    asked = g.columns("obs", COMMAND, COMMAND + 1)
    begins, slope = [0.0, *SPEEDS], np.diff([0.0, *aim.ahead], append=aim.ahead[-1]) / np.diff([0.0, *SPEEDS, np.inf])
    bends = g("Relu", g("Sub", asked, g.constant(begins)))
    forward = g("MatMul", bends, g.constant(np.diff(slope, prepend=0.0)[:, None]))
    backward = g("Mul", g("Relu", g("Neg", asked)), g.constant(aim.back))
    aside = g("MatMul", g.columns("obs", COMMAND + 1, COMMAND + 3), g.constant(aim.aside.T))
    told = g("Concat", g("Sub", forward, backward), aside, axis=-1)
    told = g("Min", g("Max", told, g.constant(aim.most[:, 0])), g.constant(aim.most[:, 1]))
    before, after = g.columns("obs", 0, COMMAND), g.columns("obs", COMMAND + 3, OBSERVATIONS)
    observed = _awake(g, g("Concat", before, told, after, axis=-1))
    mirrored = g("Less", g.columns(observed, PHASE, PHASE + 1), g.constant(0.0))

    def mirror(value: str, mirror: tuple[npt.NDArray[np.intp], npt.NDArray[np.float32]], name: str = "") -> str:
        source, sign = mirror
        image = g("Mul", g("Gather", value, g.constant(source, dtype=np.int64), axis=1), g.constant(sign))
        return g("Where", mirrored, image, value, name=name)

    seen = mirror(observed, OBSERVATION_MIRROR)
    answer = g("Clip", g.perceptron(NETWORK, _network_input(g, seen), "Elu"), g.constant(-MOST), g.constant(MOST))
    mirror(_gait(g, seen, answer), ACTION_MIRROR, name="actions")
    return g.build("lite_biped_velocity", obs=OBSERVATIONS, actions=ACTIONS)


def _awake(g: SampleGraph, observed: str) -> str:
    """`awake` of `gait.py`."""
    over_feet = g("MatMul", observed, g.constant(0.5 / VELOCITY_SCALE * SENSING.sum(axis=-1)))
    low, high = STIRRED
    beyond = g("Sub", g("ReduceL2", over_feet, axes=[1]), g.constant(low))
    stirred = g("Clip", g("Div", beyond, g.constant(high - low)), g.constant(0.0), g.constant(1.0))
    command = g("ReduceL2", g.columns(observed, COMMAND, COMMAND + 3), axes=[1])
    share = g("Where", g("Less", command, g.constant(STANDS)), stirred, g.constant(1.0))
    clock = g("Mul", g.columns(observed, PHASE, OBSERVATIONS), share)
    return g("Concat", g.columns(observed, 0, PHASE), clock, axis=-1)


def _network_input(g: SampleGraph, seen: str) -> str:
    """`network_input` of `gait.py`."""
    late = g("Sub", g.constant(1.0), g.columns(seen, PHASE + 1, PHASE + 2))
    stands = g("Clip", g("Div", late, g.constant(SWAP)), g.constant(0.0), g.constant(1.0))
    left, right = (g("MatMul", seen, g.constant(SENSING[:, :, foot])) for foot in range(2))
    velocity = g("Add", left, g("Mul", stands, g("Sub", right, left)))
    return g("Concat", seen, velocity, axis=-1)


def _gait(g: SampleGraph, seen: str, answer: str) -> str:
    """`gait` of `gait.py`, operator by operator."""
    asked = g("Mul", g.columns(answer, ACTIONS, ANSWERS), g.constant(ANSWER_SCALES))
    size = g("Add", g.constant(1.0), g.columns(asked, 0, 1))
    size = g("Clip", size, g.constant(0.0), g.constant(BIGGEST))
    velocity = g("Add", g.columns(seen, COMMAND, COMMAND + 3), g.columns(asked, 1, 4))
    sine, cosine = g.columns(seen, PHASE, PHASE + 1), g.columns(seen, PHASE + 1, PHASE + 2)
    step = g("Mul", cosine, g("MatMul", velocity, g.constant(np.stack([STRIDE, SIDESTEP, TURN]))))
    step = g("Mul", size, g("Add", g("Mul", sine, g.constant(LEAN + SWING)), step))
    ahead = g("Mul", g("Relu", g.columns(seen, COMMAND, COMMAND + 1)), g.constant(AHEAD))
    return g("Add", g("Add", step, ahead), g.columns(answer, 0, ACTIONS))
