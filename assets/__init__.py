"""Robot descriptions, models, sample policies and motions that ship with the package."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from humanoid_sim.errors import InputError, known_names
from humanoid_sim.files import is_file

if __name__ != "humanoid_sim.assets":
    raise ImportError("import this package as 'humanoid_sim.assets', not as 'assets'")

__all__ = [
    "ASSETS",
    "PIANO_POLICY",
    "SAMPLE_MOTION",
    "SAMPLE_POLICY",
    "SAMPLE_SONG",
    "WALKING_POLICY",
    "asset_path",
    "motion_path",
    "policy_path",
    "sample_policy",
    "sample_songs",
    "shipped",
    "song_path",
]

ASSETS = Path(__file__).parent
SAMPLE_POLICY = ASSETS / "policies" / "lite_tracking.onnx"
WALKING_POLICY = ASSETS / "policies" / "lite_biped_velocity.onnx"
PIANO_POLICY = ASSETS / "policies" / "lite_piano.onnx"
SAMPLE_MOTION = "wave"
SAMPLE_SONG = "ode_to_joy"
_ENDS = {"robots": ".yaml", "suites": ".yaml", "motions": ".mcap", "policies": ".onnx", "songs": ".mid"}


def sample_policy(robot: str) -> Path:
    """Return the policy that ships for a robot of this name; for one that has none, that of the arms."""
    return {"lite_biped": WALKING_POLICY, "lite_piano": PIANO_POLICY}.get(robot, SAMPLE_POLICY)


def asset_path(*parts: str) -> Path:
    """Return the path of a file or folder that ships with the package."""
    return ASSETS.joinpath(*parts)


def shipped(kind: str) -> tuple[str, ...]:
    """Return the names of what ships with the package: of `robots`, `suites`, `motions`, `songs`, `policies`."""
    return tuple(path.name.removesuffix(_ENDS[kind]) for path in _ending(kind, _ENDS[kind]))


def _ending(kind: str, end: str) -> list[Path]:
    return sorted((ASSETS / kind).glob(f"*{end}"))


def motion_path(name: str) -> Path:
    """Return a sample motion by name, else a file by path.

    Raises:
        InputError: if it is neither.
    """
    sample = asset_path("motions", f"{name}.mcap")
    if is_file(sample):
        return sample
    path = Path(name)
    if not os.path.exists(path):
        raise InputError(f"--motion: {known_names('motion', name, shipped('motions'))}; or a file that exists (.mcap)")
    return path


def policy_path(
    name: str | Path, option: str = "--policy", *, also: Sequence[str] = (), contracts: bool = False
) -> Path:
    """Return the file of a policy: a path where a file of this name exists, else a sample policy by name.

    What cannot be a name (it has a folder or a suffix) is a path, and opening it says what is wrong with it.

    Args:
        name: of a sample policy, or a path.
        option: that names it, for the message.
        also: other names that the option takes, for the message.
        contracts: samples of contracts alone are policies too.

    Raises:
        InputError: it is neither.
    """
    path = Path(name)
    if is_file(path):
        return path
    ends = (_ENDS["policies"], ".contract.yaml") if contracts else (_ENDS["policies"],)
    samples = {file.name.removesuffix(end): file for end in reversed(ends) for file in _ending("policies", end)}
    if str(name) in samples:
        return samples[str(name)]
    if path.suffix or len(path.parts) > 1 or os.path.exists(path):
        return path
    known = known_names("policy", str(name), (*sorted(samples), *also))
    raise InputError(f"{option}: {known}; or a file that exists ({'.onnx or .yaml' if contracts else '.onnx'})")


def sample_songs() -> tuple[str, ...]:
    """Names of the sample songs."""
    return shipped("songs")


def song_path(name: str, what: str = "--song") -> Path:
    """Return a sample song by name, else a MIDI file by path; `what` is what a refusal calls it.

    Raises:
        InputError: if it is neither.
    """
    songs = sample_songs()
    if name in songs:
        return asset_path("songs", f"{name}.mid")
    if not os.path.exists(name):
        raise InputError(f"{what}: {known_names('song', name, songs)}; or a MIDI file that exists")
    return Path(name)
