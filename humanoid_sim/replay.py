"""`python -m humanoid_sim.replay run.mcap`: repeat a recording bit for bit, and name the first value that differs."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TimeRemainingColumn
from rich.table import Table

from humanoid_sim.assets import policy_path
from humanoid_sim.cli import ExitStatus, parse, run_program
from humanoid_sim.errors import InputError
from humanoid_sim.files import finite, is_file, output_file, whole_file
from humanoid_sim.messages import PolicyStep, SessionHeader, TickRecord
from humanoid_sim.mit import FloatArray
from humanoid_sim.policy.checkpoint import Checkpoint, file_digest
from humanoid_sim.recording.reader import Entry, Recording, open_recording, recorded_settings
from humanoid_sim.recording.repeat import InferenceReport, RepeatReport, repeat_run

if TYPE_CHECKING:
    from humanoid_sim.recording.open_loop import OpenLoopReport

_PLACEHOLDER = "placeholder"
_TOLERANCE = 1e-4
"""Difference of an action: above what float32 sums in another order differ by, far below what any joint shows."""


@dataclass(frozen=True)
class ReplayConfig:
    """Repeat a recording through the control stack, with the recorded actions in the policy's place.

    Exit status 0: every tick is bit for bit identical, and with --infer every answer of the network is the recorded
    one within --tolerance. 1: a tick or an answer differs, ticks are missing, the file is damaged, or there is nothing
    to compare. 2: the file is not a recording. The recording of a killed run ends early; it is repeated to its end.
    With --policy alone nothing is repeated: status 0 if that policy would have commanded the same within --tolerance.
    """

    file: Path
    """Recording (.mcap), finished or cut off."""
    infer: bool = False
    """Also run the policy on the recorded observations, and compare its answers with the recorded actions."""
    policy: str | None = None
    """ONNX checkpoint, or a shipped policy: what would it have commanded on the recorded states? With --infer: the
    recorded policy's file, where it is no longer where the recording says."""
    contract: Path | None = None
    """A contract.yaml for --policy. Default: the one beside it; the recorded one if it is the recorded policy."""
    csv: Path | None = None
    """With --policy: positions, torques and actions of both policies, a row per tick and joint (.csv)."""
    tolerance: float | None = None
    """Largest difference of a commanded position, rad, or with --infer of an action (a share of it beyond 1) that is
    still the same. Default: 1e-4, which another processor or build of ONNX Runtime stays below; 0: bit for bit."""
    json: bool = False
    """Print the result as JSON."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `replay` with command-line arguments; returns the exit status."""
    config = parse(ReplayConfig, "replay", arguments, positional=True)
    return replay(config)


def replay(config: ReplayConfig) -> int:
    """Repeat the recording and print what came of it; returns the exit status.

    Raises `InputError` if the recording, or the policy, cannot be used.
    """
    tolerance = _TOLERANCE if config.tolerance is None else config.tolerance
    if not (math.isfinite(tolerance) and tolerance >= 0.0):
        raise InputError(f"--tolerance: is {tolerance:g}, expected a finite number >= 0")
    recording = open_recording(config.file)
    if (config.policy is not None or config.infer) and "policies" in recording.header.documents:
        raise InputError(f"{config.file}: was run with several policies; --policy and --infer compare a single one")
    if config.policy is not None and not config.infer:
        return _compare(recording, config, policy_path(config.policy), tolerance)
    from humanoid_sim.stack import rebuild_supervisor  # noqa: PLC0415 - heavy; not needed for `--help`

    inference = _Inference(recording, config.policy, tolerance) if config.infer else None
    report = repeat_run(recording, rebuild_supervisor, inference, _with_progress(recording))
    if config.json:
        print(json.dumps(_as_json(recording, report, inference), indent=2))
    else:
        for line in _lines(recording, report, inference):
            print(line)
    return ExitStatus.of(report.is_identical and (inference is None or inference.report.is_same))


