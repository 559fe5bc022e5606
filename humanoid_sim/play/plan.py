"""Plan of a run: choose and validate everything, without side effects."""

from __future__ import annotations

import math
import os
import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from humanoid_sim.controllers.rl_policy import ticks_per_step
from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file, output_file
from humanoid_sim.mit import EXTERN_WIDTHS, VELOCITY_COMMAND
from humanoid_sim.play.front_ends import (
    automatic_steps,
    has_keys,
    is_realtime,
    look_for_gamepad,
    operator_notices,
    shows_window,
    wanted_front_ends,
)
from humanoid_sim.play.options import NO_POLICY, PlayConfig
from humanoid_sim.play.played_robot import RobotSetup, simulated_robot
from humanoid_sim.play.policies import choose_for_robot, policy_notices
from humanoid_sim.rendering.pictures import has_display, require_pictures
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.guards import describe_unwatched
from humanoid_sim.robots.rates import steps_per_period
from humanoid_sim.session.outside_safety import parse_watchdogs
from humanoid_sim.session.script import parse_script
from humanoid_sim.session.sources import VelocityCommand, parse_velocity
from humanoid_sim.stack import build_supervisor

if TYPE_CHECKING:
    from humanoid_sim.session.session import Session

_RUNS = Path("runs")


def refuse(config: PlayConfig) -> None:
    """Refuse what would endanger a robot, contradicts itself, or is out of range."""
    is_operated = has_keys(config) or config.console or config.needs_gamepad
    problems = (
        (
            config.hardware is not None and config.script is not None and not config.allow_script,
            "--script: would move a real robot with nobody at the keys; add --allow-script if it may",
        ),
        (
            config.manual and config.script is not None,
            "--manual and --script: both drive the FSM, expected at most one of them",
        ),
        (
            config.manual and not is_operated,
            "--manual: standard input is not a terminal, expected one to read keys from, or --console or --gamepad",
        ),
        (
            len(config.policy) > 1 and NO_POLICY in config.policy,
            "--policy: none is given beside others, expected it alone",
        ),
        (
            len(config.policy) > 1 and config.contract is not None,
            "--contract: is given for several policies, expected a x.contract.yaml beside each x.onnx",
        ),
        (
            config.motion is not None and config.song is not None,
            "--motion and --song: both are given, expected one of them",
        ),
        (
            config.viewer == "native" and not has_display(),
            "--viewer native: there is no display here; --html out.html shows the run in a browser",
        ),
        (
            config.duration is not None and not 0.0 < config.duration < math.inf,
            f"--duration: is {config.duration}, expected a finite number > 0",
        ),
    )
    for is_wrong, text in problems:
        if is_wrong:
            raise InputError(text)


@dataclass(frozen=True, slots=True)
class Outputs:
    """The files that a run leaves; None for those that it does not."""

    record: Path | None = None
    html: Path | None = None
    video: Path | None = None
    summary: Path | None = None


_SUFFIXES = {"record": ".mcap", "html": ".html", "video": ".mp4", "summary": ".json"}


def choose_outputs(config: PlayConfig, motion: Path | None) -> Outputs:
    """Resolve `auto` and `none`; refuse to replace files that the user named, and those that the run reads."""
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
                named[name] = _free_path(named.get("record", _RUNS / stem).with_suffix(suffix))
        elif value not in ("none", None):
            path = named[name] = Path(value)
            output_file(path, option, suffix, overwrite=config.overwrite)
            if any(path.exists() and source.exists() and path.samefile(source) for source in inputs):
                raise InputError(f"{option}: '{path}' is what this run reads; choose another name")
    if "video" in named:
        require_pictures("--video")
    if any(path.parent == _RUNS for path in named.values()):
        try:
            _RUNS.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(
                f"folder '{_RUNS}' for recordings cannot be made: {error.strerror}; use --record and --html"
            ) from None
    return Outputs(**named)


def _free_path(path: Path) -> Path:
    """Return the path, or the first numbered one beside it that does not exist."""
    candidate, number = path, 1
    while candidate.exists():
        number += 1
        candidate = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return candidate


