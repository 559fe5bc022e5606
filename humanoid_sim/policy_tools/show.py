"""`policy show`: the contract as tables, or as JSON."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from humanoid_sim.cli import ExitStatus
from humanoid_sim.controllers.contract import FORMS, PolicyContract
from humanoid_sim.controllers.observation import ObservationLayout
from humanoid_sim.controllers.term_kinds import TERM_KINDS
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.files import output_file, whole_file
from humanoid_sim.policy import describe
from humanoid_sim.policy.checkpoint import Checkpoint, file_digest, load_checkpoint
from humanoid_sim.policy.checks import model_damping_findings
from humanoid_sim.policy.describe import FieldLine
from humanoid_sim.policy.golden import verify_golden
from humanoid_sim.policy.loaded_policy import contract_layout
from humanoid_sim.policy.onnx_policy import OnnxModel, OnnxPolicy
from humanoid_sim.policy.readers.complete import IncompleteContractError, UnnamedJointsError, UnnamedRobot
from humanoid_sim.policy.readers.contract_yaml import find_contract, own_contract
from humanoid_sim.policy.readers.partial import Given, is_assumed
from humanoid_sim.policy_tools import Show
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.mjcf import bare_model, own_joint_damping

_PIPE_WIDTH = 150
"""Columns where no terminal says how many it has."""
_JOINTS = "joints, in the policy's order"
_BY_JOINT = {
    "default_joint_pos": "default rad",
    "joint_stiffness": "stiffness N·m/rad",
    "joint_damping": "damping N·m·s/rad",
}
"""Fields with one number for each joint, and the headings of their columns."""


def show(options: Show) -> int:
    """Print a checkpoint's contract, or what is known of it; 1 where fields are missing or golden vectors differ."""
    if options.skeleton is not None:
        output_file(options.skeleton, "--skeleton", ".yaml", ".yml")
        if os.path.lexists(options.skeleton):  # what was filled in must not be lost
            raise InputError(f"--skeleton: '{options.skeleton}' exists; choose another name")
    description = None if options.robot is None else load_robot(options.robot)
    joints = None if description is None else description.joint_names
    try:
        checkpoint, note = _load(options, joints)
    except IncompleteContractError as error:
        return _show_incomplete(options, error)
    if options.skeleton is not None:
        raise InputError(f"--skeleton: nothing is missing from the contract of {options.checkpoint}")
    contract = checkpoint.contract
    with blaming(options.checkpoint):
        layout = contract_layout(contract, checkpoint.observation_width)
    golden, problem = golden_verdict(checkpoint)
    if options.json:
        print(json.dumps(policy_document(checkpoint, layout, golden, problem), indent=2, allow_nan=False))
        return ExitStatus.of(not problem)
    console = make_console()
    if note:
        console.print(f"[yellow]{escape(note)}[/yellow]", soft_wrap=True)
    for table in policy_tables(checkpoint, layout, golden, problem):
        console.print(table)
    for finding in (
        ()
        if description is None
        else model_damping_findings(contract, own_joint_damping(bare_model(description), description))
    ):
        console.print(f"[yellow]{escape(str(finding))}[/yellow]", soft_wrap=True)
    assumed = [line for line in describe.field_lines(contract) if is_assumed(line.source)]
    if assumed:
        listed = "; ".join(f"{line.name} {line.value}" for line in assumed)
        console.print(f"[yellow]assumed, no source states it: {escape(listed)}[/yellow]", soft_wrap=True)
    return ExitStatus.of(not problem)


def _load(options: Show, joints: tuple[str, ...] | None) -> tuple[Checkpoint, str]:
    """Return the checkpoint, and what to say of joints that no source names: they are shown by their places."""
    try:
        return load_checkpoint(options.checkpoint, options.contract, joints, verify=False), ""
    except UnnamedJointsError as error:
        if not error.count:
            raise
        places = UnnamedRobot.with_joints(error.count)
        note = "no source names the joints, so they are shown by their places on the robot; --robot gives their names"
        return load_checkpoint(options.checkpoint, options.contract, places, verify=False), note


