"""`policy doctor`: search, and print the verdict, the values that differ, and the lines that put them right."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.console import Console
from rich.progress import Progress

from humanoid_sim.cli import ExitStatus
from humanoid_sim.controllers.contract import PhaseRule, PolicyContract, Term
from humanoid_sim.doctor import DoctorConfig
from humanoid_sim.doctor.edits import FIELDS, plain
from humanoid_sim.doctor.samples import Samples
from humanoid_sim.doctor.search import Result, search_episodes, search_trace
from humanoid_sim.doctor.trial import load_subject
from humanoid_sim.policy.readers.own import own_contract
from humanoid_sim.policy_tools.show import make_console
from humanoid_sim.robots.description import load_robot, with_imu

_SHOWN = 6  # joints, or other edits, listed one by one
_WIDTH = 110


@dataclass(frozen=True)
class Examination:
    """A contract, and what the search found."""

    contract: PolicyContract
    result: Result
    file: Path
    """Where the fix belongs."""
    seconds: float
    """s of wall time."""

    @property
    def changes(self) -> list[str]:
        """Values that differ with the finding, one line a field: before and after."""
        return [] if self.result.finding is None else list(changes(self.contract, self.result.finding.contract))

    @property
    def fix(self) -> dict[str, Any]:
        """Fields of the contract file that put it right, as plain values; empty without a finding."""
        return {} if self.result.finding is None else fixed_fields(self.contract, self.result.finding.contract)

    def print(self, console: Console) -> None:
        """Print everything, the verdict first."""
        rows = [f"{row.edit.name}: {row.note}" for row in self.result.rows[:_SHOWN]]
        console.print(f"{self.result.verdict}.", style="bold", soft_wrap=True, markup=False, highlight=False)
        for line in (*self.changes, *self.result.notes, *rows):
            console.print(f"  {line}", soft_wrap=True, markup=False, highlight=False, emoji=False)
        if self.fix:
            text = yaml.safe_dump(self.fix, sort_keys=False, default_flow_style=None, width=_WIDTH, allow_unicode=True)
            console.print(f"# {self.file}\n{text}", soft_wrap=True, end="", markup=False, highlight=False, emoji=False)

    def document(self) -> dict[str, Any]:
        """Return everything as plain values, for JSON."""
        result = self.result
        return {
            "healthy": result.is_healthy,
            "verdict": result.verdict,
            "finding": None if result.finding is None else result.finding.family,
            "changes": self.changes,
            "notes": list(result.notes),
            "file": str(self.file),
            "fix": self.fix,
            "ranking": [
                {"edit": row.edit.name, "family": row.edit.family, "score": row.score, "note": row.note}
                for row in result.rows
            ],
            "seconds": round(self.seconds, 1),
        }


def doctor(config: DoctorConfig) -> int:
    """Search and print; returns the exit status. Raises `InputError` as `examine`."""
    found = examine(config, Console(stderr=True))
    if config.json:
        print(json.dumps(found.document(), indent=2))
    else:
        found.print(make_console())
    return ExitStatus.of(found.result.is_healthy)


def examine(config: DoctorConfig, console: Console) -> Examination:
    """Search, with progress on a console. Raises `InputError` if checkpoint, robot, motion or trace is refused."""
    start = time.perf_counter()
    robot = with_imu(load_robot(config.robot), config.imu_site)
    subject = load_subject(config.checkpoint, robot, config.contract, config.motion)
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task("changes", total=None)
        if config.trace is not None:
            result = search_trace(subject, Samples(subject, config.trace))
        else:
            result = search_episodes(subject, lambda done, total: bar.update(task, completed=done, total=total))
    file = config.contract or own_contract(config.checkpoint)
    return Examination(subject.contract, result, file, time.perf_counter() - start)


def fixed_fields(before: PolicyContract, after: PolicyContract) -> dict[str, Any]:
    """Return the fields of `after` that differ, as a contract file has them; of terms and clock too what is usual."""
    found = {name: plain(getattr(after, name)) for name in _differing(before, after)}
    if "observation" in found:
        terms = {term.name: term for term in before.terms}
        found["observation"] = [_stated(terms[term.name], term, after.kind(term).relative) for term in after.terms]
    if before.phase is not None and after.phase is not None and "phase" in found:
        found["phase"] = _stated(before.phase, after.phase)
    return found


def _stated(before: Term | PhaseRule, after: Term | PhaseRule, relative: bool = False) -> Any:
    """Return `after` as a contract file has it, with every option that differs; None for `relative` is as given."""
    options = {
        item.name: (plain(getattr(before, item.name)), plain(getattr(after, item.name))) for item in fields(after)
    }
    changed = {name: relative if new is None else new for name, (old, new) in options.items() if old != new}
    own = plain(after)
    return {**({"name": own} if isinstance(own, str) else own), **changed} if changed else own


def _differing(before: PolicyContract, after: PolicyContract) -> list[str]:
    """Names of the fields that differ; an action offset does not where it is the default pose, before and after."""
    changed = [name for name in FIELDS if plain(getattr(before, name)) != plain(getattr(after, name))]
    follows = all(
        dict(zip(each.action_joint_names, np.asarray(each.action_offset).tolist(), strict=True)).items()
        <= dict(zip(each.joint_names, each.default_joint_pos.tolist(), strict=True)).items()
        for each in (before, after)
    )
    return [name for name in changed if name != "action_offset" or not follows]


def changes(before: PolicyContract, after: PolicyContract) -> Iterator[str]:
    """Yield what differs: the field, the joint or place, the value before and after."""
    for name in _differing(before, after):
        if name == "observation":
            yield from _term_changes(before, after)
            continue
        old, new = getattr(before, name), getattr(after, name)
        if np.ndim(old) != 1 or np.shape(old) != np.shape(new):
            yield f"{name}: {_text(plain(old))} -> {_text(plain(new))}"
            continue
        places = before.action_joint_names if name.startswith("action_") else before.joint_names
        if not isinstance(new, np.ndarray):  # names have places
            places = tuple(f"[{i}]" for i in range(len(new)))
        pairs = zip(places, np.asarray(old).tolist(), np.asarray(new).tolist(), strict=True)
        lines = [f"{at} {_text(a)} -> {_text(b)}" for at, a, b in pairs if a != b]
        yield f"{name}: {', '.join(lines[:_SHOWN])}" + (f" and {len(lines) - _SHOWN} more" if lines[_SHOWN:] else "")


def _term_changes(before: PolicyContract, after: PolicyContract) -> Iterator[str]:
    if before.observation_names != after.observation_names:
        yield f"observation: {', '.join(before.observation_names)} -> {', '.join(after.observation_names)}"
    terms = {term.name: term for term in before.terms}
    for term in after.terms:
        for item in fields(Term):
            old, new = (plain(getattr(each, item.name)) for each in (terms[term.name], term))
            if item.name == "relative":
                old, new = (after.kind(term).relative if each is None else each for each in (old, new))
            if old != new:
                yield f"{term.name} {item.name}: {_text(old)} -> {_text(new)}"


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value[:3]))}{f', … {len(value)} in all' if len(value) > 3 else ''}]"
    return str(value)
