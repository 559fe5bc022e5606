"""`policy doctor`: load, search, tell."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace

from rich.console import Console
from rich.progress import TimeElapsedColumn

from humanoid_sim.cli import ExitStatus
from humanoid_sim.command_line.progress import BarOrLines
from humanoid_sim.doctor import DoctorConfig
from humanoid_sim.doctor.examined_policy import ExaminedPolicy, load_examined, robot_facts
from humanoid_sim.doctor.overrides import pasting_for
from humanoid_sim.doctor.ranking import Ranking
from humanoid_sim.doctor.report import Examination
from humanoid_sim.doctor.search import Plan, make_plan, search
from humanoid_sim.errors import InputError
from humanoid_sim.policy.readers.contract_yaml import find_contract
from humanoid_sim.policy_tools.show import make_console
from humanoid_sim.robots.description import load_robot, with_imu
from humanoid_sim.session.sources import parse_velocity


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
    start = time.perf_counter()
    _check(config)
    robot = with_imu(load_robot(config.robot), config.imu_site)
    examined = load_examined(config.checkpoint, robot, config.contract, config.motion)
    examined = replace(examined, base_height=config.base_height, actuation=config.actuation)
    for name, width in examined.contract.live_inputs.items():
        raise InputError(f"{config.checkpoint}: needs the live input '{name}' of width {width}, and doctor has none")
    plan = make_plan(
        examined.contract,
        seconds=config.seconds,
        command=_command(config, examined),
        motion_seconds=examined.motion_seconds,
        pairs=config.pairs,
        budget=max(config.budget - (time.perf_counter() - start), 1.0),  # loading counts
    )
    pasting = pasting_for(config.checkpoint, config.contract or find_contract(config.checkpoint))
    ranking = Ranking(contradicts=examined.contradicts)
    interrupted = False
    with SearchProgress(console, ranking, plan) as progress:
        try:
            search(examined, robot_facts(examined.description, examined.motion), plan, ranking, progress)
        except KeyboardInterrupt:
            interrupted = True
    return Examination(ranking, examined.contract, pasting, interrupted, examined.problem)


class SearchProgress(BarOrLines):
    """A context that the search calls with every trial."""

    def __init__(self, console: Console, ranking: Ranking, plan: Plan) -> None:
        super().__init__(console, "single changes", None, TimeElapsedColumn())
        self._ranking, self._plan = ranking, plan
        self._has_begun = False

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Take in that so many of a stage's changes have been tried."""
        elapsed = self._ranking.seconds
        if not self._has_begun:
            self._has_begun = True
            limit = "" if self._plan.budget is None else f"; the search ends after {self._plan.budget:.0f} s (--budget)"
            self.say(0.0, f"single changes: {total}{limit}", "dim")
        self.update(self._task, description=stage, completed=done, total=total)
        if not self.console.is_terminal and (done == total or self.is_due(elapsed)):
            tried = f"{total}" if done == total else f"{done} of {total}"
            self.say(elapsed, f"{stage}: {tried} tried, {elapsed:.0f} s so far", "dim")


def _check(config: DoctorConfig) -> None:
    for option, seconds in (("--seconds", config.seconds), ("--budget", config.budget)):
        if not (math.isfinite(seconds) and seconds > 0.0):
            raise InputError(f"{option}: is {seconds}, expected a finite number > 0")
    for option, value, least in (("--pairs", config.pairs, 0), ("--top", config.top, 1)):
        if value < least:
            raise InputError(f"{option}: is {value}, expected a whole number >= {least}")


def _command(config: DoctorConfig, examined: ExaminedPolicy) -> tuple[float, float, float] | None:
    if config.command is None:
        return None
    if examined.contract.task_type != "locomotion":
        raise InputError(f"--command: is '{config.command}', but {config.checkpoint} follows a motion")
    vx, vy, wz = parse_velocity(config.command, examined.contract.command_ranges)
    return float(vx), float(vy), float(wz)
