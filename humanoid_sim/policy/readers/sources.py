"""Which files and metadata say something about a checkpoint, and the contract that they make together."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError
from humanoid_sim.policy.contract_json import STAMP_KEY, decode, read_stamp
from humanoid_sim.policy.graph_motion import graph_conventions
from humanoid_sim.policy.metadata import METADATA_KEYS, is_own, read_own, write_metadata
from humanoid_sim.policy.readers.contract_yaml import find_contract, read_contract_file
from humanoid_sim.policy.readers.holosoma import is_holosoma, read_holosoma
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.policy.readers.mjlab import is_mjlab, read_mjlab
from humanoid_sim.policy.readers.partial import PartialContract, is_assumed
from humanoid_sim.policy.readers.unitree import find_deploy, read_deploy
from humanoid_sim.policy.readers.values import shown

__all__ = ["assemble_contract", "assumptions", "metadata_contract"]

_DIALECTS = ((is_mjlab, read_mjlab), (is_holosoma, read_holosoma))
"""Of trainers that write into a model's metadata: whether it is there, and what it says. A new dialect is a module, and
a line here or below."""
_SIDE_FILES = ((find_deploy, read_deploy),)
"""Of trainers that write a file beside the model: where it is, and what it says."""


def assemble_contract(
    path: Path,
    metadata: Mapping[str, str],
    contract_file: Path | None = None,
    robot_joints: tuple[str, ...] | None = None,
    outputs: Collection[str] = (),
) -> PolicyContract:
    """The contract of a checkpoint, from everything that speaks about it.

    A stamped checkpoint is complete by itself, so a `deploy.yaml` beside it is not read; a `contract.yaml` always is.

    Args:
        path: the checkpoint.
        metadata: its `custom_metadata_map`.
        contract_file: a contract.yaml; None: the one beside the checkpoint, if there is one.
        robot_joints: the joints in the robot's own order, for sources that give places instead of names.
        outputs: names of the model's outputs.

    Raises:
        InputError: if a source is malformed, if two contradict each other, or if something is missing.
    """
    partials = metadata_contract(metadata, str(path))
    for find, read in () if STAMP_KEY in metadata else _SIDE_FILES:
        beside = find(path)
        if beside is not None:
            partials.append(read(beside))
    chosen = find_contract(path) if contract_file is None else contract_file
    if chosen is not None:
        partials += read_contract_file(chosen)
    return merge([*partials, graph_conventions(outputs)], str(path), robot_joints)


def metadata_contract(metadata: Mapping[str, str], where: str) -> list[PartialContract]:
    """What a model's metadata says, in whichever dialect it is; an empty list if it says nothing."""
    if STAMP_KEY in metadata:
        _check_stamp(metadata, where)
        return [read_stamp(metadata[STAMP_KEY], where)]
    if is_own(metadata):
        return [read_own(metadata, where)]
    return [read(metadata, where) for is_spoken, read in _DIALECTS if is_spoken(metadata)]


def _check_stamp(metadata: Mapping[str, str], where: str) -> None:
    """Refuse a stamped model one of whose thirteen keys somebody has changed since: neither may silently win."""
    own = {key: text for key, text in metadata.items() if key in METADATA_KEYS}
    stamped = write_metadata(decode(metadata[STAMP_KEY], where))
    for name, given in read_own(own, where).fields.items():
        expected = read_own(stamped, where).fields[name]
        if not np.array_equal(given.value, expected.value):
            raise InputError(
                f"{where}: {name} is {shown(given.value)} in its metadata, {shown(expected.value)} in its stamped "
                "contract; stamp it again from the one that is right"
            )


def assumptions(contract: PolicyContract) -> tuple[str, ...]:
    """What no source states and a dialect implies, one line each: `policy_dt 0.02: assumed (mjlab)`."""
    lines: dict[str, None] = {}
    terms = {term.name: term for term in contract.terms}
    for name, source in contract.provenance.items():
        if not is_assumed(source):
            continue
        if name.startswith("observation."):  # the same for every term, and told once
            term, _, option = name.removeprefix("observation.").rpartition(".")
            lines[f"{option} of observation terms {shown(getattr(terms[term], option))}: {source}"] = None
        else:
            lines[f"{name} {shown(getattr(contract, name))}: {source}"] = None
    return tuple(lines)
