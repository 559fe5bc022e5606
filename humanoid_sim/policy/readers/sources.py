"""Files and metadata that say something about a checkpoint, and the contract that they make together."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError, blaming, require_known
from humanoid_sim.policy.contract_json import STAMP_KEY, STAMP_SOURCE, decode, read_stamp
from humanoid_sim.policy.graph_motion import graph_conventions
from humanoid_sim.policy.metadata import METADATA_KEYS, OWN_SOURCE, is_own, read_own, write_metadata
from humanoid_sim.policy.readers.berkeley import find_berkeley, read_berkeley
from humanoid_sim.policy.readers.contract_yaml import find_contract, read_contract_file
from humanoid_sim.policy.readers.holosoma import HOLOSOMA_SOURCE, is_holosoma, read_holosoma
from humanoid_sim.policy.readers.merge import merge
from humanoid_sim.policy.readers.mjlab import MJLAB_SOURCE, is_mjlab, read_mjlab
from humanoid_sim.policy.readers.partial import PartialContract, is_assumed
from humanoid_sim.policy.readers.unitree import find_deploy, read_deploy
from humanoid_sim.policy.readers.values import shown

_DIALECTS = ((MJLAB_SOURCE, is_mjlab, read_mjlab), (HOLOSOMA_SOURCE, is_holosoma, read_holosoma))
"""Dialects of a model's metadata: their name, a test whether it is there, and a reader. A new dialect is a
module, and a line here or below."""
_SIDE_FILES = ((find_deploy, read_deploy), (find_berkeley, read_berkeley))
"""Files that trainers write beside the model: a function that finds it, and a reader."""


def assemble_contract(
    path: Path,
    metadata: Mapping[str, str],
    contract_file: Path | None = None,
    robot_joints: tuple[str, ...] | None = None,
    outputs: Collection[str] = (),
) -> PolicyContract:
    """Return the contract of a checkpoint, from everything that speaks about it.

    A stamped checkpoint is complete by itself, so no trainer's file beside it is read; a `contract.yaml` always is.
    Raises `InputError` if a source is malformed, if two contradict each other, or if something is missing.

    Args:
        contract_file: a contract.yaml; None: the one beside the checkpoint, if there is one.
        robot_joints: the joints in the robot's own order, for sources that give places instead of names.
    """
    chosen = find_contract(path) if contract_file is None else contract_file
    by_hand = [] if chosen is None else read_contract_file(chosen)
    sources = _metadata_sources(metadata, str(path))
    for find, read in () if STAMP_KEY in metadata else _SIDE_FILES:
        beside = find(path)
        if beside is not None:
            sources[beside.name] = partial(read, beside)
    ignored = {name for source in by_hand for name in source.ignores}
    require_known("source", ignored, sources, f"{chosen}: ignore: ")
    partials = [read() for name, read in sources.items() if name not in ignored]
    return merge([*partials, *by_hand, graph_conventions(outputs)], str(path), robot_joints)


def metadata_contract(metadata: Mapping[str, str], where: str) -> list[PartialContract]:
    """Return what a model's metadata says, in whichever dialect it is; an empty list if it says nothing."""
    return [read() for read in _metadata_sources(metadata, where).values()]


def _metadata_sources(metadata: Mapping[str, str], where: str) -> dict[str, Callable[[], PartialContract]]:
    """By its name each dialect that the metadata has, to be read."""
    if STAMP_KEY in metadata:
        return {STAMP_SOURCE: lambda: _stamp(metadata, where)}
    if is_own(metadata):
        return {OWN_SOURCE: partial(read_own, metadata, where)}
    return {name: partial(read, metadata, where) for name, is_spoken, read in _DIALECTS if is_spoken(metadata)}


def _stamp(metadata: Mapping[str, str], where: str) -> PartialContract:
    """Return a stamped contract; refuse one of whose thirteen keys somebody has changed one since: neither may win."""
    own = {key: text for key, text in metadata.items() if key in METADATA_KEYS}
    with blaming(f"{where}: stamped contract"):
        stamped = write_metadata(decode(metadata[STAMP_KEY], where))
    for name, given in read_own(own, where).fields.items():
        expected = read_own(stamped, where).fields[name]
        if not np.array_equal(given.value, expected.value):
            raise InputError(
                f"{where}: {name} is {shown(given.value)} in its metadata, {shown(expected.value)} in its stamped "
                "contract; stamp it again from the one that is right"
            )
    return read_stamp(metadata[STAMP_KEY], where)


def assumptions(contract: PolicyContract) -> tuple[str, ...]:
    """Return what no source states and a dialect implies, one line each: `policy_dt 0.02: assumed (mjlab)`."""
    lines: dict[str, None] = {}
    terms = {term.name: term for term in contract.terms}
    clock: dict[str, list[str]] = {}
    options: dict[tuple[str, str, str], list[str]] = {}
    for name, source in contract.provenance.items():
        if not is_assumed(source):
            continue
        if name.startswith("observation."):
            term, _, option = name.removeprefix("observation.").rpartition(".")
            options.setdefault((option, shown(getattr(terms[term], option)), source), []).append(term)
        elif name.startswith("phase."):
            part = name.removeprefix("phase.")
            clock.setdefault(source, []).append(f"{part} {shown(getattr(contract.phase, part))}")
        elif name != "phase":
            lines[f"{name} {shown(getattr(contract, name))}: {source}"] = None
    apart: dict[tuple[str, str], list[str]] = {}
    for (option, value, source), names in options.items():
        if len(names) == len(terms):
            lines[f"{option} of observation terms {value}: {source}"] = None
        else:
            apart.setdefault((", ".join(names), source), []).append(f"{option} {value}")
    for (owners, source), values in apart.items():
        lines[f"observation term{'s' * (', ' in owners)} {owners}: {', '.join(values)}: {source}"] = None
    return (*lines, *(f"phase: {', '.join(parts)}: {source}" for source, parts in clock.items()))
