"""Plan of a run: choose and validate everything, without side effects."""

from __future__ import annotations

import math
import os
import time
from contextlib import ExitStack
from pathlib import Path

from humanoid_sim.controllers.rl_policy import ticks_per_step
from humanoid_sim.errors import InputError, blaming
from humanoid_sim.files import output_file
from humanoid_sim.mit import EXTERN_WIDTHS, VELOCITY_COMMAND
from humanoid_sim.play.front_ends import (
    automatic_steps,
    is_realtime,
    look_for_gamepad,
    operator_notices,
    shows_window,
    wanted_front_ends,
)
from humanoid_sim.play.options import NO_POLICY, PlayConfig
from humanoid_sim.play.played_robot import RobotSetup, SimulatedSetup
from humanoid_sim.play.policies import choose_policies
from humanoid_sim.rendering.pictures import has_display, require_pictures
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.guards import describe_unwatched
from humanoid_sim.robots.schema import steps_per_period
from humanoid_sim.session.outside_safety import parse_watchdogs
from humanoid_sim.session.script import parse_script
from humanoid_sim.session.sources import VelocityCommand, parse_velocity
from humanoid_sim.stack import build_supervisor

_RUNS = Path("runs")
_SUFFIXES = {"record": ".mcap", "html": ".html", "video": ".mp4", "summary": ".json"}


class Plan:
    """A run that can be made."""

    def __init__(self, config: PlayConfig, left: ExitStack) -> None:
        """Choose and check. `left` closes emulated motors, which run from here on if the options ask for them."""
        self.config = config
        self.steps = None if config.script is None else parse_script(config.script)
        """Steps that drive the FSM if no operator does; None: only operators do."""
        refuse(config)
        self.watchdogs = parse_watchdogs(config.watchdog)
        front_ends = wanted_front_ends(config)
        self.realtime = is_realtime(config, front_ends)
        self.policies, self.description = choose_policies(config, load_robot(config.robot))
        description, contracts = self.description, self.policies.contracts
        self.control_period, moved = control_rate(config, description, contracts[0].policy_dt if contracts else None)
        self.setup: RobotSetup
        if config.hardware is None:
            self.setup = SimulatedSetup(description, self.control_period, contracts)
        else:
            from humanoid_sim.play.hardware_robot import HardwareSetup  # noqa: PLC0415 - python-can only where it is used

            self.setup = HardwareSetup(config, description, self.control_period, left, contracts)
        self.external = self.policies.external_inputs(self.setup.live)
        """Name and width of the live inputs that come from other programs."""
        ranges = next((one.command_ranges for one in contracts if one.takes_velocity_command), None)
        command = parse_velocity(config.command, ranges)
        if command.any() and not self.policies.walks:
            raise InputError(f"--command: is '{config.command}', but no policy of this run takes a velocity")
        self.velocity = VelocityCommand(command, ranges) if self.policies.walks else None
        self.supervisor = build_supervisor(
            description,
            self.control_period,
            self.policies.loaded,
            remote=True,
            live={**self.external, **self.setup.live, VELOCITY_COMMAND: EXTERN_WIDTHS[VELOCITY_COMMAND]},
        )
        warnings = [line for one in contracts for line in self.setup.check_policy(one)]
        pads = look_for_gamepad(config)
        if self.steps is None and not config.manual and config.hardware is None:
            self.steps = automatic_steps(config, self.policies)
        notices = (
            moved,
            *self.setup.notices,
            describe_unwatched(description),
            *warnings,
            *(line for one in self.policies.choices for line in one.notices),
            *pads,
            *operator_notices(config, self.steps, self.policies, tuple(self.external)),
        )
        self.notices = [text for text in notices if text]
        """For an operator, one line each."""
        self.outputs = {} if config.dry_run else choose_outputs(config)
        self.front_ends = () if config.dry_run else front_ends


def refuse(config: PlayConfig) -> None:
    """Refuse what would endanger a robot, contradicts itself, or is out of range."""
    if config.hardware is not None and config.script is not None and not config.allow_script:
        raise InputError("--script: would move a real robot with nobody at the keys; add --allow-script if it may")
    if config.manual and config.script is not None:
        raise InputError("--manual and --script: both drive the FSM, expected at most one of them")
    if config.manual and not (config.has_keys or config.console or config.needs_gamepad):
        raise InputError(
            "--manual: standard input is not a terminal, expected one to read keys from, or --console or --gamepad"
        )
    if len(config.policy) > 1 and (NO_POLICY in config.policy or config.contract is not None):
        raise InputError("--policy: several are given, expected none of them to be 'none', and no --contract")
    if config.viewer == "native" and not has_display():
        raise InputError("--viewer native: there is no display here; --html out.html shows the run in a browser")
    if config.duration is not None and not 0.0 < config.duration < math.inf:
        raise InputError(f"--duration: is {config.duration}, expected a finite number > 0")


def choose_outputs(config: PlayConfig) -> dict[str, Path]:
    """Return the files that a run leaves, by the option that names each; refuse to replace files that exist."""
    given = {name: getattr(config, name) for name in _SUFFIXES}
    paths = {name: Path(value) for name, value in given.items() if value not in (None, "none", "auto")}
    automatic: dict[str, Path] = {}
    stem = _RUNS / f"{time.strftime('play-%Y%m%d-%H%M%S')}-{os.getpid()}"  # two runs may start in one second
    if config.record == "auto":
        automatic["record"] = stem.with_suffix(".mcap")
    is_watched = config.viewer != "auto" or shows_window(config) or config.console
    if config.html == "auto" and config.hardware is None and not is_watched:
        beside = paths if "record" in paths else automatic
        beside["html"] = paths.get("record", stem).with_suffix(".html")
    for name, path in paths.items():
        output_file(path, f"--{name}", _SUFFIXES[name], overwrite=config.overwrite)
    if "video" in paths:
        require_pictures("--video")
    if automatic:
        with blaming(f"folder '{_RUNS}' for recordings cannot be made", OSError):
            _RUNS.mkdir(exist_ok=True)
    return {**paths, **automatic}


def control_rate(config: PlayConfig, description: RobotDescription, policy_dt: float | None) -> tuple[float, str]:
    """Return the control period in s, and what to tell the user if it is not the robot's own, or ''.

    Where the policy's period is not a multiple of the control period, the control rate moves to the nearest that is.
    Raises `InputError` if the physics step does not divide the period.
    """
    settings = description.simulation if config.hardware is None else description.hardware
    frequency = settings.control_frequency
    period, notice = 1.0 / frequency, ""
    if policy_dt is not None:
        ticks, is_whole = ticks_per_step(policy_dt, period)
        if not is_whole:
            period = policy_dt / ticks
            notice = f"the control rate moves from {frequency:g} Hz to {1.0 / period:g} Hz, a multiple of the policy's"
    if config.hardware is None:
        steps_per_period(period, description.simulation.physics_timestep)
    return period, notice
