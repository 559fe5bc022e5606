"""Options of `play` that conflict, with one another or with files that exist: refused before anything is made."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Container, Sequence
from dataclasses import dataclass
from pathlib import Path

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError
from humanoid_sim.files import output_file
from humanoid_sim.messages import Intent
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.play.front_ends import has_keys, operated_by, shows_window
from humanoid_sim.play.options import NO_POLICY, PlayConfig
from humanoid_sim.rendering.backend import has_display
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.session.inject import Injection
from humanoid_sim.session.outside_safety import parse_watchdogs
from humanoid_sim.session.script import parse_script

_RUNS = Path("runs")


def refuse_conflicts(config: PlayConfig, injections: Sequence[Injection]) -> None:
    """Refuse options that exclude each other.

    Args:
        config: the options.
        injections: of --inject.

    Raises:
        InputError: naming the option.
    """
    parse_watchdogs(config.watchdog)
    if config.dds_safety and config.dds_interface is None:
        raise InputError("--dds-safety: means nothing without --dds-interface; on this machine statuses always count")
    if config.gamepad is not None and config.no_gamepad:
        raise InputError("--gamepad and --no-gamepad: expected at most one of them")
    _refuse_hardware_conflicts(config)
    _refuse_beside_shadow(config, injections)
    if config.motion_topic is not None and config.motion is None:
        raise InputError(f"--motion-topic: is {config.motion_topic}, which means nothing without --motion")
    _refuse_without_policy(config)
    if config.motion is not None and config.song is not None:
        raise InputError("--motion and --song: both are given, expected one of them")
    if config.manual and config.script is not None:
        raise InputError("--manual and --script: both drive the FSM, expected at most one of them")
    if config.viewer == "native" and not has_display():
        raise InputError("--viewer native: there is no display here; use --video out.mp4 instead")
    if not abs(config.yaw) <= 2.0 * math.pi:
        raise InputError(
            f"--yaw: is {config.yaw:g} rad, expected -6.283 to 6.283 rad; is it in degrees? "
            f"{config.yaw:g}° is {math.radians(config.yaw):.4g} rad"
        )
    if not 0.0 <= config.drop <= _HIGHEST_DROP:
        raise InputError(f"--drop: is {config.drop:g} m, expected 0 to {_HIGHEST_DROP:g} m")
    for option, value in (
        ("--duration", config.duration),
        ("--policy-seconds", config.policy_seconds),
        ("--control-frequency", config.control_frequency),
        ("--action-limit", config.action_limit),
    ):
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{option}: is {value}, expected a finite number > 0")
    _refuse_policy_seconds(config)
    if config.manual and not has_keys(config) and not operated_by(config):
        raise InputError(
            "--manual: standard input is no terminal, expected one to read keys from, or --console or --gamepad"
        )
    if config.remote == "none" and any(injection.kind == "silent_remote" for injection in injections):
        raise InputError("--inject: silent_remote needs a source of commands to silence: use --remote gravity")


def _refuse_beside_shadow(config: PlayConfig, injections: Sequence[Injection]) -> None:
    """Refuse what would take the robot out of the modes in which a shadow policy runs, or what it does not have."""
    if config.shadow is None:
        return
    for option, given in (
        ("--policy", config.policy is not None),
        ("--branch", config.branch is not None),
        ("--remote", config.remote != "none"),
    ):
        if given:
            raise InputError(f"{option}: means nothing with --shadow, whose robot stays in DAMPING and STANDBY")
    if any(injection.kind == "nan_policy" for injection in injections):
        raise InputError("--inject: nan_policy means nothing with --shadow: it is for a policy that drives")
    for step in () if config.script is None else parse_script(config.script):
        if step.kind == "motion" or step.intent in (Intent.START_LOCOMOTION, Intent.START_REMOTE):
            word = step.kind if step.intent is None else step.intent.value
            raise InputError(f"--script: has {word}, but with --shadow the robot stays in DAMPING and STANDBY")


def _refuse_without_policy(config: PlayConfig) -> None:
    """Refuse what belongs to a policy where none runs."""
    if config.has_policy:
        return
    why = "without a policy" if config.policy is not None else "without --policy: on hardware none runs by default"
    for name in ("contract", "motion", "song", "command", "policy_seconds"):
        if getattr(config, name) != PlayConfig.__dataclass_fields__[name].default:
            raise InputError(f"--{name.replace('_', '-')}: means nothing {why}")


def _refuse_policy_seconds(config: PlayConfig) -> None:
    """Refuse it where something else decides how long the policy runs, or none runs."""
    if config.policy_seconds is None:
        return
    if config.duration is not None:
        raise InputError("--policy-seconds and --duration: give either --policy-seconds or --duration, not both")
    for option, given in (
        ("--manual", config.manual),
        ("--script", config.script is not None),
        ("--hardware", config.hardware is not None),
        ("--remote", config.remote != "none"),
    ):
        if given:
            raise InputError(f"--policy-seconds: means nothing with {option}, which decides how long a policy runs")


def refuse_without_effect(config: PlayConfig, contract: PolicyContract | None, description: RobotDescription) -> None:
    """Refuse options that change nothing for this policy, or for this robot.

    Raises:
        InputError: naming the option, and why.
    """
    robot = f"'{description.name}', whose base does not move freely"
    walks = contract is not None and contract.takes_velocity_command
    for name, has_effect, why in (
        ("command", walks, "this policy, which observes no velocity command"),
        ("yaw", description.is_floating or config.hardware is not None, robot),
        ("base_height", description.is_floating or config.hardware is not None, robot),
        ("drop", description.is_floating or config.hardware is not None, robot),
        ("drop", config.base_height is None and description.base.height is None, "a base whose height is given"),
        ("push", description.is_floating or config.hardware is not None, robot),
    ):
        is_chosen = config.branch is None or name not in _BRANCH_KEEPS
        if is_chosen and not has_effect and getattr(config, name) != PlayConfig.__dataclass_fields__[name].default:
            raise InputError(f"--{name.replace('_', '-')}: means nothing for {why}")


def refuse_unheard_keys(config: PlayConfig, taken: Container[str], reported: Container[str]) -> None:
    """Refuse a MIDI keyboard whose keys the run does not take.

    Args:
        config: of the run.
        taken: names of the live inputs that come from other programs.
        reported: names of those that the robot reports itself.

    Raises:
        InputError: saying why.
    """
    if config.midi is not None and KEY_PRESSED not in taken:
        knows = KEY_PRESSED in reported
        why = "this robot, which has a piano and knows its keys" if knows else "this policy, which plays no piano"
        raise InputError(f"--midi: means nothing for {why}")


_HIGHEST_DROP = 1.0
"""m; --base-height takes more."""
_SIMULATION_ONLY = (
    "actuation",
    "base_height",
    "command_delay",
    "drop",
    "imu_site",
    "physics_timestep",
    "push",
    "state_delay",
    "state_sampling",
    "yaw",
)
_HARDWARE_ONLY = (
    "accept_firmware",
    "allow_no_timeout",
    "allow_script",
    "calibration",
    "can_timeout",
    "dry_run",
    "host_id",
    "imu",
    "imu_mounting",
    "no_gamepad",
    "yes",
)


_BRANCH_KEEPS = (
    "robot",
    "check_poses",
    "imu_site",
    "yaw",
    "base_height",
    "drop",
    "actuation",
    "control_frequency",
    "physics_timestep",
    "command_delay",
    "state_delay",
    "state_sampling",
)
"""Of the simulated robot, which goes on as it was."""


def refuse_beside_branch(config: PlayConfig) -> None:
    """Refuse options that contradict the run in which a branch begins; called before its options are taken over.

    Raises:
        InputError: naming the option.
    """
    if config.branch is None:
        return
    if config.policy == NO_POLICY:
        raise InputError("--policy: is none, but --branch goes on with a policy")
    for name in ("again", "hardware", "policy_seconds", "shadow", *_BRANCH_KEEPS):
        if getattr(config, name) != PlayConfig.__dataclass_fields__[name].default:
            raise InputError(f"--{name.replace('_', '-')}: means nothing with --branch, which goes on as recorded")


def _refuse_hardware_conflicts(config: PlayConfig) -> None:
    """Refuse options that mean nothing with, or without, real motors, and a motion that nobody there has asked for."""
    others, where = (_HARDWARE_ONLY, "without") if config.hardware is None else (_SIMULATION_ONLY, "with")
    for name in others:
        if getattr(config, name) != PlayConfig.__dataclass_fields__[name].default:
            raise InputError(f"--{name.replace('_', '-')}: means nothing {where} --hardware")
    if config.hardware is None:
        return
    if config.pace == "fast":
        raise InputError("--pace: is fast, but the time of a real robot is real")
    if config.script is not None and not config.allow_script:
        raise InputError("--script: would move a real robot with nobody at the keys; add --allow-script if it may")


@dataclass(frozen=True, slots=True)
class Outputs:
    """The files that a run leaves; None for those that it does not."""

    record: Path | None = None
    video: Path | None = None
    snapshot: Path | None = None
    summary: Path | None = None


def choose_outputs(config: PlayConfig, inputs: Sequence[Path] = ()) -> Outputs:
    """Resolve `auto` and `none`, and refuse to replace files that the user named, and at all those that the run reads.

    Args:
        config: the options.
        inputs: files that the run reads.

    Raises:
        InputError: naming the option and the file.
    """
    stem = f"{time.strftime('play-%Y%m%d-%H%M%S')}-{os.getpid()}"  # two runs may start in one second
    is_drawn = config.hardware is None and config.viewer == "auto" and not shows_window(config)
    outputs = Outputs(
        record=_output("--record", config.record, _free(_RUNS / f"{stem}.mcap")),
        video=_output("--video", config.video, _free(_RUNS / f"{stem}.mp4") if is_drawn else None),
        snapshot=_output("--snapshot", config.snapshot, None),
        summary=_output("--summary", config.summary, None),
    )
    named = {
        "--record": (config.record, outputs.record, ".mcap"),
        "--video": (config.video, outputs.video, ".mp4"),
        "--snapshot": (config.snapshot, outputs.snapshot, ".png"),
        "--summary": (config.summary, outputs.summary, ".json"),
    }
    for option, (value, path, suffix) in named.items():
        if path is not None and value != "auto":
            output_file(path, option, suffix, overwrite=config.overwrite)
            _refuse_input(option, path, inputs)
    if any(value == "auto" and path is not None for value, path, _ in named.values()):
        try:
            _RUNS.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(
                f"folder '{_RUNS}' for recordings cannot be made: {error.strerror}; use --record and --video"
            ) from None
    return outputs


def _refuse_input(option: str, path: Path, inputs: Sequence[Path]) -> None:
    """Refuse an output that is one of the files that the run reads, by whatever name."""
    for source in inputs:
        if path.exists() and source.exists() and path.samefile(source):
            raise InputError(f"{option}: '{path}' is what this run reads; choose another name")


def _output(option: str, value: str | None, automatic: Path | None) -> Path | None:
    if value == "auto":
        return automatic
    if value is None or value == "none":
        return None
    if not value:
        raise InputError(f"{option}: is empty, expected a file name")
    return Path(value)


def _free(path: Path) -> Path:
    """Return the path, or the first numbered one beside it that does not exist."""
    candidate, number = path, 1
    while candidate.exists():
        number += 1
        candidate = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return candidate
