"""Write a network of PyTorch as a checkpoint that describes itself."""

from __future__ import annotations

import copy
import io
import os
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx

from humanoid_sim.controllers.contract import PolicyContract, TensorNames
from humanoid_sim.errors import HumanoidSimError, InputError, needing
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.readers.own import STAMP_KEY, encode, write_metadata

_OPSET = 17  # runtimes from 2022 on read it
_PROBES = 64  # observations on which network and file must agree
_TOLERANCE = 1e-4  # of an action, absolute up to 1 and relative beyond: ONNX Runtime sums in another order than PyTorch


def export_policy(network: Any, contract: PolicyContract, output: str | os.PathLike[str]) -> Path:
    """Write a network as ONNX with its contract as metadata, and return the file's path.

    Raises `InputError` if the network's widths are not the contract's, or the file cannot be written.

    Args:
        network: `torch.nn.Module` from observations (B, N), as the contract lists them, to raw actions (B, m). What
            normalises observations in training belongs into it.
        contract: of the environment that it was trained in.
        output: the file (.onnx), which is replaced only by a whole one.
    """
    with needing("torch", "rl", "humanoid_sim.policy.export"):
        import torch  # noqa: PLC0415 - only training has it
    path = output_file(output, "output", ".onnx")
    module = copy.deepcopy(network).cpu().eval()
    width, actions = contract_layout(contract).width, contract.action_count
    probes = torch.as_tensor(np.random.default_rng(0).normal(size=(_PROBES, width)), dtype=torch.float32)
    try:
        with torch.no_grad():
            expected = module(probes).numpy()
    except RuntimeError as error:
        raise InputError(f"network: does not take observations of shape (B, {width}): {error}") from None
    if expected.shape != (_PROBES, actions):
        raise InputError(f"network: gives actions of shape {expected.shape[1:]}, expected ({actions},)")
    graph = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PyTorch prefers its other exporter, which takes ten times as long
        torch.onnx.export(
            module,
            (probes[:1],),
            graph,
            input_names=["obs"],
            output_names=["actions"],
            dynamic_axes={"obs": {0: "batch"}, "actions": {0: "batch"}},
            opset_version=_OPSET,
            dynamo=False,
        )
    model = onnx.load_from_string(graph.getvalue())
    model.graph.name, model.producer_name = path.stem, "humanoid_sim"
    contract = replace(contract, tensors=TensorNames())  # not those of the file that the contract was taken from
    onnx.helper.set_model_props(model, {**write_metadata(contract), STAMP_KEY: encode(contract)})
    with whole_file(path) as file:
        file.write(model.SerializeToString())
    answered = load_checkpoint(path).policy
    actual = np.array([answered(probe, 0) for probe in probes.numpy()])
    worst = float((np.abs(actual - expected) / np.maximum(np.abs(expected), 1.0)).max())
    if not worst <= _TOLERANCE:
        raise HumanoidSimError(f"{path}: its actions differ from the network's by up to {worst:g}")
    return path
