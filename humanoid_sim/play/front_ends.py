"""Front ends that the options of `play` ask for, and who drives the robot."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from humanoid_sim.errors import InputError, require_known
from humanoid_sim.frontends.joy import read_bindings
from humanoid_sim.frontends.pads import Pads, describe_pads
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.policies import Policies
from humanoid_sim.rendering.pictures import has_display
from humanoid_sim.ros2.dds.domain import LOOPBACK
from humanoid_sim.session.keyboard import KEY_HELP
from humanoid_sim.session.script import ScriptStep, parse_script
from humanoid_sim.session.sources import VELOCITY_HELP

_OPEN_END = 10.0  # s that a policy without a motion runs when nothing else ends the run


def shows_window(config: PlayConfig) -> bool:
    """Return True if the run opens a window: on hardware, whose computer has other work, only if asked for."""
    return config.viewer == "native" or (config.viewer == "auto" and config.hardware is None and has_display())


def wanted_front_ends(config: PlayConfig) -> tuple[tuple[str, ...], ...]:
    """Return the front ends that a run starts, each with the options of its command line.

    Raises `InputError` for a network interface that is not there.
    """
    interface = _one(config.dds, "--dds", "network interface")
    if interface:
        require_known("network interface", [interface], [name for _, name in socket.if_nameindex()], "--dds: ")
    mapping = _one(config.gamepad, "--gamepad", "file (.yaml)")
    known = (
        (config.remote == "gravity", ("gravity",)),
        (config.console, ("console",)),
        (config.needs_gamepad, ("gamepad", "--mapping", mapping) if mapping else ("gamepad",)),
        (config.dds is not None, ("dds",)),
        (interface not in ("", LOOPBACK), ("dds", "--interface", interface)),
        (shows_window(config), ("viewer",)),
        (config.viewer == "rerun", ("rerun",)),
    )
    return tuple(front_end for is_wanted, front_end in known if is_wanted)


def _one(values: tuple[str, ...] | None, option: str, what: str) -> str:
    if values is not None and len(values) > 1:
        raise InputError(f"{option}: is {' '.join(values)}, expected one {what}")
    return values[0] if values else ""


def look_for_gamepad(config: PlayConfig) -> list[str]:
    """Return what an operator should know of the gamepads that are plugged in, before anything moves.

    Raises `InputError` if on a real bus none is plugged in that can be used.
    """
    if not config.needs_gamepad or config.dry_run:
        return []
    if config.gamepad:
        read_bindings(Path(config.gamepad[0]))
    with closing(Pads()) as pads:
        is_usable, lines = describe_pads(pads.poll())
    if not is_usable and config.is_real_bus:
        raise InputError(f"--hardware: {lines[-1]}; plug one in to damp the robot by, or say --no-gamepad")
    return [f"gamepad: {line}" for line in lines]


def operator_notices(
    config: PlayConfig, steps: Sequence[ScriptStep] | None, policies: Policies, external: Sequence[str]
) -> list[str]:
    """Return who drives the robot, and what has to come from programs that this run does not start, one line each.

    `steps` are those of a script that drives, `external` the names of the live inputs that come from other programs.
    """
    notices = []
    if config.has_keys:
        notices += [KEY_HELP, VELOCITY_HELP] if policies.walks else [KEY_HELP]
    elif steps is None and not config.dry_run:
        notices.append("waits for an operator, in another terminal: python -m humanoid_sim.mode damp, load_a, ...")
    for name in external:
        how = ", such as python -m humanoid_sim.midi" if name == KEY_PRESSED else ""
        notices.append(f"the policy observes {name}, which another program has to send{how}")
    return notices


def is_realtime(config: PlayConfig, front_ends: Sequence[Sequence[str]]) -> bool:
    """Return True if somebody, or a thread or a bus that lives in real time, takes part."""
    if config.hardware is None and config.pace != "auto":
        return config.pace == "realtime"
    return config.hardware is not None or config.manual or bool(front_ends)


def automatic_steps(config: PlayConfig, policies: Policies) -> tuple[ScriptStep, ...]:
    """Return the script that plays when nobody drives: long enough in each mode to see it."""
    start, run = "", f"hold {config.duration or _OPEN_END}"
    if config.remote != "none":
        start = "start_remote; "
    elif policies.first is not None:
        start = "start_locomotion; "
        if policies.first.loaded.motion is not None:
            run = "motion; hold 0.5"
    return parse_script(f"hold 0.5; damp; hold 1; load_a; wait; hold 0.2; {start}{run}; damp; hold 1")
