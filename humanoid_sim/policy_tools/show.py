"""`policy show`: everything that is known of a checkpoint, and where each value came from."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.cli import ExitStatus
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.observation import ObservationLayout
from humanoid_sim.controllers.terms import TERM_KINDS
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import regular_file, whole_file
from humanoid_sim.policy import describe
from humanoid_sim.policy.checkpoint import Checkpoint, file_digest, load_checkpoint, read_model
from humanoid_sim.policy.golden import verify_golden
from humanoid_sim.policy.layers import Reading, outline
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
    hand = own_contract(options.checkpoint)
    refusal = reading.refusal(hand.name)
    layout, checkpoint, golden = _layout(reading, model), None, ""
    if not refusal:
        checkpoint = load_checkpoint(options.checkpoint, options.contract, joints, verify=False)
        golden, refusal = golden_verdict(checkpoint)
    if options.skeleton is not None and reading.missing:
        with whole_file(options.skeleton) as stream:
            stream.write("".join(f"{line}\n" for line in _skeleton(options.checkpoint, reading)).encode())
    if options.json:
        found = {**_model(model), **describe.document(reading, layout), "golden": golden, "refusal": refusal}
        print(json.dumps(found, indent=2, allow_nan=False))
        return ExitStatus.of(not refusal)
    console = make_console()
    _print_head(console, model, reading, layout, checkpoint, golden)
    if options.joints and reading.contract is not None:
        console.print(_joints(reading.contract))
    if refusal:
        console.print(f"[red]{escape(refusal)}[/red]", soft_wrap=True)
    return ExitStatus.of(not refusal)


def _layout(reading: Reading, model: OnnxModel) -> ObservationLayout | None:
    contract = outline(reading)
    widths = [tensor.width for tensor in model.inputs if tensor.width is not None]
    try:
        return None if contract is None else contract_layout(contract, max(widths, default=None))
    except FieldError:
        return None


def golden_verdict(checkpoint: Checkpoint) -> tuple[str, str]:
    """Return what the golden vectors are worth, and what is wrong with them."""
    try:
        return verify_golden(checkpoint), ""
    except InputError as error:
        return "", str(error).removeprefix(f"{checkpoint.source}: ")


def print_checkpoint(console: Console, checkpoint: Checkpoint) -> None:
    """Print what is known of a checkpoint that is complete."""
    model = checkpoint.model
    if model is not None and checkpoint.reading is not None:
        layout = contract_layout(checkpoint.contract, checkpoint.observation_width)
        _print_head(console, model, checkpoint.reading, layout, checkpoint, golden_verdict(checkpoint)[0])


def checkpoint_document(checkpoint: Checkpoint) -> dict[str, Any]:
    """Return what is known of a checkpoint that is complete, for JSON."""
    if checkpoint.model is None or checkpoint.reading is None:
        return {}
    layout = contract_layout(checkpoint.contract, checkpoint.observation_width)
    golden, refusal = golden_verdict(checkpoint)
    found = describe.document(checkpoint.reading, layout)
    return {**_model(checkpoint.model), **found, "golden": golden, "refusal": refusal}


def _print_head(
    console: Console,
    model: OnnxModel,
    reading: Reading,
    layout: ObservationLayout | None,
    checkpoint: Checkpoint | None,
    golden: str,
) -> None:
    """Print one line about the model, the table of its contract, and what was found and not used."""
    tensors = (f"{t.name} {list(t.shape)}" for t in (*model.inputs, *model.outputs))
    console.print(escape(f"{model.path}: {', '.join(tensors)}"), soft_wrap=True)
    table = Table("field", "value", "source", box=None, pad_edge=False)
    for row in describe.reading_lines(reading, layout):
        replaced = f" (replaces {row.replaced})" if row.replaced else ""
        table.add_row(*map(escape, (row.name, row.value, row.source + replaced)), style="yellow" * row.is_assumed)
    if checkpoint is not None and checkpoint.motion is not None:
        motion = checkpoint.motion
        table.add_row("motion", f"{len(motion.frames)} frames, {motion.duration:.2f} s", "model")
    if golden:
        table.add_row("golden vectors", escape(golden), "metadata")
    console.print(table)
    for line in reading.unused:
        console.print(f"[yellow]not used: {escape(line)}[/yellow]", soft_wrap=True)


def _model(model: OnnxModel) -> dict[str, Any]:
    groups = {"inputs": model.inputs, "outputs": model.outputs}
    tensors = {name: [asdict(tensor) for tensor in group] for name, group in groups.items()}
    return {"checkpoint": str(model.path), "sha256": file_digest(model.path), **tensors}


def _joints(contract: PolicyContract) -> Table:
    table = Table("", "joint", "K_p", "K_d", "pose rad", "action", "scale rad", "offset rad", box=None, pad_edge=False)
    driven = contract.action_joint_names
    for i, name in enumerate(contract.joint_names):
        gains = (contract.joint_stiffness[i], contract.joint_damping[i], contract.default_joint_pos[i])
        cells = ["held at 0", "", ""]
        if name in driven:
            k = driven.index(name)
            offset = np.asarray(contract.action_offset)
            cells = [str(k), f"{contract.action_scale[k]:g}", f"{offset[k]:g}"]
        table.add_row(str(i), escape(name), *(f"{value:g}" for value in gains), *cells)
    return table


def make_console() -> Console:
    """Return standard output, wide enough for tables where it is not a terminal."""
    wide = None if sys.stdout.isatty() or "COLUMNS" in os.environ else _PIPE_WIDTH
    return Console(highlight=False, width=wide)


def _skeleton(checkpoint: Path, reading: Reading) -> Iterator[str]:
    """Yield the lines of a contract.yaml with one for each missing field. As it is, it states nothing."""
    yield f"# What {checkpoint.name} does not say about itself. Take the '#' away from each field, and write its value."
    yield f"# Beside the model, as {own_contract(checkpoint).name}, it is found by itself; see docs/contract.md."
    forms: dict[str, str] = {"joint_names": "[NAME, NAME]", "observation": "[TERM, TERM]", "anchor_body": "NAME"}
    for name in reading.missing:
        whole, _, part = name.partition(".")
        if name == "observation":
            yield f"# terms: {', '.join(TERM_KINDS)}"
        yield f"#phase: {{{part or 'period'}: 0.8}}" if whole == "phase" else f"#{name}: {forms.get(name, 'NUMBERS')}"
