"""The files that a run of `play` leaves."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file, output_file
from humanoid_sim.play.front_ends import shows_window
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.rendering.backend import require_pictures

_RUNS = Path("runs")


@dataclass(frozen=True, slots=True)
class Outputs:
    """The files that a run leaves; None for those that it does not."""

    record: Path | None = None
    html: Path | None = None
    video: Path | None = None
    snapshot: Path | None = None
    summary: Path | None = None


_SUFFIXES = {"record": ".mcap", "html": ".html", "video": ".mp4", "snapshot": ".png", "summary": ".json"}


def choose_outputs(config: PlayConfig, motion: Path | None = None) -> Outputs:
    """Resolve `auto` and `none`; refuse to replace files that the user named, and at all those that the run reads.

    `motion` is the file that the motion is read from.
    """
    read = (*config.policy, config.contract, config.robot, config.calibration)
    inputs = [*(Path(name) for name in read if name is not None and is_file(name)), *([motion] if motion else [])]
    stem = f"{time.strftime('play-%Y%m%d-%H%M%S')}-{os.getpid()}"  # two runs may start in one second
    is_watched = config.viewer != "auto" or shows_window(config) or config.console
    automatic = {"record": True, "html": config.hardware is None and not is_watched}
    named: dict[str, Path] = {}
    for name, suffix in _SUFFIXES.items():
        option, value = f"--{name}", getattr(config, name)
        if value == "":
            raise InputError(f"{option}: is empty, expected a file name")
        if value == "auto" and name in automatic:
            if automatic[name]:
                named[name] = free_path(named.get("record", _RUNS / stem).with_suffix(suffix))
        elif value not in ("none", None):
            path = named[name] = Path(value)
            output_file(path, option, suffix, overwrite=config.overwrite)
            if any(path.exists() and source.exists() and path.samefile(source) for source in inputs):
                raise InputError(f"{option}: '{path}' is what this run reads; choose another name")
    for option in ("video", "snapshot"):
        if option in named:
            require_pictures(f"--{option}")
    if any(path.parent == _RUNS for path in named.values()):
        try:
            _RUNS.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(
                f"folder '{_RUNS}' for recordings cannot be made: {error.strerror}; use --record and --html"
            ) from None
    return Outputs(**named)


def free_path(path: Path) -> Path:
    """Return the path, or the first numbered one beside it that does not exist."""
    candidate, number = path, 1
    while candidate.exists():
        number += 1
        candidate = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return candidate
