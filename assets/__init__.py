"""Robot descriptions, models, sample policies and motions that ship with the package."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from humanoid_sim.errors import InputError, known_names

if __name__ != "humanoid_sim.assets":
    raise ImportError("import this package as 'humanoid_sim.assets', not as 'assets'")

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
    return tuple(_samples(kind, _ENDS[kind]))


def _samples(kind: str, end: str) -> dict[str, Path]:
    return {path.name.removesuffix(end): path for path in sorted((ASSETS / kind).glob(f"*{end}"))}


def _chosen(what: str, name: str | Path, samples: Mapping[str, Path], also: Sequence[str] = ()) -> Path:
    """Return a file of this name where there is one, else the sample of this name.

    What has a folder or a suffix is a path: opening it says what is wrong with it.
    """
    path = Path(name)
    if not os.path.isfile(path) and str(name) in samples:
        return samples[str(name)]
    if path.suffix or len(path.parts) > 1 or os.path.exists(path):
        return path
    option, _, kind = what.rpartition(" ")
    raise InputError(f"{option} {known_names(kind, str(name), (*sorted(samples), *also))}; or a file that exists")


def motion_path(name: str | Path) -> Path:
    """Return a motion file by path, or a sample motion by name. Raises `InputError` if it is neither."""
    return _chosen("--motion: motion", name, _samples("motions", ".mcap"))


def policy_path(
    name: str | Path, option: str = "--policy", *, also: Sequence[str] = (), contracts: bool = False
) -> Path:
    """Return the file of a policy by path, or a sample policy by name. Raises `InputError` if it is neither.

    `also` has other names that the option takes; with `contracts`, samples of contracts alone are policies too.
    """
    beside = _samples("policies", ".contract.yaml") if contracts else {}
    return _chosen(f"{option}: policy", name, beside | _samples("policies", ".onnx"), also)


def song_path(name: str | Path, option: str = "--song") -> Path:
    """Return a MIDI file by path, or a sample song by name. Raises `InputError` if it is neither."""
    return _chosen(f"{option}: song", name, _samples("songs", ".mid"))
