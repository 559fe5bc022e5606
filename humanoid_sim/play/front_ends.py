"""Front ends that the options of `play` ask for, and who drives the robot."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from humanoid_sim.controllers.contract import PolicyContract, live_topic
from humanoid_sim.errors import InputError
from humanoid_sim.frontends import Wanted, require_packages
from humanoid_sim.frontends.gamepad.layout import PadLayout, chosen_layout
from humanoid_sim.messages import Intent
from humanoid_sim.mit import KEY_PRESSED
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.rendering.backend import has_display
from humanoid_sim.ros2.dds.domain import check_network_interface
from humanoid_sim.session.keyboard import key_help
from humanoid_sim.session.script import ScriptStep, parse_script
from humanoid_sim.session.sources import velocity_key_help

if TYPE_CHECKING:
    from humanoid_sim.policy.motion import Motion
    from humanoid_sim.robots.description import RobotDescription

_LOOK_WITHIN = 20.0
"""s for the program that looks for a gamepad."""
_BRIDGE_RESTARTS = 3
"""For a DDS bridge that dies: whoever is on the network needs nobody at the robot then."""


def shows_window(config: PlayConfig) -> bool:
    """Tell whether a run with these options opens a window, in its own process: on hardware only if asked for.

    Drawing takes a share of the computer that the loop runs on.
    """
    return config.viewer == "native" or (config.viewer == "auto" and config.hardware is None and has_display())


def wanted_front_ends(config: PlayConfig) -> tuple[Wanted, ...]:
    """Return the front ends that a run starts.

    Raises `InputError` if the packages of one are not installed, or the network interface of one is not there.
    """
    layout, interface = _pad_layout(config), config.dds_interface
    if interface is not None:
        check_network_interface("--dds-interface", interface)
    across = ("--interface", interface or "", *(("--safety",) if config.dds_safety else ()))
    known = (
        (config.remote == "gravity", Wanted("gravity", ("--form", config.gravity_form))),
        (config.console, Wanted("console")),
        (config.gamepad is not None, Wanted("gamepad", layout)),
        (config.dds or interface is not None, Wanted("dds", restarts=_BRIDGE_RESTARTS)),
        (interface is not None, Wanted("dds", across, f"dds {interface}", _BRIDGE_RESTARTS)),
        (config.midi is not None, Wanted("midi", _keyboard_options(config))),
        (shows_window(config), Wanted("viewer")),
        (config.viewer == "rerun", Wanted("rerun")),
    )
    wanted = [front_end for is_wanted, front_end in known if is_wanted]
    for front_end in wanted:
        if front_end.options[:1] != ("--device",):  # bytes need no library
            require_packages(front_end.name)
    if needs_gamepad(config) and config.gamepad is None:
        wanted.append(Wanted("gamepad", layout))
    return tuple(wanted)


def _keyboard_options(config: PlayConfig) -> tuple[str, ...]:
    """Return the MIDI front end's options, for a part of its port's name or a device's path."""
    named = config.midi or ()
    if len(named) > 1:
        raise InputError(f"--midi: is {' '.join(named)}, expected one port or device")
    return ("--device" if "/" in named[0] else "--port", named[0]) if named else ()


def needs_gamepad(config: PlayConfig) -> bool:
    """Return whether a gamepad takes part: where one was asked for, and on a real bus unless it was declined."""
    return config.gamepad is not None or (_is_real_bus(config) and not config.no_gamepad and not config.dry_run)


def operated_by(config: PlayConfig) -> tuple[str, ...]:
    """Return the options of the front ends from which an operator drives the FSM."""
    wanted = (("--console", config.console), ("--gamepad", needs_gamepad(config)))
    return tuple(option for option, is_wanted in wanted if is_wanted)


def has_keys(config: PlayConfig) -> bool:
    """Return whether an operator drives from the keyboard: with --manual, where standard input is a terminal."""
    return config.manual and bool(sys.stdin and sys.stdin.isatty())


_EMULATED = ("virtual:", "udp_multicast:")
"""Buses on which no real motor is."""


def _is_real_bus(config: PlayConfig) -> bool:
    return config.hardware is not None and not config.hardware.startswith(_EMULATED)


def _pad_layout(config: PlayConfig) -> tuple[str, ...]:
    """Return the options of the gamepad's program that say where the buttons are."""
    files = config.gamepad or ()
    if len(files) > 1:
        raise InputError(f"--gamepad: is {' '.join(files)}, expected one file (.yaml)")
    layout = chosen_layout(Path(files[0]) if files else None, PadLayout(config.joy), "--gamepad").options()
    if layout and not needs_gamepad(config):
        raise InputError(f"{layout[0]}: means nothing without --gamepad")
    return layout


