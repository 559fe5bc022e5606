"""`policy doctor`: search, and print the verdict, the values that differ, and the lines that put them right."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console

from humanoid_sim.cli import ExitStatus
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor import DoctorConfig
from humanoid_sim.doctor.edits import wiring_values
from humanoid_sim.doctor.samples import Samples
from humanoid_sim.doctor.search import Result, search_episodes, search_trace
from humanoid_sim.doctor.trial import load_subject
from humanoid_sim.policy.findings import shown
from humanoid_sim.policy.readers.own import own_contract
from humanoid_sim.policy_tools.show import make_console
from humanoid_sim.robots.description import load_robot

_SHOWN = 6  # joints, or other edits, listed one by one


def doctor(config: DoctorConfig) -> int:
    """Search and print; returns the exit status. Raises `InputError` as `examine`."""
    document = examine(config, Console(stderr=True))
    if config.json:
        print(json.dumps(document, indent=2))
    else:
        print_document(document, make_console())
    return ExitStatus.of(document["healthy"])


def examine(config: DoctorConfig, console: Console) -> dict[str, Any]:
    """Search, with progress on a console, and return the document of the result."""
    robot = load_robot(config.robot)
    subject = load_subject(config.checkpoint, robot, config.contract, config.motion)
    if config.trace is not None:
        result = search_trace(subject, Samples(subject, config.trace))
    else:
        result = search_episodes(subject, console)
    return make_document(subject.contract, result, config.contract or own_contract(config.checkpoint))


def make_document(contract: PolicyContract, result: Result, file: Path) -> dict[str, Any]:
    """Return everything as plain values; `file` is where the fix belongs."""
    fix, changes = compare_contracts(contract, contract if result.finding is None else result.finding.contract)
    return {
        "healthy": result.is_healthy,
        "verdict": result.verdict,
        "finding": None if result.finding is None else result.finding.family,
        "changes": changes,
        "note": result.note,
        "file": str(file),
        "fix": fix,
        "ranking": [{"edit": row.edit.name, "score": row.score, "note": row.note} for row in result.rows],
    }


def print_document(document: Mapping[str, Any], console: Console) -> None:
    """Print the verdict first, then what differs, and last the lines for the contract file."""
    ranking = [f"{row['edit']}: {row['note']}" for row in document["ranking"][:_SHOWN]]
    lines = [f"{document['verdict']}.", *(f"  {line}" for line in (*document["changes"], document["note"], *ranking))]
    if document["fix"]:
        text = yaml.safe_dump(document["fix"], sort_keys=False, default_flow_style=None, width=110, allow_unicode=True)
        lines += [f"# {document['file']}", text.rstrip("\n")]
    console.print("\n".join(lines), soft_wrap=True, markup=False, highlight=False, emoji=False)


def compare_contracts(before: PolicyContract, after: PolicyContract) -> tuple[dict[str, Any], list[str]]:
    """Return what differs in `after` as a contract file has it, and in words, a line a field with joints or places."""
    present, fix, lines = wiring_values(before), dict[str, Any](), list[str]()
    for field, new in wiring_values(after).items():
        old, name = present.get(field), field.removeprefix("observation.")
        if new == old:
            continue
        *sections, option = name.split(".")
        section = fix
        for key in sections if name == field else ("terms", *sections):
            section = section.setdefault(key, {})
        section[option] = new
        if not isinstance(old, list) or not isinstance(new, list) or len(old) != len(new):
            lines.append(f"{name}: {shown(old)} -> {shown(new)}")
            continue
        owners = before.action_joint_names if name.startswith("action_") else before.joint_names
        if isinstance(new[0], str) or len(owners) != len(new):
            owners = tuple(f"[{i}]" for i in range(len(new)))
        places = [f"{at} {shown(a)} -> {shown(b)}" for at, a, b in zip(owners, old, new, strict=True) if a != b]
        lines.append(f"{name}: {', '.join(places[:_SHOWN])}{', …' if len(places) > _SHOWN else ''}")
    return fix, lines
