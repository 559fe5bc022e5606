"""`python -m humanoid_sim.replay run.mcap`: repeat a recording bit for bit, and name the first value that differs."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

from rich.progress import BarColumn, Progress, TaskProgressColumn, TimeRemainingColumn

from humanoid_sim.assets import policy_path
from humanoid_sim.cli import ExitStatus, run_program
from humanoid_sim.command_line import parse
from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file
from humanoid_sim.messages import Event, PolicyStep, SessionHeader, TickRecord
from humanoid_sim.policy.checkpoint import Checkpoint, file_digest
from humanoid_sim.recording.reader import Entry, Recording, open_recording, recorded_settings
from humanoid_sim.recording.repeat import InferenceReport, RepeatReport, repeat_run

_PLACEHOLDER = "placeholder"
_TOLERANCE = 1e-4
"""Difference of an action: above what float32 sums in another order differ by, far below what any joint shows."""


@dataclass(frozen=True)
class ReplayConfig:
    """Repeat a recording through the control stack, with the recorded actions in the policy's place.

    Exit status 0: every tick is bit for bit identical, and with --infer every answer of the network is the recorded
    one within --tolerance. 1: a tick or an answer differs, ticks are missing, the file is damaged, or there is nothing
    to compare. 2: the file is not a recording. The recording of a killed run ends early; it is repeated to its end.
    """

    file: Path
    """Recording (.mcap), finished or cut off."""
    infer: bool = False
    """Also run the policy on the recorded observations, and compare its answers with the recorded actions."""
    policy: str | None = None
    """ONNX checkpoint, or a shipped policy ({policies}), for --infer, which it implies. Default: the file that
    the recording names."""
    tolerance: float | None = None
    """With --infer: largest difference of an action (a share of it beyond 1) that is still the same answer. Default:
    1e-4, which another processor or build of ONNX Runtime stays below; 0: bit for bit."""
    json: bool = False
    """Print the result as JSON."""

    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (
        ("runs/run.mcap", "does the stack still do exactly that?"),
        ("runs/run.mcap --infer", "... and the network?"),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `replay` with command-line arguments; returns the exit status."""
    config = parse(ReplayConfig, "replay", arguments, positional=True)
    return replay(config)


def replay(config: ReplayConfig) -> int:
    """Repeat the recording and print what came of it; returns the exit status.

    Raises `InputError` if the recording, or the policy, cannot be used.
    """
    infers = config.infer or config.policy is not None
    tolerance = _tolerance(config.tolerance, infers)
    recording = open_recording(config.file)
    from humanoid_sim.stack import rebuild_supervisor  # noqa: PLC0415 - heavy; not needed for `--help`

    inference = _Inference(recording, config.policy, tolerance) if infers else None
    report = repeat_run(recording, rebuild_supervisor, inference, _with_progress(recording, inference))
    if config.json:
        print(json.dumps(_as_json(recording, report, inference), indent=2))
    else:
        for line in _lines(recording, report, inference):
            print(line)
    return ExitStatus.of(report.is_identical and (inference is None or inference.report.is_same))


def _tolerance(value: float | None, infers: bool) -> float:
    if value is None:
        return _TOLERANCE
    if not infers:
        raise InputError("--tolerance has no effect without --infer or --policy")
    if not (math.isfinite(value) and value >= 0.0):
        raise InputError(f"--tolerance: is {value:g}, expected a finite number >= 0")
    return value


class _Inference:
    """Runs the model on every recorded observation."""

    def __init__(self, recording: Recording, policy: str | None, tolerance: float) -> None:
        self._recording, self._given = recording, policy
        self.report = InferenceReport(tolerance)
        self.is_same_file: bool | None = None
        self.follow(recording.header if "contract" in recording.header.documents else recording.of_last_policy().header)

    def follow(self, header: SessionHeader) -> None:
        """Infer with the policy of this header from here on. Raises `InputError` if it cannot be used."""
        settings = recorded_settings(self._recording.path, header)
        self.checkpoint = _load(self._recording.path, header, settings, self._given)
        recorded = settings.get("policy_sha256")
        if recorded and self.is_same_file is not False:
            self.is_same_file = recorded == self.checkpoint.sha256

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


def _with_progress(recording: Recording, inference: _Inference | None) -> Iterator[Entry]:
    """Yield the entries, with a bar on stderr if a person is watching; `inference` follows their policies."""
    from rich.console import Console  # noqa: PLC0415

    console = Console(stderr=True)
    columns = ("replaying", BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=recording.size)
        for count, entry in enumerate(recording.entries(past_damage=True)):
            if inference is not None and isinstance(entry, Event) and entry.header is not None:
                inference.follow(entry.header)
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
