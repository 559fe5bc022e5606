"""Options of `play` that are refused before anything is made, and those that have no effect in a run.

Nothing here imports MuJoCo or compiles a model, which takes seconds.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from humanoid_sim.assets import motion_path, policy_path
from humanoid_sim.errors import InputError
from humanoid_sim.files import regular_file
from humanoid_sim.play.front_ends import has_keys, operated_by
from humanoid_sim.play.options import NO_POLICY, OF_HARDWARE, SIMULATED, PlayConfig
from humanoid_sim.policy.checkpoint import PLACEHOLDER
from humanoid_sim.policy.onnx_policy import check_file
from humanoid_sim.rendering.backend import has_display
from humanoid_sim.session.outside_safety import parse_watchdogs
from humanoid_sim.session.sources import velocity_numbers

if TYPE_CHECKING:
    from humanoid_sim.controllers.contract import PolicyContract
    from humanoid_sim.robots.description import RobotDescription


def refuse_early(config: PlayConfig) -> None:
    """Refuse files that do not exist, and a velocity that is none."""
    for name in config.policy:
        path = checkpoint_path(name)
        if path is not None:
            check_file(path)
    if config.contract is not None:
        regular_file(config.contract, "a YAML file")
    if config.motion is not None:
        motion_path(str(config.motion))
    velocity_numbers(config.command)


def checkpoint_path(name: str | None) -> Path | None:
    """Return the file of a checkpoint that an option names; None for the sample policy, the placeholder and none."""
    if name in (None, PLACEHOLDER, NO_POLICY):
        return None
    return policy_path(name or "", also=(PLACEHOLDER, NO_POLICY))


def refuse(config: PlayConfig) -> None:
    """Refuse what would endanger a robot, contradicts itself, or is out of range."""
    parse_watchdogs(config.watchdog)
    if config.hardware is not None and config.pace == "fast":
        raise InputError("--pace: is fast, but the time of a real robot is real")
    if config.hardware is not None and config.script is not None and not config.allow_script:
        raise InputError("--script: would move a real robot with nobody at the keys; add --allow-script if it may")
    if config.manual and config.script is not None:
        raise InputError("--manual and --script: both drive the FSM, expected at most one of them")
    if config.manual and not has_keys(config) and not operated_by(config):
        raise InputError(
            "--manual: standard input is not a terminal, expected one to read keys from, or --console or --gamepad"
        )
    if len(config.policy) > 1 and NO_POLICY in config.policy:
        raise InputError("--policy: none is given beside others, expected it alone")
    if len(config.policy) > 1 and config.contract is not None:
        raise InputError("--contract: is given for several policies, expected a x.contract.yaml beside each x.onnx")
    if config.motion is not None and config.song is not None:
        raise InputError("--motion and --song: both are given, expected one of them")
    if config.viewer == "native" and not has_display():
        raise InputError("--viewer native: there is no display here; --html out.html shows the run in a browser")
    if not 0.0 <= config.drop <= 1.0:
        raise InputError(f"--drop: is {config.drop:g} m, expected 0 to 1 m")
    for name in ("duration", "policy_seconds", "control_frequency", "action_limit"):
        value = getattr(config, name)
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{_option(name)}: is {value}, expected a finite number > 0")


def options_without_effect(
    config: PlayConfig, contract: PolicyContract | None, description: RobotDescription
) -> tuple[str, ...]:
    """Say which options change nothing in this run, a line for each reason."""
    reasons: list[tuple[str, tuple[str, ...]]] = []
    if config.hardware is None:
        reasons.append(("in simulation", OF_HARDWARE))
    else:
        reasons.append(("on hardware", SIMULATED))
    if contract is None:
        reasons.append(("without a policy", ("contract", "motion", "song", "command", "policy_seconds")))
    elif not contract.takes_velocity_command:
        reasons.append(("for a policy that observes no velocity command", ("command",)))
    if config.hardware is None and not description.is_floating:
        reasons.append(("for a base that does not move freely", ("drop",)))
    found = ((why, [_option(name) for name in names if config.is_given(name)]) for why, names in reasons)
    return tuple(f"without effect {why}: {', '.join(given)}" for why, given in found if given)


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"
