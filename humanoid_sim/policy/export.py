"""Write a network of PyTorch as a checkpoint that describes itself."""

from __future__ import annotations

import copy
import io
import os
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import onnx

from humanoid_sim.controllers.contract import PolicyContract, TensorNames
from humanoid_sim.errors import blaming, needing
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.readers.own import STAMP_KEY, encode, write_metadata

_OPSET = 17  # runtimes from 2022 on read it


def export_policy(network: Any, contract: PolicyContract, output: str | os.PathLike[str]) -> Path:
    """Write a `torch.nn.Module` from observations (B, N) to raw actions (B, m) as ONNX, and return the file's path.

    What normalises observations in training belongs into it.
    """
    with needing("torch", "rl", "humanoid_sim.policy.export"):
        import torch  # noqa: PLC0415 - only training has it
    path = output_file(output, "output", ".onnx")
    module, graph, width = copy.deepcopy(network).cpu().eval(), io.BytesIO(), contract_layout(contract).width
    with warnings.catch_warnings(), blaming(f"network: does not take observations of shape (B, {width})", RuntimeError):
        warnings.simplefilter("ignore")  # PyTorch prefers its other exporter, which takes ten times as long
        torch.onnx.export(
            module,
            (torch.zeros(1, width),),
            graph,
            input_names=["obs"],
            output_names=["actions"],
            dynamic_axes={"obs": {0: "batch"}, "actions": {0: "batch"}},
            opset_version=_OPSET,
            dynamo=False,
        )
    model = onnx.load_from_string(graph.getvalue())
    contract = replace(contract, tensors=TensorNames())  # not those of the file that the contract was taken from
    onnx.helper.set_model_props(model, {**write_metadata(contract), STAMP_KEY: encode(contract)})
    with whole_file(path) as file:
        file.write(model.SerializeToString())
    load_checkpoint(path)
    return path
