"""`policy doctor`: load, search, tell."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass
from typing import Any

from rich.console import Console

from humanoid_sim.cli import ExitStatus
from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.doctor import DoctorConfig
from humanoid_sim.doctor.examined_policy import ExaminedPolicy, load_examined, robot_facts
from humanoid_sim.doctor.overrides import Pasting, pasting_for
from humanoid_sim.doctor.progress import SearchProgress
from humanoid_sim.doctor.ranking import Ranking
from humanoid_sim.doctor.report import print_ranking, ranking_document
from humanoid_sim.doctor.search import make_plan, search
from humanoid_sim.errors import InputError
from humanoid_sim.policy.readers.contract_yaml import find_contract
from humanoid_sim.policy_tools.show import make_console
from humanoid_sim.robots.description import load_robot, with_imu
from humanoid_sim.session.sources import parse_velocity


@dataclass(frozen=True)
class Examination:
    """Outcome of a search."""

    ranking: Ranking
    contract: PolicyContract
    pasting: Pasting
    """Place where a change is to be written."""
    is_interrupted: bool
    """Ctrl-C ended it."""

    def document(self) -> dict[str, Any]:
        """Return the whole ranking, for JSON."""
        return ranking_document(self.ranking, self.contract, self.pasting)

    def print(self, console: Console, top: int) -> None:
        """Print the first rows of the ranking, the conclusion, and what to change."""
        print_ranking(console, self.ranking, self.contract, top, self.pasting)


def doctor(config: DoctorConfig) -> int:
    """Search and print.

    Returns:
        0 if the contract as it is does best and keeps the robot up, 1 if not, 130 after Ctrl-C.

    Raises:
        InputError: as `examine`.
    """
    found = examine(config, Console(stderr=True))
    if config.json:
        print(json.dumps(found.document(), indent=2))
    else:
        found.print(make_console(), config.top)
    return ExitStatus.INTERRUPTED if found.is_interrupted else ExitStatus.of(found.ranking.is_healthy)


def examine(config: DoctorConfig, console: Console) -> Examination:
    """Search, and show on a console how far it is.

    Raises:
        InputError: an option, the checkpoint or the motion is not accepted.
    """
    start = time.perf_counter()
    _check(config)
    examined = load_examined(
        config.checkpoint,
        with_imu(load_robot(config.robot), config.imu_site),
        config.contract,
        config.motion,
        base_height=config.base_height,
        actuation=config.actuation,
    )
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
    return Examination(ranking, examined.contract, pasting, interrupted)


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