def look_for_gamepad(config: PlayConfig) -> tuple[str, ...]:
    """Return what an operator should know of the gamepads that are plugged in, before anything moves.

    The library that looks for them stays out of this process. Raises `InputError` if on a real bus: none is plugged in
    that can be used, or its package is not installed.
    """
    if not needs_gamepad(config) or config.dry_run:
        return ()
    require_packages("gamepad")
    program = [sys.executable, "-m", "humanoid_sim.gamepad", "--list", *_pad_layout(config)]
    try:
        found = subprocess.run(program, check=False, capture_output=True, text=True, timeout=_LOOK_WITHIN)
    except (OSError, subprocess.SubprocessError) as error:
        if not _is_real_bus(config):
            return (f"could not check for a gamepad: {error}",)
        raise InputError(f"--hardware: could not check for a gamepad: {error}; --no-gamepad does without") from None
    lines = (found.stdout if found.returncode in (0, 1) else found.stderr).strip().splitlines()
    if found.returncode and _is_real_bus(config):
        why = lines[-1] if lines else f"status {found.returncode}"
        raise InputError(f"--hardware: {why}; plug one in to damp the robot by, or say --no-gamepad")
    return tuple(f"gamepad: {line}" for line in lines)


def operator_notices(
    config: PlayConfig, steps: Sequence[ScriptStep] | None, contract: PolicyContract | None, taken: Iterable[str]
) -> tuple[str, ...]:
    """Say who drives the robot, and what has to come from programs that this run does not start, one line each.

    `steps` are those of a script that drives, `taken` the names of the live inputs that come from other programs.
    """
    notices = []
    if has_keys(config):
        notices.append(key_help())
        if contract is not None and contract.takes_velocity_command:
            notices.append(velocity_key_help())
    elif config.manual and not config.dry_run:
        notices.append(f"no terminal to read keys from: waits for an operator at {' or '.join(operated_by(config))}")
    elif steps is None and not config.dry_run:
        modes = "damp, load_a, start_locomotion"
        notices.append(f"waits for an operator in another terminal: python -m humanoid_sim.mode {modes}")
    if config.remote == "none" and any(step.intent is Intent.START_REMOTE for step in steps or ()):
        notices.append("nothing that this run starts sends commands for REMOTE: it damps until a producer attaches")
    topics = {name: live_topic(contract, name) for name in taken if name != KEY_PRESSED}
    names = ", ".join(f"{name} ({topic.name})" for name, topic in topics.items() if topic is not None)
    if names:
        notices.append(f"the policy observes {names}, which a program has to send: docs/front-ends.md says how")
    if KEY_PRESSED in taken and config.midi is None:
        notices.append("which keys are down has to come from a program: --midi takes it from a MIDI keyboard")
    return tuple(notices)


def is_realtime(config: PlayConfig, front_ends: Sequence[Wanted]) -> bool:
    """Return whether somebody, or a thread or a bus that lives in real time, takes part."""
    if config.hardware is None and config.pace != "auto":
        return config.pace == "realtime"
    return config.hardware is not None or config.manual or bool(front_ends)


_OPEN_END = 10.0
"""s that a policy without a motion runs when nothing else ends the run."""


def automatic_steps(config: PlayConfig, motion: Motion | None) -> tuple[ScriptStep, ...]:
    """Return the script that plays when nobody drives: long enough in each mode to see it."""
    start, run = "", f"hold {config.duration or _OPEN_END}"
    if config.remote != "none":
        start = "start_remote; "
    else:
        start = "start_locomotion; " if config.has_policy else ""
        if config.policy_seconds is not None:
            run = f"hold {config.policy_seconds}"
        elif motion is not None:
            run = "motion; hold 0.5"
    return parse_script(f"hold 0.5; damp; hold 1; load_{config.pose}; wait; hold 0.2; {start}{run}; damp; hold 1")


def expected_duration(
    config: PlayConfig, steps: Sequence[ScriptStep] | None, motion: Motion | None, description: RobotDescription
) -> float | None:
    """About how long the run takes, s on the robot's clock; None if only its driver knows."""
    if config.duration is not None or steps is None or config.script is not None:
        return config.duration
    standby = description.standby_controller_a if config.pose == "a" else description.standby_controller_b
    lasts = {"wait": sum(standby.segment_durations), "motion": 0.0 if motion is None else motion.duration}
    return sum(step.seconds + lasts.get(step.kind, 0.0) for step in steps)
