"""`policy show`: the contract of a checkpoint as one table, and what was found and not used."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.cli import ExitStatus
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.files import regular_file
from humanoid_sim.policy.checkpoint import Checkpoint, load_checkpoint, read_checkpoint
from humanoid_sim.policy.findings import contract_rows, in_words, is_assumed
from humanoid_sim.policy.layers import Reading
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.onnx_policy import OnnxModel
from humanoid_sim.policy.traces import verify_golden
from humanoid_sim.policy_tools import Show
from humanoid_sim.robots.description import load_robot

_PIPE_WIDTH = 160  # columns of tables where no terminal says how many there are


def show(options: Show) -> int:
    """Print the contract of a checkpoint; exit status 1 if it cannot be used as it is."""
    joints = None if options.robot is None else load_robot(options.robot).joint_names
    if options.contract is not None:
        regular_file(options.contract, "a contract.yaml")
    model = OnnxModel(options.checkpoint)
    reading = read_checkpoint(model.path, model.metadata, options.contract, joints)
    golden = refusal = ""
    try:
        golden = load_checkpoint(options.checkpoint, options.contract, joints).golden
    except InputError as error:
        refusal = str(error).removeprefix(f"{model.path}: ")
    console = make_console()
    _print(console, model, reading, golden)
    if refusal:
        console.print(f"[red]{escape(refusal)}[/red]", soft_wrap=True)
    return ExitStatus.of(not refusal)


def print_checkpoint(console: Console, checkpoint: Checkpoint) -> None:
    """Print what is known of a checkpoint that is complete."""
    golden = ""
    with suppress(InputError):  # `check` names the difference
        golden = verify_golden(checkpoint)
    if checkpoint.model is not None and checkpoint.reading is not None:
        _print(console, checkpoint.model, checkpoint.reading, golden)


def _print(console: Console, model: OnnxModel, reading: Reading, golden: str) -> None:
    tensors = (f"{tensor.name} {list(tensor.shape)}" for tensor in (*model.inputs, *model.outputs))
    console.print(escape(f"{model.path}: {', '.join(tensors)}"), soft_wrap=True)
    table = Table("field", "value", "source", box=None, pad_edge=False)
    terms = ""
    with suppress(FieldError):  # `check` names the term
        widths = () if reading.outline is None else contract_layout(reading.outline).terms
        terms = " + ".join(f"{term.name} {term.width}" for term in widths)
    for field, text, source in contract_rows(reading.values, reading.source):
        value = terms if field == "observation" and terms else text
        replaced = "; ".join(f"{in_words(old)} {origin}" for old, origin in reading.replaced.get(field, ()))
        origin = f"{source} (replaces {replaced})" if replaced else source
        table.add_row(escape(field), escape(value), escape(origin), style="yellow" if is_assumed(source) else "")
    if golden:
        table.add_row("golden vectors", escape(golden), "metadata")
    console.print(table)
    for line in reading.unused:
        console.print(f"[yellow]not used: {escape(line)}[/yellow]", soft_wrap=True)


def make_console() -> Console:
    """Return standard output, wide enough for tables where it is not a terminal."""
    wide = None if sys.stdout.isatty() or "COLUMNS" in os.environ else _PIPE_WIDTH
    return Console(highlight=False, width=wide)