def _show_incomplete(options: Show, error: IncompleteContractError) -> int:
    """Print what is known of a contract that lacks fields, and which it lacks."""
    path, model = options.checkpoint, OnnxModel(options.checkpoint)
    file = find_contract(path) if options.contract is None else options.contract
    if options.skeleton is not None:
        if file is not None:
            given = f"--skeleton: {path} has a contract file, {file}; add to it what is missing"
            raise InputError(f"{given}: {', '.join(error.missing)}")
        tensors = [f"{name}: {text}" for name, text in _model_rows(model).items()]
        with whole_file(options.skeleton) as stream:
            stream.write("".join(f"{line}\n" for line in _skeleton(path, error.missing, tensors)).encode())
    if options.json:
        document = {
            **_source_document(str(path), file_digest(path), file),
            "model": _model_document(model),
            "known": describe.known_document(error.known, error.terms),
            "missing": list(error.missing),
        }
        print(json.dumps(document, indent=2, allow_nan=False))
        return ExitStatus.FAILED
    console = make_console()
    rows = {**_file_rows(file, file_digest(path)), **_model_rows(model)}
    console.print(_pairs_table(str(path), rows))
    if "joint_names" in error.known:
        console.print(_known_joints(error.known))
    if error.known or error.terms:
        console.print(
            _field_table("known so far, and where it came from", describe.known_lines(error.known, error.terms))
        )
    if options.skeleton is None:
        told = f"write them into {file or own_contract(path)}, which --skeleton FILE begins (docs/contract.md)"
    else:
        told = f"fill it in, in {options.skeleton}"
    missing = f"missing: {', '.join(error.missing)}; {told}"
    console.print(f"[red]{escape(missing)}[/red]", soft_wrap=True)
    return ExitStatus.FAILED


def make_console() -> Console:
    """Return standard output, wide enough for tables where it is not a terminal."""
    wide = None if sys.stdout.isatty() or "COLUMNS" in os.environ else _PIPE_WIDTH
    return Console(highlight=False, width=wide)


def golden_verdict(checkpoint: Checkpoint) -> tuple[str, str]:
    """Return what the golden vectors are worth, and what is wrong with them."""
    try:
        return verify_golden(checkpoint), ""
    except InputError as error:
        return "", str(error).removeprefix(f"{checkpoint.source}: ")


def policy_tables(
    checkpoint: Checkpoint, layout: ObservationLayout, golden: str, problem: str
) -> tuple[Table, Table, Table, Table]:
    """Return what is known of a checkpoint: overview, joints, observation, and where each field came from.

    Args:
        golden: what its golden vectors are worth, from `golden_verdict`.
        problem: what is wrong with them, likewise.
    """
    contract = checkpoint.contract
    sources = _field_table("where it came from", describe.field_lines(contract))
    return _overview(checkpoint, layout, golden, problem), _joints(contract), _observation(contract, layout), sources


def _overview(checkpoint: Checkpoint, layout: ObservationLayout, golden: str, problem: str) -> Table:
    contract, policy = checkpoint.contract, checkpoint.policy
    width = checkpoint.observation_width
    fits = "" if width in (None, layout.width) else f" [red]but the model's input has {width}[/red]"
    if checkpoint.motion is not None:
        motion = f"in the model: {len(checkpoint.motion.frames)} frames, {checkpoint.motion.duration:.2f} s"
    else:
        motion = "follows none" if contract.task_type == "locomotion" else "not in the model: --motion of play"
    rows = {
        "task": contract.task_type,
        "rate": f"{1.0 / contract.policy_dt:g} Hz",
        "joints": f"{len(contract.joint_names)}, of which {contract.action_count} driven",
        "observation": f"{layout.width} values in {len(contract.terms)} terms{fits}",
        "command": "velocity" if contract.takes_velocity_command else ", ".join(contract.command_names) or "none",
        "motion": motion,
        "golden vectors": f"[red]REFUSED: {escape(problem)}[/red]" if problem else escape(golden or "none"),
        **_file_rows(checkpoint.contract_file, checkpoint.sha256),
    }
    if isinstance(policy, OnnxPolicy):
        rows |= _model_rows(policy.model)
    return _pairs_table(checkpoint.source, rows)


def _table(title: str, *headings: str, right: Collection[str] = ()) -> Table:
    """Return a table without rows; the columns `right` hold numbers."""
    table = Table(title=title, title_justify="left")
    for heading in headings:
        table.add_column(heading, justify="right" if heading in right else "left", overflow="fold")
    return table


def _pairs_table(title: str, rows: dict[str, str]) -> Table:
    table = Table(title=escape(title), show_header=False, title_justify="left")
    table.add_column(style="bold")
    table.add_column(overflow="fold")
    for row in rows.items():
        table.add_row(*row)
    return table


def _file_rows(contract_file: Path | None, sha256: str) -> dict[str, str]:
    return {"contract file": "none" if contract_file is None else escape(str(contract_file)), "sha256": sha256}


def _model_rows(model: OnnxModel) -> dict[str, str]:
    return {"inputs": _tensors(model.inputs), "outputs": _tensors(model.outputs)}


def _tensors(tensors: Any) -> str:
    return escape(", ".join(f"{tensor.name} {list(tensor.shape)}" for tensor in tensors))


