"""`policy doctor`: load, try every change, tell."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.progress import Progress

from humanoid_sim.cli import ExitStatus
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor import DoctorConfig
from humanoid_sim.doctor.examined_policy import ExaminedPolicy, load_examined, robot_facts
from humanoid_sim.doctor.hypotheses import Hypothesis, singles
from humanoid_sim.doctor.overrides import pasting_for
from humanoid_sim.doctor.ranking import Ranking, Verdict
from humanoid_sim.doctor.report import Examination
from humanoid_sim.doctor.trials import Trial, TrialRunner
from humanoid_sim.errors import InputError
from humanoid_sim.policy.readers.contract_yaml import find_contract
from humanoid_sim.policy_tools.show import make_console
from humanoid_sim.robots.description import load_robot, with_imu
from humanoid_sim.session.sources import parse_velocity

_COMMAND = (0.5, 0.0, 0.5)
"""Velocity that every walking policy should know, m/s and rad/s."""


def doctor(config: DoctorConfig) -> int:
    """Search and print. Raises `InputError` as `examine`.

    Returns 0 if the contract as it is does best and keeps the robot up, 1 if not, 130 after Ctrl-C.
    """
    found = examine(config, Console(stderr=True))
    if config.json:
        print(json.dumps(found.document(), indent=2))
    else:
        found.print(make_console(), config.top)
    return ExitStatus.INTERRUPTED if found.is_interrupted else ExitStatus.of(found.ranking.is_healthy)


def examine(config: DoctorConfig, console: Console) -> Examination:
    """Search, and show on a console how far it is.

    Raises `InputError` if an option, the checkpoint or the motion is not accepted.
    """
    _check(config)
    robot = with_imu(load_robot(config.robot), config.imu_site)
    examined = load_examined(config.checkpoint, robot, config.contract, config.motion)
    examined = replace(examined, base_height=config.base_height, actuation=config.actuation)
    for name, width in examined.contract.live_inputs.items():
        raise InputError(f"{config.checkpoint}: needs the live input '{name}' of width {width}, and doctor has none")
    trial = make_trial(examined, config.seconds, _command(config, examined))
    pasting = pasting_for(config.checkpoint, config.contract or find_contract(config.checkpoint))
    ranking = Ranking(contradicts=examined.contradicts)
    interrupted = False
    with Progress(console=console, transient=True) as bar:
        task = bar.add_task("changes", total=None)
        try:
            search(examined, trial, ranking, lambda done, total: bar.update(task, completed=done, total=total))
        except KeyboardInterrupt:
            interrupted = True
    return Examination(ranking, examined.contract, pasting, interrupted, examined.problem)


def make_trial(examined: ExaminedPolicy, seconds: float, command: tuple[float, float, float] | None = None) -> Trial:
    """Return the one trial of all changes: of a motion at most all of it, or a walk at a velocity command."""
    contract = examined.contract
    if contract.task_type != "locomotion":
        return Trial(max(min(seconds, examined.motion_seconds), contract.policy_dt))
    return Trial(seconds, command or _within(_COMMAND, contract))


def _within(command: tuple[float, float, float], contract: PolicyContract) -> tuple[float, float, float]:
    """Return the nearest command that the policy knows."""
    if contract.command_ranges is None:
        return command
    vx, vy, wz = np.clip(command, contract.command_ranges[:, 0], contract.command_ranges[:, 1])
    return float(vx), float(vy), float(wz)


def search(examined: ExaminedPolicy, trial: Trial, ranking: Ranking, progress: Callable[[int, int], None]) -> None:
    """Try every single edit once, and the contract as it is; `ranking` holds what is known when this is interrupted."""
    start = time.perf_counter()
    runner, contract = TrialRunner(examined), examined.contract
    changed = singles(contract, robot_facts(examined.description, examined.motion))
    ranking.known = len(changed)
    # One after the other: most of a trial is Python's, so threads would only wait for each other.
    for hypothesis in (Hypothesis(None, contract), *changed):
        ranking.add(Verdict(hypothesis, runner.run(hypothesis.contract, trial)))
        ranking.seconds = time.perf_counter() - start
        progress(ranking.tried, ranking.known)


def _check(config: DoctorConfig) -> None:
    if not (math.isfinite(config.seconds) and config.seconds > 0.0):
        raise InputError(f"--seconds: is {config.seconds}, expected a finite number > 0")
    if config.top < 1:
        raise InputError(f"--top: is {config.top}, expected a whole number >= 1")


def _command(config: DoctorConfig, examined: ExaminedPolicy) -> tuple[float, float, float] | None:
    if config.command is None:
        return None
    if examined.contract.task_type != "locomotion":
        raise InputError(f"--command: is '{config.command}', but {config.checkpoint} follows a motion")
    vx, vy, wz = parse_velocity(config.command, examined.contract.command_ranges)
    return float(vx), float(vy), float(wz)
