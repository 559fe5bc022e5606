"""`python -m humanoid_sim.compare bus.mcap direct.mcap delayed.mcap`: how far apart recordings of one policy are.

Runs are laid beside one another by the frame of the motion that the policy was shown, so that it does not matter when
each of them began to play it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

from humanoid_sim.cli import run_program
from humanoid_sim.command_line import parse
from humanoid_sim.command_line.tables import titled_table
from humanoid_sim.errors import InputError
from humanoid_sim.mit import FloatArray
from humanoid_sim.recording.reader import open_recording


@dataclass(frozen=True)
class CompareConfig:
    """Compare recordings of one policy, or of two for the same robot, frame by frame: the others with the first.

    What a bus does to a policy: record it over the bus, in plain simulation, and in simulation with the bus's delays,
    and compare the last two with the first. The second line then says how much of the difference the delays explain.
    """

    reference: Path
    """The recording (.mcap) that the others are compared with."""
    others: tuple[Path, ...]
    """One or more; from the second on, each is also compared with the first of them."""
    joints: bool = False
    """Also print how far apart each joint is, the farthest first."""
    json: bool = False
    """Print the result as JSON."""

    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (
        ("last_week.mcap today.mcap --joints", "which joints move differently?"),
        ("simulated.mcap real.mcap", "how far is the robot from its simulation?"),
    )


@dataclass(frozen=True, slots=True, eq=False)
class PolicyRun:
    """The policy's steps of one recording, by frame of the motion; of a frame shown several times, the first."""

    name: str
    joint_names: tuple[str, ...]
    frames: dict[int, int]
    """Frame to row of the arrays."""
    joint_position: FloatArray
    """Shape (frames, n), rad."""
    joint_velocity: FloatArray
    """Shape (frames, n), rad/s."""
    action: FloatArray
    """Shape (frames, m), raw."""
    joint_age: FloatArray
    """Shape (frames, n), s."""


@dataclass(frozen=True, slots=True)
class Distance:
    """Distance of one run from the reference: root mean square over all frames and joints, and the largest."""

    name: str
    frames: int
    """Compared."""
    joint_age: float
    """s, mean age of the joints' state in this run."""
    position_rms: float
    """rad"""
    position_max: float
    """rad"""
    worst_joint: str
    """Place of the largest."""
    velocity_rms: float
    """rad/s"""
    action_rms: float
    """Raw."""
    by_joint: Mapping[str, float]
    """rad, root mean square of each joint's position."""
    explained: float | None = None
    """Part of the first run's `position_rms` that is gone in this one; none for the first."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `compare` with command-line arguments; returns the exit status."""
    config = parse(CompareConfig, "compare", arguments, positional=True)
    if not config.others:
        raise InputError("others: are missing, expected at least one recording to compare with the first")
    reference = read_policy_run(config.reference)
    distances = compare_runs(reference, [read_policy_run(path) for path in config.others])
    if config.json:
        print(json.dumps({"reference": reference.name, "others": [asdict(item) for item in distances]}, indent=1))
    else:
        _print(reference, distances)
        if config.joints:
            _print_joints(distances)
    return 0


def read_policy_run(path: Path) -> PolicyRun:
    """Return the policy's steps of a recording. Raises `InputError` if it cannot be read, or no policy ran."""
    recording = open_recording(path).of_last_policy()
    frames: dict[int, int] = {}
    rows: list[tuple[npt.NDArray[Any], ...]] = []
    for tick in recording.ticks():
        step, state = tick.output.policy_step, tick.input.state
        if step is None or step.frame in frames:
            continue
        frames[step.frame] = len(rows)
        rows.append((state.joint_position, state.joint_velocity, step.action, state.joint_age))
    if not rows:
        raise InputError(f"{path}: no policy ran in it, expected a recording with LOCOMOTION")
    position, velocity, action, age = (np.array(column, dtype=np.float64) for column in zip(*rows, strict=True))
    return PolicyRun(str(path), recording.header.joint_names, frames, position, velocity, action, age)


def compare_runs(reference: PolicyRun, others: Sequence[PolicyRun]) -> list[Distance]:
    """Return the distance of each of the others from the reference.

    Raises `InputError` if one is of another robot or policy, or has no frame in common with the reference.
    """
    distances: list[Distance] = []
    for other in others:
        if other.joint_names != reference.joint_names or other.action.shape[1] != reference.action.shape[1]:
            raise InputError(f"{other.name}: has other joints or actions than {reference.name}")
        common = sorted(reference.frames.keys() & other.frames.keys())
        if not common:
            raise InputError(f"{other.name}: has no frame of the motion in common with {reference.name}")
        mine = [other.frames[frame] for frame in common]
        theirs = [reference.frames[frame] for frame in common]
        position = np.abs(other.joint_position[mine] - reference.joint_position[theirs])
        rms = _rms(position)
        first = distances[0].position_rms if distances else None
        distances.append(
            Distance(
                name=other.name,
                frames=len(common),
                joint_age=float(other.joint_age[mine].mean()),
                position_rms=rms,
                position_max=float(position.max()),
                worst_joint=reference.joint_names[int(position.max(axis=0).argmax())],
                velocity_rms=_rms(other.joint_velocity[mine] - reference.joint_velocity[theirs]),
                action_rms=_rms(other.action[mine] - reference.action[theirs]),
                by_joint=dict(
                    zip(reference.joint_names, np.sqrt(np.square(position).mean(axis=0)).tolist(), strict=True)
                ),
                explained=1.0 - rms / first if first else None,
            )
        )
    return distances


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.square(values).mean()))


def _print(reference: PolicyRun, distances: Sequence[Distance]) -> None:
    age = 1e3 * float(reference.joint_age.mean())
    title = f"Compared with {reference.name}, whose joints' state is {age:.1f} ms old on average"
    figures = ("frames", "state age", "position RMS", "max", "velocity RMS", "action RMS", "explained")
    table = titled_table(title, "run", *figures, right=figures)
    for item in distances:
        table.add_row(
            item.name,
            str(item.frames),
            f"{1e3 * item.joint_age:.1f} ms",
            f"{1e3 * item.position_rms:.2f} mrad",
            f"{1e3 * item.position_max:.1f} mrad, {item.worst_joint}",
            f"{item.velocity_rms:.4f} rad/s",
            f"{item.action_rms:.4f}",
            "" if item.explained is None else f"{100.0 * item.explained:.0f} %",
        )
    _show(table)


def _print_joints(distances: Sequence[Distance]) -> None:
    names = [item.name for item in distances]
    table = titled_table("Position RMS of each joint, mrad", "joint", *names, right=names)
    for joint in sorted(distances[0].by_joint, key=lambda joint: -max(item.by_joint[joint] for item in distances)):
        table.add_row(joint, *(f"{1e3 * item.by_joint[joint]:.2f}" for item in distances))
    _show(table)


def _show(table: Table) -> None:
    wide = None if sys.stdout.isatty() else 200
    Console(highlight=False, emoji=False, soft_wrap=wide is not None, width=wide).print(table)


if __name__ == "__main__":
    sys.exit(run_program(main))
