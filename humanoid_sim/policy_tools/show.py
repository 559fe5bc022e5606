"""`policy show`: the contract of a checkpoint as one table, and what was found and not used."""

from __future__ import annotations

import json
import os
import sys
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.cli import ExitStatus
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.observation import ObservationLayout
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import regular_file
from humanoid_sim.policy import describe
from humanoid_sim.policy.checkpoint import Checkpoint, file_digest, load_checkpoint, read_model
from humanoid_sim.policy.golden import verify_golden
from humanoid_sim.policy.layers import Reading
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.onnx_policy import OnnxModel
from humanoid_sim.policy.readers.own import own_contract
from humanoid_sim.policy_tools import Show
from humanoid_sim.robots.description import load_robot

_PIPE_WIDTH = 160
"""Columns of tables where no terminal says how many there are."""


def show(options: Show) -> int:
    """Print the contract of a checkpoint; exit status 1 if it cannot be used as it is."""
    joints = None if options.robot is None else load_robot(options.robot).joint_names
    if options.contract is not None:
        regular_file(options.contract, "a contract.yaml")
    model = OnnxModel(options.checkpoint)
    reading = read_model(model, options.contract, joints)
    refusal = reading.refusal(own_contract(options.checkpoint).name)
    checkpoint, golden = None, ""
    if not refusal:
        checkpoint = load_checkpoint(options.checkpoint, options.contract, joints, verify=False)
        golden, refusal = _golden_verdict(checkpoint)
    if options.json:
        print(json.dumps(_document(model, reading) | {"golden": golden, "refusal": refusal}, indent=2, allow_nan=False))
        return ExitStatus.of(not refusal)
    console = make_console()
    _print(console, model, reading, checkpoint, golden)
    if options.joints and reading.contract is not None:
        console.print(_joints(reading.contract))
    if refusal:
        console.print(f"[red]{escape(refusal)}[/red]", soft_wrap=True)
    return ExitStatus.of(not refusal)


def print_checkpoint(console: Console, checkpoint: Checkpoint) -> None:
    """Print what is known of a checkpoint that is complete."""
    if checkpoint.model is not None and checkpoint.reading is not None:
        _print(console, checkpoint.model, checkpoint.reading, checkpoint, _golden_verdict(checkpoint)[0])


def checkpoint_document(checkpoint: Checkpoint) -> dict[str, Any]:
    """Return what is known of a checkpoint that is complete, for JSON."""
    if checkpoint.model is None or checkpoint.reading is None:
        return {}
    golden, refusal = _golden_verdict(checkpoint)
    return _document(checkpoint.model, checkpoint.reading) | {"golden": golden, "refusal": refusal}


def _document(model: OnnxModel, reading: Reading) -> dict[str, Any]:
    groups = {"inputs": model.inputs, "outputs": model.outputs}
    tensors = {name: [tensor._asdict() for tensor in group] for name, group in groups.items()}
    head = {"checkpoint": str(model.path), "sha256": file_digest(model.path), **tensors}
    return head | describe.document(reading, _layout(reading, model))


def _layout(reading: Reading, model: OnnxModel) -> ObservationLayout | None:
    try:
        return None if reading.outline is None else contract_layout(reading.outline, model.width)
    except FieldError:
        return None


def _golden_verdict(checkpoint: Checkpoint) -> tuple[str, str]:
    """Return what the golden vectors are worth, and what is wrong with them."""
    try:
        return verify_golden(checkpoint), ""
    except InputError as error:
        return "", str(error).removeprefix(f"{checkpoint.source}: ")


def _print(console: Console, model: OnnxModel, reading: Reading, checkpoint: Checkpoint | None, golden: str) -> None:
    tensors = (f"{tensor.name} {list(tensor.shape)}" for tensor in (*model.inputs, *model.outputs))
    console.print(escape(f"{model.path}: {', '.join(tensors)}"), soft_wrap=True)
    table = Table("field", "value", "source", box=None, pad_edge=False)
    for row in describe.reading_lines(reading, _layout(reading, model)):
        replaced = f" (replaces {row.replaced})" if row.replaced else ""
        style = "yellow" if row.is_assumed else ""
        table.add_row(escape(row.name), escape(row.value), escape(row.source + replaced), style=style)
    if checkpoint is not None and checkpoint.motion is not None:
        motion = checkpoint.motion
        table.add_row("motion", f"{len(motion.frames)} frames, {motion.duration:.2f} s", "model")
    if golden:
        table.add_row("golden vectors", escape(golden), "metadata")
    console.print(table)
    for line in reading.unused:
        console.print(f"[yellow]not used: {escape(line)}[/yellow]", soft_wrap=True)


def _joints(contract: PolicyContract) -> Table:
    assert contract.action_offset is not None  # filled in at construction
    table = Table("", "joint", "K_p", "K_d", "pose rad", "action", "scale rad", "offset rad", box=None, pad_edge=False)
    driven = contract.action_joint_names
    for i, name in enumerate(contract.joint_names):
        gains = (contract.joint_stiffness[i], contract.joint_damping[i], contract.default_joint_pos[i])
        cells = ["held at 0", "", ""]
        if name in driven:
            k = driven.index(name)
            cells = [str(k), f"{contract.action_scale[k]:g}", f"{contract.action_offset[k]:g}"]
        table.add_row(str(i), escape(name), *(f"{value:g}" for value in gains), *cells)
    return table


def make_console() -> Console:
    """Return standard output, wide enough for tables where it is not a terminal."""
    wide = None if sys.stdout.isatty() or "COLUMNS" in os.environ else _PIPE_WIDTH
    return Console(highlight=False, width=wide)
