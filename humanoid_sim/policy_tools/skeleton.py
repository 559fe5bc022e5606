"""The contract.yaml of a checkpoint that does not say enough about itself, to be filled in."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

from humanoid_sim.command_line.description import field_texts
from humanoid_sim.controllers.contract import FORMS, PolicyContract
from humanoid_sim.controllers.term_kinds import TERM_KINDS
from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file, whole_file

__all__ = ["check_skeleton", "skeleton", "write_skeleton"]

_VALUES = {"names": "[NAME, NAME]", "text": "TEXT", "flag": "true", "structure": "{}", "axes": "{}"}
"""What stands for a field's value, by the kind of its form; for any other a number."""


def check_skeleton(path: Path) -> None:
    """Refuse a file that cannot be written, or is there: what was filled in must not be lost.

    Raises:
        InputError: naming the option.
    """
    output_file(path, "--skeleton", ".yaml", ".yml")
    if os.path.lexists(path):
        raise InputError(f"--skeleton: '{path}' exists; choose another name")


def write_skeleton(path: Path, checkpoint: Path, missing: Sequence[str], tensors: Sequence[str]) -> None:
    """Write `skeleton`'s text to a file, whole or not at all."""
    with whole_file(path) as file:
        file.write(skeleton(checkpoint, missing, tensors).encode())


def skeleton(checkpoint: Path, missing: Sequence[str], tensors: Sequence[str]) -> str:
    """A contract.yaml with a commented line for each missing field. As it is, it states nothing.

    Args:
        checkpoint: whose.
        missing: fields that no source gives, as `IncompleteContractError.missing`.
        tensors: what is known of the model, a line each.
    """
    return "\n".join([*_lines(checkpoint, missing, tensors), ""])


def _lines(checkpoint: Path, missing: Sequence[str], tensors: Sequence[str]) -> Iterator[str]:
    yield f"# What {checkpoint.name} does not say about itself. Take the '#' away from each field, and write its value."
    yield f"# `python -m humanoid_sim.policy show {checkpoint.name} --contract THIS_FILE` says what is still missing;"
    yield "# beside the model, as NAME.contract.yaml, it is found by itself. docs/contract.md explains all fields."
    yield from (f"# {line}" for line in tensors)
    texts = field_texts(PolicyContract)
    for name in missing:
        field, _, part = name.partition(".")
        yield ""
        yield f"# {' '.join(texts[field].split())}"
        if field == "observation":
            yield f"# Terms: {', '.join(TERM_KINDS)}"
            yield "#observation: [TERM, TERM]"
        elif field == "phase":
            yield f"#phase: {{{part or 'period'}: 0.8}}"
        else:
            form = FORMS[field]
            yield f"#{field}: {'|'.join(form.choices) or _VALUES.get(form.kind, '0.0')}"