def _compare(recording: Recording, config: ReplayConfig, path: Path, tolerance: float) -> int:
    """Print what the policy of a file would have commanded on the recorded states; returns the exit status."""
    from humanoid_sim.policy.checkpoint import load_checkpoint  # noqa: PLC0415 - ONNX Runtime is heavy
    from humanoid_sim.recording.open_loop import Row, compare_open_loop  # noqa: PLC0415 - likewise

    settings = recorded_settings(recording.path, recording.header)
    if config.contract is None and settings.get("policy_sha256") == file_digest(path):
        checkpoint = _load(recording.path, recording.header, settings, str(path))
    else:
        checkpoint = load_checkpoint(path, config.contract, recording.header.joint_names)
    joints = recording.header.joint_names
    with ExitStack() as left:
        row: Row | None = None
        if config.csv is not None:
            file = left.enter_context(whole_file(output_file(config.csv, "--csv", ".csv")))
            table = csv.writer(left.enter_context(io.TextIOWrapper(file, "utf-8", newline="")), lineterminator="\n")
            names = [f"{who}_{what}" for what in ("position", "torque", "action") for who in ("recorded", "other")]
            table.writerow(["time_s", "joint", *names])

            def row(time: float, values: Mapping[str, FloatArray]) -> None:
                columns = (values[name].tolist() for name in names)
                table.writerows([time, joint, *numbers] for joint, *numbers in zip(joints, *columns, strict=True))

        report = compare_open_loop(recording, checkpoint, tolerance, row)
    if config.json:
        result = {"file": str(recording.path), "policy": checkpoint.source, **asdict(report), "same": report.is_same}
        print(json.dumps(finite(result), indent=2))
    else:
        _print_comparison(recording, checkpoint.source, report)
    return ExitStatus.of(report.is_same)


def _print_comparison(recording: Recording, source: str, report: OpenLoopReport) -> None:
    if not report.ticks and not report.failure:
        print("the recording holds no LOCOMOTION: there is nothing to compare")
        return
    columns = ("position max", "RMS", "torque max", "RMS", "action max", "beyond tolerance from")
    title = f"{source} on the recorded states, open loop: {report.ticks} ticks of LOCOMOTION, {report.steps} inferences"
    table = Table("joint", *columns, title=title, title_justify="left")
    for joint in report.joints:
        table.add_row(
            joint.joint,
            *(f"{value:.4g} rad" for value in (joint.position_max, joint.position_rms)),
            *(f"{value:.4g} N·m" for value in (joint.torque_max, joint.torque_rms)),
            "" if joint.action_max is None else f"{joint.action_max:.4g}",
            "" if joint.first_time is None else _seconds(joint.first_time),
        )
    wide = None if sys.stdout.isatty() else 200
    Console(highlight=False, emoji=False, soft_wrap=wide is not None, width=wide).print(table)
    first = report.first_time
    tolerance = f"{report.tolerance:g} rad"
    print(
        f"no command differs by more than {tolerance}"
        if first is None
        else f"commands differ by more than {tolerance} from {_seconds(first)} on"
    )
    if report.failure:
        print(f"it would have failed at {_seconds(report.failure_time)}: {report.failure}")
    if report.missing_ticks:
        print(f"{report.missing_ticks} ticks are missing: nothing is compared from there to the next LOCOMOTION")
    if not recording.is_complete:
        print(f"the recording is not complete: {recording.damage}")


class _Inference:
    """Runs the model on every recorded observation."""

    def __init__(self, recording: Recording, policy: str | None, tolerance: float) -> None:
        self.report = InferenceReport(tolerance)
        settings = recorded_settings(recording.path, recording.header)
        self.checkpoint = _load(recording.path, recording.header, settings, policy)
        recorded = settings.get("policy_sha256")
        self.is_same_file = recorded == self.checkpoint.sha256 if recorded else None

    def __call__(self, record: TickRecord, step: PolicyStep) -> None:
        width = self.checkpoint.observation_width
        if width is not None and step.observation.shape != (width,):
            raise InputError(
                f"{self.checkpoint.source}: its input is {width} wide, "
                f"the recorded observation {step.observation.shape[0]}"
            )
        self.report.add(record, step, self.checkpoint.policy(step.observation, step.frame))

    def line(self) -> str:
        report, source = self.report, self.checkpoint.source
        other = (
            "" if self.is_same_file is not False else " (another file than the one that was recorded: SHA-256 differs)"
        )
        if not report.steps:
            return f"infer: no policy step was reached, so nothing was compared{other}"
        if not report.differing:
            return f"infer: {source}{other}: {report.steps} actions, bit for bit identical"
        verdict = (
            f"{report.beyond} beyond the tolerance of {report.tolerance:g}"
            if report.beyond
            else f"within the tolerance of {report.tolerance:g}"
        )
        return (
            f"infer: {source}{other}: {report.differing} of {report.steps} actions differ, by at most "
            f"{report.max_difference:.3g}: {verdict}; first at tick {report.first_tick}, "
            f"t = {_seconds(report.first_time)}, frame {report.first_frame}"
        )


