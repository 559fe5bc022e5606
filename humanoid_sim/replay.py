"""`python -m humanoid_sim.replay run.mcap`: repeat a recording bit for bit, and name the first value that differs."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console

from humanoid_sim.assets import policy_path
from humanoid_sim.cli import ExitStatus, parse, run_program
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.run_report import print_table
from humanoid_sim.files import json_text
from humanoid_sim.recording.reader import Recording, open_recording


@dataclass(frozen=True)
class ReplayConfig:
    """Repeat a recording through the control stack, with the recorded actions in the policy's place.

    Exit status 0: every tick is bit for bit identical. 1: a tick differs, ticks are missing, the file is damaged, or
    there is nothing to compare. 2: the file is not a recording. The recording of a killed run is repeated to its end.
    With --policy nothing is repeated: status 0 if that policy would have commanded the same within 0.0001 rad.
    """

    file: Path
    """Recording (.mcap), finished or cut off."""
    policy: str | None = None
    """ONNX checkpoint, or a shipped policy: what would it have commanded on the recorded states?"""
    contract: Path | None = None
    """A contract.yaml for --policy. Default: the one beside it."""
    json: bool = False
    """Print the result as JSON."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `replay` with command-line arguments; returns the exit status."""
    config = parse(ReplayConfig, "replay", arguments, positional=True)
    if config.contract is not None and config.policy is None:
        raise InputError("--contract: is given, expected it with --policy")
    recording = open_recording(config.file)
    return _repeat(recording, config) if config.policy is None else _compare(recording, config, config.policy)


def _repeat(recording: Recording, config: ReplayConfig) -> int:
    from humanoid_sim.recording.repeat import repeat_run  # noqa: PLC0415 - heavy; not needed for `--help`

    report = repeat_run(recording)
    if config.json:
        print(json_text({"identical": report.is_identical, **asdict(report)}))
        return ExitStatus.of(report.is_identical)
    verdict = "bit for bit identical" if report.is_identical else "repeated; NOT the same to the end"
    print(f"{report.ticks} ticks, {verdict if report.ticks else 'nothing to compare'}")
    if report.difference is not None:
        one = report.difference
        print(f"tick {report.tick}, t = {report.time:.3f} s, differs in {one.field} {one.where}")
        print(f"  recorded {one.recorded}, replayed {one.replayed}")
    if report.missing:
        print(f"{report.missing} ticks are missing before tick {report.tick}")
    if report.damage:
        print(f"the recording is not complete: {report.damage}")
    return ExitStatus.of(report.is_identical)


def _compare(recording: Recording, config: ReplayConfig, policy: str) -> int:
    """Print what a policy would have commanded on the recorded states; returns the exit status."""
    from humanoid_sim.policy.checkpoint import load_checkpoint  # noqa: PLC0415 - ONNX Runtime is heavy
    from humanoid_sim.recording.open_loop import TOLERANCE, compare_open_loop  # noqa: PLC0415 - likewise

    if "policies" in recording.header.documents:
        raise InputError(f"{config.file}: was run with several policies; --policy compares a single one")
    checkpoint = load_checkpoint(policy_path(policy), config.contract, recording.header.joint_names)
    report = compare_open_loop(recording, checkpoint)
    if config.json:
        print(json_text({"policy": checkpoint.source, "same": report.is_same, **asdict(report)}))
        return ExitStatus.of(report.is_same)
    rows = []
    for joint in report.joints:
        since = "" if joint.first_time is None else f"{joint.first_time:.3f}"
        rows.append((joint.joint, f"{joint.position:.4g}", f"{joint.torque:.4g}", since))
    title = f"{checkpoint.source} on {report.ticks} recorded ticks of LOCOMOTION, open loop"
    columns = ("joint", "position\nrad", "torque\nN·m", f"beyond {TOLERANCE:g} rad\nfrom s")
    print_table(Console(highlight=False), title, rows, *columns)
    if report.failure:
        print(f"ended at {report.failure_time:.3f} s: {report.failure}")
    verdict = "the commands are the same" if report.is_same else "the commands differ"
    print(verdict if report.ticks or report.failure else "nothing to compare: no policy ran")
    return ExitStatus.of(report.is_same)


if __name__ == "__main__":
    sys.exit(run_program(main))
