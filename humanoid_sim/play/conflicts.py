"""Reject conflicting options of `play`, and files that exist, before anything is made: the error names the option."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file
from humanoid_sim.messages import Intent
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.play.front_ends import has_keys, operated_by, shows_window
from humanoid_sim.play.options import NO_POLICY, SIMULATED, PlayConfig
from humanoid_sim.rendering.backend import has_display
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.session.inject import Injection
from humanoid_sim.session.outside_safety import parse_watchdogs
from humanoid_sim.session.script import parse_script

_RUNS = Path("runs")


def refuse_conflicts(config: PlayConfig, injections: Sequence[Injection]) -> None:
    """Refuse options that exclude each other, and values out of range; `injections` are those of --inject."""
    parse_watchdogs(config.watchdog)
    if config.dds_safety and config.dds_interface is None:
        raise InputError("--dds-safety: means nothing without --dds-interface; on this machine statuses always count")
    if config.gamepad is not None and config.no_gamepad:
        raise InputError("--gamepad and --no-gamepad: expected at most one of them")
    _refuse_hardware_conflicts(config)
    _refuse_beside_shadow(config, injections)
    if config.motion_topic is not None and config.motion is None:
        raise InputError(f"--motion-topic: is {config.motion_topic}, which means nothing without --motion")
    if not config.has_policy:
        why = "without a policy" if config.policy is not None else "without --policy: on hardware none runs by default"
        _refuse(config, _OF_POLICY, f"means nothing {why}")
    if config.motion is not None and config.song is not None:
        raise InputError("--motion and --song: both are given, expected one of them")
    if config.manual and config.script is not None:
        raise InputError("--manual and --script: both drive the FSM, expected at most one of them")
    if config.viewer == "native" and not has_display():
        raise InputError("--viewer native: there is no display here; use --video out.mp4 instead")
    _refuse_out_of_range(config)
    if config.policy_seconds is not None:
        _refuse_policy_seconds(config)
    if config.manual and not has_keys(config) and not operated_by(config):
        raise InputError(
            "--manual: standard input is not a terminal, expected one to read keys from, or --console or --gamepad"
        )
    if config.remote == "none" and any(injection.kind == "silent_remote" for injection in injections):
        raise InputError("--inject: silent_remote needs a source of commands to silence: use --remote gravity")


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


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _refuse(config: PlayConfig, names: Iterable[str], why: str) -> None:
    """Refuse any of these options that is given."""
    for name in names:
        if config.is_given(name):
            raise InputError(f"{_option(name)}: {why}")


def _refuse_hardware_conflicts(config: PlayConfig) -> None:
    """Refuse options that mean nothing with, or without, real motors, and a motion that nobody there has asked for."""
    if config.hardware is None:
        _refuse(config, _HARDWARE_ONLY, "means nothing without --hardware")
        return
    _refuse(config, (*SIMULATED, "push"), "means nothing with --hardware")
    if config.pace == "fast":
        raise InputError("--pace: is fast, but the time of a real robot is real")
    if config.script is not None and not config.allow_script:
        raise InputError("--script: would move a real robot with nobody at the keys; add --allow-script if it may")


def _refuse_beside_shadow(config: PlayConfig, injections: Sequence[Injection]) -> None:
    """Refuse what would take the robot out of the modes in which a shadow policy runs, or what it does not have."""
    if config.shadow is None:
        return
    why = "means nothing with --shadow, whose robot stays in DAMPING and STANDBY"
    _refuse(config, ("policy", "branch", "remote"), why)
    if any(injection.kind == "nan_policy" for injection in injections):
        raise InputError("--inject: nan_policy means nothing with --shadow: it is for a policy that drives")
    for step in () if config.script is None else parse_script(config.script):
        if step.kind == "motion" or step.intent in (Intent.START_LOCOMOTION, Intent.START_REMOTE):
            word = step.kind if step.intent is None else step.intent.value
            raise InputError(f"--script: has {word}, but with --shadow the robot stays in DAMPING and STANDBY")


def _refuse_policy_seconds(config: PlayConfig) -> None:
    """Refuse it where something else decides how long the policy runs."""
    if config.duration is not None:
        raise InputError("--policy-seconds and --duration: give either --policy-seconds or --duration, not both")
    for name in ("manual", "script", "hardware", "remote"):
        if config.is_given(name):
            why = f"means nothing with {_option(name)}, which decides how long a policy runs"
            raise InputError(f"--policy-seconds: {why}")


def refuse_beside_branch(config: PlayConfig) -> None:
    """Refuse options that contradict the run in which a branch begins; called before its options are taken over."""
    if config.branch is None:
        return
    if config.policy == NO_POLICY:
        raise InputError("--policy: is none, but --branch goes on with a policy")
    contradicting = ("again", "hardware", "policy_seconds", "shadow", *_BRANCH_KEEPS)
    _refuse(config, contradicting, "means nothing with --branch, which goes on as recorded")


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
        if config.branch is None or name not in _BRANCH_KEEPS:
            _refuse(config, (name,), f"means nothing for {why}")


def refuse_unheard_keys(config: PlayConfig, taken: Container[str], reported: Container[str]) -> None:
    """Refuse a MIDI keyboard whose keys the run does not take.

    Args:
        taken: names of the live inputs that come from other programs.
        reported: names of those that the robot reports itself.
    """
    if config.midi is not None and KEY_PRESSED not in taken:
        knows = KEY_PRESSED in reported
        why = "this robot, which has a piano and knows its keys" if knows else "this policy, which plays no piano"
        raise InputError(f"--midi: means nothing for {why}")


_HIGHEST_DROP = 1.0
"""m; --base-height takes more."""
_POSITIVE = ("duration", "policy_seconds", "control_frequency", "action_limit")
_OF_POLICY = ("contract", "motion", "song", "command", "policy_seconds")
_HARDWARE_ONLY = (*PlayConfig.GROUPS["a real robot"], "no_gamepad")
_BRANCH_KEEPS = ("robot", "check_poses", "control_frequency", *SIMULATED)
"""Options of the simulated robot, which goes on as it was."""


@dataclass(frozen=True, slots=True)
class Outputs:
    """The files that a run leaves; None for those that it does not."""

    record: Path | None = None
    video: Path | None = None
    snapshot: Path | None = None
    summary: Path | None = None


_SUFFIXES = {"record": ".mcap", "video": ".mp4", "snapshot": ".png", "summary": ".json"}


def choose_outputs(config: PlayConfig, inputs: Sequence[Path] = ()) -> Outputs:
    """Resolve `auto` and `none`; refuse to replace files that the user named, and at all those that the run reads."""
    stem = f"{time.strftime('play-%Y%m%d-%H%M%S')}-{os.getpid()}"  # two runs may start in one second
    is_drawn = config.hardware is None and config.viewer == "auto" and not shows_window(config)
    named: dict[str, Path] = {}
    automatic: dict[str, Path] = {}
    for name, suffix in _SUFFIXES.items():
        option, value = f"--{name}", getattr(config, name)
        if value == "":
            raise InputError(f"{option}: is empty, expected a file name")
        if value == "auto" and (name == "record" or (name == "video" and is_drawn)):
            automatic[name] = _free(_RUNS / f"{stem}{suffix}")
        elif value not in ("auto", "none", None):
            path = named[name] = Path(value)
            output_file(path, option, suffix, overwrite=config.overwrite)
            if any(path.exists() and source.exists() and path.samefile(source) for source in inputs):
                raise InputError(f"{option}: '{path}' is what this run reads; choose another name")
    if automatic:
        try:
            _RUNS.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(
                f"folder '{_RUNS}' for recordings cannot be made: {error.strerror}; use --record and --video"
            ) from None
    return Outputs(**named, **automatic)


def _free(path: Path) -> Path:
    """Return the path, or the first numbered one beside it that does not exist."""
    candidate, number = path, 1
    while candidate.exists():
        number += 1
        candidate = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return candidate