def _load(recording: Path, header: SessionHeader, settings: dict[str, Any], given: str | None) -> Checkpoint:
    """Return the model to run: the given one, or the one that the recording names."""
    from humanoid_sim.policy.checkpoint import load_checkpoint  # noqa: PLC0415 - ONNX Runtime is heavy
    from humanoid_sim.policy.onnx_policy import OnnxPolicy  # noqa: PLC0415 - ONNX Runtime is heavy
    from humanoid_sim.stack import recorded_contract  # noqa: PLC0415

    if given is not None:
        path = policy_path(given)
    else:
        named = settings.get("policy")
        if not isinstance(named, str) or named in ("", _PLACEHOLDER):
            raise InputError(f"{recording}: ran {named or 'no policy'}, which is not a model to infer with")
        path = Path(named)
        if not is_file(path):
            raise InputError(f"{recording}: ran {path}, which is not there; name the file with --policy")
    # The contract is the recorded one: the file may need a contract.yaml that is not here, and only its network runs.
    contract = recorded_contract(header)
    if contract is None:
        return load_checkpoint(path)
    policy = OnnxPolicy(path, contract.tensors)
    return Checkpoint(contract, policy, str(path), file_digest(path), policy.observation_width)


def _with_progress(recording: Recording) -> Iterator[Entry]:
    """Yield the entries, with a bar on stderr if a person is watching."""
    console = Console(stderr=True)
    columns = ("replaying", BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=recording.size)
        for count, entry in enumerate(recording.entries()):
            yield entry
            if count % 256 == 0:
                progress.update(task, completed=recording.position)


def _lines(recording: Recording, report: RepeatReport, inference: _Inference | None) -> Iterator[str]:
    if report.difference is not None:
        yield f"{report.ticks} ticks identical; tick {report.tick}, t = {_seconds(report.time)}, differs"
        yield f"  {report.difference}"
    elif report.gap:
        yield (
            f"{report.ticks} ticks identical; then {report.gap} ticks are missing from the recording (up to tick "
            f"{report.tick}, t = {_seconds(report.time)}), and the {report.unrepeated} that follow cannot be repeated"
        )
    elif not report.ticks:
        yield "the recording holds no ticks: there is nothing to repeat"
    else:
        yield f"{report.ticks} ticks, bit for bit identical"
    if report.missing:
        known = report.ticks + report.unrepeated + report.missing
        yield f"{report.missing} of {known} ticks are missing in all"
    if report.difference is None and not recording.is_complete:
        yield f"the recording is not complete: {recording.damage}"
    if inference is not None:
        yield inference.line()


def _seconds(time: float | None) -> str:
    return f"{time:.3f} s"


def _json_number(value: float | None) -> float | str | None:
    """JSON has no NaN and no infinity: a broken clock becomes a text."""
    return value if value is None or math.isfinite(value) else str(value)


def _as_json(recording: Recording, report: RepeatReport, inference: _Inference | None) -> dict[str, Any]:
    result: dict[str, Any] = {
        "file": str(recording.path),
        "ticks": report.ticks,
        "identical": report.is_identical,
        "tick": report.tick,
        "time": _json_number(report.time),
        "difference": None if report.difference is None else asdict(report.difference),
        "missing_ticks": report.missing,
        # A difference leaves the rest of the file unread.
        "complete": recording.is_complete if report.difference is None else None,
        "damage": recording.damage,
    }
    if inference is not None:
        result["infer"] = {
            "policy": inference.checkpoint.source,
            "same_file": inference.is_same_file,
            **asdict(inference.report),
            "same": inference.report.is_same,
            "first_time": _json_number(inference.report.first_time),
        }
    return result


if __name__ == "__main__":
    sys.exit(run_program(main))