class Plan:
    """A run that can be made."""

    session: Session | None = None
    """The session that is made of it; None before there is one."""

    def __init__(self, config: PlayConfig, left: ExitStack) -> None:
        """Choose and check. `left` closes emulated motors, which run from here on if the options ask for them."""
        self.steps = None if config.script is None else parse_script(config.script)
        """Steps that drive the FSM if no operator does; None: only operators do."""
        refuse(config)
        self.watchdogs = parse_watchdogs(config.watchdog)
        front_ends = wanted_front_ends(config)
        self.config = config
        self.realtime = is_realtime(config, front_ends)
        self.policy, self.description = choose_for_robot(config, load_robot(config.robot))
        description, policy = self.description, self.policy
        contract = policy.contract
        self.control_period, moved = control_rate(config, description, None if contract is None else contract.policy_dt)
        self.setup = setup = self._robot(left)
        self.external = policy.external_inputs(setup.live)
        """Name and width of the live inputs that come from other programs."""
        walking = (one for one in policy.contracts if one.takes_velocity_command)
        ranges = next((one.command_ranges for one in walking), None)
        self.velocity = VelocityCommand(parse_velocity(config.command, ranges), ranges, is_observed=policy.walks)
        self.supervisor = build_supervisor(
            description,
            self.control_period,
            policy.loaded,
            policies=policy.named,
            remote=True,
            live={**self.external, **setup.live, VELOCITY_COMMAND: EXTERN_WIDTHS[VELOCITY_COMMAND]},
        )
        warnings = [line for one in policy.contracts for line in setup.check_policy(one)]
        pads = look_for_gamepad(config)
        if self.steps is None and not config.manual and config.hardware is None:
            self.steps = automatic_steps(config, policy)
        notices = (
            moved,
            *setup.notices,
            describe_unwatched(description),
            *warnings,
            *(line for one in policy.choices for line in policy_notices(one)),
            *pads,
            *operator_notices(config, self.steps, policy, tuple(self.external)),
        )
        self.notices = [text for text in notices if text]
        """For an operator, one line each."""
        self.outputs = Outputs() if config.dry_run else choose_outputs(config, policy.motion_file)
        self.front_ends = () if config.dry_run else front_ends

    def clock(self) -> float:
        """Return the robot's time as of the latest reading, s; 0 before there is one."""
        return self.session.time if self.session is not None else 0.0

    def expected_duration(self) -> float | None:
        """Return about how long the run takes, s on the robot's clock; None if only its driver knows."""
        if self.config.duration is not None or self.steps is None or self.config.script is not None:
            return self.config.duration
        motion = self.policy.motion
        standby = sum(self.description.standby_controller_a.segment_durations)
        lasts = {"wait": standby, "motion": 0.0 if motion is None else motion.duration}
        return sum(step.seconds + lasts.get(step.kind, 0.0) for step in self.steps)

    def _robot(self, left: ExitStack) -> RobotSetup:
        if self.config.hardware is None:
            return simulated_robot(self.description, self.control_period, self.policy.contracts)
        # python-can and pyserial only where they are used
        from humanoid_sim.play.hardware_robot import real_robot  # noqa: PLC0415

        return real_robot(self.config, self.description, self.control_period, left, self.policy.contracts)


def control_rate(config: PlayConfig, description: RobotDescription, policy_dt: float | None) -> tuple[float, str]:
    """Return the control period in s, and what to tell the user if it is not the robot's own, or ''.

    Where the policy's period is not a multiple of the control period, the control rate moves to the nearest that is. On
    hardware there is no physics step to divide it. Raises `InputError` if the physics step does not divide the period.
    """
    settings = description.simulation if config.hardware is None else description.hardware
    frequency = settings.control_frequency
    period, notice = 1.0 / frequency, ""
    if policy_dt is not None:
        ticks, is_whole = ticks_per_step(policy_dt, period)
        if not is_whole:
            period = policy_dt / ticks
            notice = (
                f"the control rate moves from {frequency:g} Hz to {1.0 / period:g} Hz, "
                f"{ticks} times the policy's {1.0 / policy_dt:g} Hz"
            )
    if config.hardware is None:
        steps_per_period(period, description.simulation.physics_timestep)
    return period, notice
