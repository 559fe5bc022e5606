"""The only place where the tests of what must survive about motors touch names of the product.

A rewrite of `hardware/` changes this file and no test.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import can
import numpy as np

from humanoid_sim.cli import run_program
from humanoid_sim.hardware import can_bus
from humanoid_sim.hardware import robot as robot_module
from humanoid_sim.hardware.calibration import load_calibration
from humanoid_sim.hardware.can_bus import BusAddress, open_bus
from humanoid_sim.hardware.robot import HardwareRobot
from humanoid_sim.hardware.robstride import link, motors
from humanoid_sim.hardware.tools import identify as identify_tool
from humanoid_sim.hardware.tools import main as hardware_main
from humanoid_sim.messages import Intent, SafetyStatus, TickInput, TickOutput
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.play import main as play_main
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.policies import choose_policies
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.stack import build_supervisor


def make_robot(
    document: Mapping[str, Any],
    channels: Sequence[str],
    calibration: Path,
    clock: Callable[[], float],
    *,
    can_timeout: float = 0.1,
    allow_no_timeout: bool = False,
) -> HardwareRobot:
    """Return the robot of a robot file's document and a calibration file; nothing is opened yet."""
    description = RobotDescription.from_json(json.dumps(document))
    test_clock = _TestClock(clock)
    return HardwareRobot(
        description,
        channels,
        calibration=load_calibration(calibration, description).homing_offsets(description),
        clock=test_clock,
        open_bus=test_clock.open_bus,
        can_timeout=can_timeout,
        allow_no_timeout=allow_no_timeout,
    )


class _TestClock:
    """A clock that a test moves. A frame that was under way when it moved is as old as the move, as on a real bus."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._moves = clock, [(0.0, clock())]  # system's time of each move, and the time that it led to

    def __call__(self) -> float:
        now = self._clock()
        if now != self._moves[-1][1]:
            self._moves.append((time.time(), now))
        return now

    def open_bus(self, address: BusAddress) -> can.BusABC:
        bus = open_bus(address)
        receive = bus.recv

        def recv(timeout: float | None = None) -> can.Message | None:
            message = receive(timeout)
            if message is not None:
                sent = [now for moved, now in list(self._moves) if moved <= message.timestamp]
                message.timestamp = time.time() - (self() - sent[-1])
            return message

        bus.recv = recv  # type: ignore[method-assign]
        return bus


def bring_up_lines(robot: HardwareRobot) -> list[str]:
    """Return what the latest activation found, for an operator to read."""
    return [str(check) for check in robot.checks.all]


class Loop:
    """The pure `step` with the memory that it goes on with."""

    def __init__(self, document: Mapping[str, Any]) -> None:
        description = RobotDescription.from_json(json.dumps(document))
        supervisor = build_supervisor(description, 1.0 / description.hardware.control_frequency, None)
        self._step, self._memory = supervisor.step, supervisor.initial()

    def step(self, state: MITState, safety: tuple[SafetyStatus, ...], *intents: Intent) -> TickOutput:
        self._memory, output = self._step(self._memory, TickInput(state, safety, intents))
        return output


def mit_command(position: Sequence[float], stiffness: float, damping: float) -> MITCommand:
    """Return a command that holds `position` (n,), rad, joint frame."""
    n = len(position)
    return MITCommand(np.array(position), np.zeros(n), np.zeros(n), np.full(n, stiffness), np.full(n, damping))


def identify(channel: str, joint: str, robot: str, angle: float) -> int:
    """Run `python -m humanoid_sim.hardware identify` in this process, with nobody to be asked; its exit status."""
    return run_program(hardware_main, ("identify", channel, joint, "--robot", robot, "--angle", str(angle), "--yes"))


def run_play(*words: str) -> int:
    """Run `python -m humanoid_sim.play WORDS` in this process, without viewer and recording; its exit status."""
    return run_program(play_main, (*words, "--viewer", "none", "--record", "none"))


def policy_of_play(checkpoint: Path, robot: str, can_timeout: float) -> Callable[..., Any]:
    """Return what `play --hardware … --can-timeout …` calls in a tick: (observation, frame) to action."""
    config = PlayConfig(policy=(str(checkpoint),), hardware="virtual:survive-policy", can_timeout=can_timeout)
    policies, _ = choose_policies(config, load_robot(robot))
    return policies.choices[0].loaded.policy


def short_waits(monkeypatch: Any, *, answers: float, listening: float) -> None:
    """Shorten the product's waits: a virtual bus needs no milliseconds, and these motors answer at once.

    Args:
        answers: s that a motor has to answer, each of three times that it is asked.
        listening: s in which another master, or a second motor with an id, would be noticed.
    """
    monkeypatch.setattr(motors, "_LISTENING", listening)
    monkeypatch.setattr(motors, "_QUIET", 2.0 * listening)
    monkeypatch.setattr(link, "_ANSWER_TIMES", (answers,) * 3)
    monkeypatch.setattr(motors, "_LONGEST", 3.0 * answers)
    monkeypatch.setattr(can_bus, "_POLL", 0.005)
    monkeypatch.setattr(robot_module, "_LONGEST", 0.05)  # s for which closing damps at most
    monkeypatch.setattr(identify_tool, "_RAMP", 0.06)
    monkeypatch.setattr(identify_tool, "_HOLD", 0.02)
    monkeypatch.setattr(identify_tool, "CAN_TIMEOUT", 2.0)  # these motors have no clock, a test machine may stall
