"""Reject options of `play` that conflict, and files that do not or already exist, before anything is made.

The error names the option. Nothing here imports MuJoCo or compiles a model, which takes seconds.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from humanoid_sim.assets import motion_path, policy_path
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file, output_file, regular_file
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.play.front_ends import has_keys, operated_by, shows_window
from humanoid_sim.play.options import NO_POLICY, OF_HARDWARE, SIMULATED, PlayConfig
from humanoid_sim.policy.checkpoint import PLACEHOLDER
from humanoid_sim.policy.onnx_policy import check_file
from humanoid_sim.rendering.backend import has_display, require_pictures
from humanoid_sim.session.outside_safety import parse_watchdogs
from humanoid_sim.session.sources import velocity_numbers

if TYPE_CHECKING:
    from humanoid_sim.robots.description import RobotDescription

_RUNS = Path("runs")
_DECIDES = ("policy_seconds",), ", which decides how long a policy runs"

_MEANINGLESS: tuple[tuple[Literal["with", "without"], str, tuple[str, ...], str], ...] = (
    ("without", "dds_interface", ("dds_safety",), "; on this machine statuses always count"),
    ("without", "hardware", OF_HARDWARE, ""),
    ("with", "hardware", (*SIMULATED, "push"), ""),
    *(("with", name, *_DECIDES) for name in ("manual", "script", "hardware", "remote")),
)
"""With, or without, which option which others mean nothing, and what more there is to say of that."""

_EITHER = {
    ("gamepad", "no_gamepad"): "expected at most one of them",
    ("motion", "song"): "both are given, expected one of them",
    ("manual", "script"): "both drive the FSM, expected at most one of them",
    ("policy_seconds", "duration"): "give either --policy-seconds or --duration, not both",
}
"""Options of which at most one may be given, and what to say."""

_POSITIVE = ("duration", "policy_seconds", "control_frequency", "action_limit")
_HIGHEST_DROP = 1.0
"""m; --base-height takes more."""


def refuse_early(config: PlayConfig) -> None:
    """Refuse files that do not exist, and a velocity that is none."""
    path = checkpoint_path(config)
    if path is not None:
        check_file(path)
    if config.contract is not None:
        regular_file(config.contract, "a YAML file")
    if config.motion is not None:
        motion_path(str(config.motion))
    velocity_numbers(config.command)


def checkpoint_path(config: PlayConfig) -> Path | None:
    """Return the file of the checkpoint that the options name; None for the sample policy, the placeholder and none."""
    if config.policy in (None, PLACEHOLDER, NO_POLICY):
        return None
    return policy_path(config.policy or "", also=(PLACEHOLDER, NO_POLICY))


def refuse_conflicts(config: PlayConfig) -> None:
    """Refuse options that exclude each other, and values out of range."""
    parse_watchdogs(config.watchdog)
    for one, other in _EITHER:
        refuse_both(one, other, config.is_given)
    for word, of, names, more in _MEANINGLESS:
        if config.is_given(of) == (word == "with"):
            _refuse(config, names, f"means nothing {word} {_option(of)}{more}")
    if config.hardware is not None and config.pace == "fast":
        raise InputError("--pace: is fast, but the time of a real robot is real")
    if config.hardware is not None and config.script is not None and not config.allow_script:
        raise InputError("--script: would move a real robot with nobody at the keys; add --allow-script if it may")
    if config.motion_topic is not None and config.motion is None:
        raise InputError(f"--motion-topic: is {config.motion_topic}, which means nothing without --motion")
    if not config.has_policy:
        why = "without a policy" if config.policy is not None else "without --policy: on hardware none runs by default"
        _refuse(config, ("contract", "motion", "song", "command", "policy_seconds"), f"means nothing {why}")
    if config.viewer == "native" and not has_display():
        raise InputError("--viewer native: there is no display here; --html out.html shows the run in a browser")
    _refuse_out_of_range(config)
    if config.manual and not has_keys(config) and not operated_by(config):
        raise InputError(
            "--manual: standard input is not a terminal, expected one to read keys from, or --console or --gamepad"
        )


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def refuse_both(one: str, other: str, is_given: Callable[[str], bool]) -> None:
    """Refuse two options of which at most one may be given."""
    if is_given(one) and is_given(other):
        raise InputError(f"{_option(one)} and {_option(other)}: {_EITHER[one, other]}")


def _refuse(config: PlayConfig, names: Iterable[str], why: str) -> None:
    """Refuse any of these options that is given."""
    for name in names:
        if config.is_given(name):
            raise InputError(f"{_option(name)}: {why}")


def _refuse_out_of_range(config: PlayConfig) -> None:
    if not abs(config.yaw) <= 2.0 * math.pi:
        raise InputError(
            f"--yaw: is {config.yaw:g} rad, expected -6.283 to 6.283 rad; is it in degrees? "
            f"{config.yaw:g}° is {math.radians(config.yaw):.4g} rad"
        )
    if not 0.0 <= config.drop <= _HIGHEST_DROP:
        raise InputError(f"--drop: is {config.drop:g} m, expected 0 to {_HIGHEST_DROP:g} m")
    for name in _POSITIVE:
        value = getattr(config, name)
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{_option(name)}: is {value}, expected a finite number > 0")


def refuse_without_effect(config: PlayConfig, contract: PolicyContract | None, description: RobotDescription) -> None:
    """Refuse options that change nothing for this policy, or for this robot."""
    idle: list[tuple[str, str]] = []
    if contract is None or not contract.takes_velocity_command:
        idle.append(("command", "this policy, which observes no velocity command"))
    if not description.is_floating and config.hardware is None:
        robot = f"'{description.name}', whose base does not move freely"
        idle += [(name, robot) for name in ("yaw", "base_height", "drop", "push")]
    if config.base_height is not None or description.base.height is not None:
        idle.append(("drop", "a base whose height is given"))
    for name, why in idle:
        _refuse(config, (name,), f"means nothing for {why}")


def refuse_unheard_keys(config: PlayConfig, taken: Container[str], reported: Container[str]) -> None:
    """Refuse a MIDI keyboard whose keys the run does not take.

    `taken` are the live inputs that come from other programs, `reported` those that the robot reports itself.
    """
    if config.midi is not None and KEY_PRESSED not in taken:
        knows = KEY_PRESSED in reported
        why = "this robot, which has a piano and knows its keys" if knows else "this policy, which plays no piano"
        raise InputError(f"--midi: means nothing for {why}")


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
    read = (config.policy, config.contract, config.robot, config.calibration)
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