def _joints(contract: PolicyContract) -> Table:
    columns = {heading: getattr(contract, field) for field, heading in _BY_JOINT.items()}
    cells = {heading: [f"{value:g}" for value in values] for heading, values in columns.items()}
    names, driven = contract.joint_names, contract.action_joint_names
    cells["driven"] = [f"action {driven.index(name)}" if name in driven else "held at 0" for name in names]
    clip = None if isinstance(contract.position_clip, str) else contract.position_clip
    of_action: dict[str, Sequence[str]] = {
        "scale rad": [f"{value:g}" for value in contract.action_scale],
        "offset rad": [f"{value:g}" for value in np.asarray(contract.action_offset)],
        **({} if clip is None else {"position rad": [f"{low:g} to {high:g}" for low, high in clip]}),
    }
    for heading, texts in of_action.items():
        cells[heading] = [texts[driven.index(name)] if name in driven else "" for name in names]
    return _joint_table(names, cells)


def _known_joints(known: Mapping[str, Given]) -> Table:
    """Return the joints of a contract that lacks fields, with what is known of each."""
    names = known["joint_names"].value
    values = {heading: np.asarray(known[name].value) for name, heading in _BY_JOINT.items() if name in known}
    fitting = {head: value for head, value in values.items() if value.shape in ((), (1,), (len(names),))}
    cells = {head: [f"{v:g}" for v in np.broadcast_to(value, len(names))] for head, value in fitting.items()}
    return _joint_table(names, cells)


def _joint_table(names: Sequence[str], cells: Mapping[str, Sequence[str]]) -> Table:
    table = _table(_JOINTS, "", "joint", *cells, right=("", *cells))
    for i, name in enumerate(names):
        table.add_row(str(i), escape(name), *(column[i] for column in cells.values()))
    return table


def _observation(contract: PolicyContract, layout: ObservationLayout) -> Table:
    title = f"observation, {layout.width} values"
    if layout.history > 1 and layout.history_layout == "per_step":
        title += f": {layout.history} steps of {layout.step_width} values, each step's terms together"
    numbers = ("from", "width")
    table = _table(title, *numbers, "term", "meaning", "differs from the usual", "scale", "history", right=numbers)
    for line in describe.term_lines(contract, layout):
        table.add_row(*(escape(str(cell)) for cell in line))
    return table


def _field_table(title: str, lines: list[FieldLine]) -> Table:
    table = _table(title, "field", "value", "source")
    for line in lines:
        table.add_row(*map(escape, line), style="yellow" if is_assumed(line.source) else None)
    return table


def policy_document(checkpoint: Checkpoint, layout: ObservationLayout, golden: str, problem: str) -> dict[str, Any]:
    """Return what is known of a checkpoint, for JSON; arguments as for `policy_tables`."""
    policy, motion = checkpoint.policy, checkpoint.motion
    tensors = _model_document(policy.model) if isinstance(policy, OnnxPolicy) else {}
    return {
        **_source_document(checkpoint.source, checkpoint.sha256, checkpoint.contract_file),
        "model": {**tensors, "observation_width": checkpoint.observation_width},
        "motion": None if motion is None else {"frames": len(motion.frames), "bodies": list(motion.body_names)},
        "golden": {"label": golden, "problem": problem},
        "contract": describe.contract_document(checkpoint.contract, layout),
    }


def _source_document(source: str, sha256: str, contract_file: Path | None) -> dict[str, Any]:
    file = None if contract_file is None else str(contract_file)
    return {"checkpoint": source, "sha256": sha256, "contract_file": file}


def _model_document(model: OnnxModel) -> dict[str, Any]:
    groups = (("inputs", model.inputs), ("outputs", model.outputs))
    return {name: [{"name": t.name, "type": t.type, "shape": list(t.shape)} for t in group] for name, group in groups}


_VALUES = {"names": "[NAME, NAME]", "text": "TEXT", "flag": "true", "structure": "{}", "axes": "{}"}
"""Placeholders of fields' values, by the kind of the form; any other is a number, or one for each joint."""


def _skeleton(checkpoint: Path, missing: Sequence[str], tensors: Sequence[str]) -> Iterator[str]:
    """Yield the lines of a contract.yaml with one for each missing field. As it is, it states nothing.

    Args:
        missing: fields that no source gives, as `IncompleteContractError.missing`.
        tensors: what is known of the model, a line each.
    """
    yield f"# What {checkpoint.name} does not say about itself. Take the '#' away from each field, and write its value."
    yield f"# `python -m humanoid_sim.policy show {checkpoint.name} --contract THIS_FILE` says what is still missing;"
    yield "# beside the model, as NAME.contract.yaml, it is found by itself. docs/contract.md explains all fields."
    yield from (f"# {line}" for line in tensors)
    for name in missing:
        field, _, part = name.partition(".")
        yield ""
        if field == "observation":
            yield f"# Terms: {', '.join(TERM_KINDS)}"
            yield "#observation: [TERM, TERM]"
        elif field == "phase":
            yield f"#phase: {{{part or 'period'}: 0.8}}"
        else:
            form = FORMS[field]
            yield f"#{field}: {'|'.join(form.choices) or _VALUES.get(form.kind, 'NUMBER')}"
