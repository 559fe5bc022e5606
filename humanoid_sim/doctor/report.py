"""`policy doctor`: search, and print the verdict, the values that differ, and the lines that put them right."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console
from rich.progress import Progress

from humanoid_sim.cli import ExitStatus
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor import DoctorConfig
from humanoid_sim.doctor.edits import wiring_values
from humanoid_sim.doctor.samples import Samples
from humanoid_sim.doctor.search import Result, search_episodes, search_trace
from humanoid_sim.doctor.trial import load_subject
from humanoid_sim.policy.readers.own import own_contract
from humanoid_sim.policy.words import shown
from humanoid_sim.policy_tools.show import make_console
from humanoid_sim.robots.description import load_robot

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
    robot = load_robot(config.robot, config.imu_site)
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
    """Return what differs in `after`, as a contract file has it."""
    found: dict[str, Any] = {}
    for name, value in _differing(before, after).items():
        whole, _, part = name.partition(".")
        if whole == "observation" and part:
            term, _, option = part.rpartition(".")
            found.setdefault("terms", {}).setdefault(term, {})[option] = value
        elif part:
            found.setdefault(whole, {})[part] = value
        else:
            found[name] = value
    return found


def _differing(before: PolicyContract, after: PolicyContract) -> dict[str, Any]:
    old = wiring_values(before)
    return {name: value for name, value in wiring_values(after).items() if value != old.get(name)}


def changes(before: PolicyContract, after: PolicyContract) -> Iterator[str]:
    """Yield what differs: the field, the joint or place, the value before and after."""
    values = wiring_values(before)
    for field, new in _differing(before, after).items():
        old, name = values.get(field), field.removeprefix("observation.")
        if not isinstance(old, list) or not isinstance(new, list) or len(old) != len(new):
            yield f"{name}: {shown(old)} -> {shown(new)}"
            continue
        owners = before.action_joint_names if name.startswith("action_") else before.joint_names
        if isinstance(new[0], str) or len(owners) != len(new):
            owners = tuple(f"[{i}]" for i in range(len(new)))
        lines = [f"{at} {shown(a)} -> {shown(b)}" for at, a, b in zip(owners, old, new, strict=True) if a != b]
        yield f"{name}: {', '.join(lines[:_SHOWN])}" + (f" and {len(lines) - _SHOWN} more" if lines[_SHOWN:] else "")
