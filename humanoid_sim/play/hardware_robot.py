"""The real robot of a run: motors on CAN channels, or mock motors in this process that speak the same protocol."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError, RobotError
from humanoid_sim.hardware.calibration import load_calibration
from humanoid_sim.hardware.can_bus import parse_addresses
from humanoid_sim.hardware.imu import SimulatedImu, make_imu
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.robot import HardwareRobot
from humanoid_sim.hardware.robstride.firmware import parse_version
from humanoid_sim.mit import ANCHOR_ORIENTATION, KEY_PRESSED, FloatArray, MITState
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.played_robot import RobotSetup, shared
from humanoid_sim.policy.checks import motor_findings, suspicious_findings
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.session.realtime import punctual_threads
from humanoid_sim.simulation.kinematics import AnchorOrientation

CALIBRATION = "calibration.yaml"
"""File of a robot's calibration, unless an option names another."""
_STYLES = {"ok": "green", "warning": "yellow", "question": "bold yellow", "problem": "bold red"}


class HardwareSetup(RobotSetup):
    """A robot on the channels of `--hardware`, which measures what the policies of contracts observe.

    On channels of the interface `virtual`, which exist in this process only, there are mock motors, assembled as the
    calibration says. Everywhere else they are somebody else's: real ones, or those of `humanoid_sim.hardware emulate`.
    """

    robot: HardwareRobot

    def __init__(
        self,
        config: PlayConfig,
        description: RobotDescription,
        control_period: float,
        left: ExitStack,
        contracts: Sequence[PolicyContract] = (),
    ) -> None:
        """Open nothing, but for mock motors, which run until `left`."""
        super().__init__(description)
        assert config.hardware is not None
        self._addresses = parse_addresses(config.hardware)
        is_virtual = [address.interface == "virtual" for address in self._addresses]
        if any(is_virtual) and not all(is_virtual):
            raise InputError(f"--hardware: is '{config.hardware}', expected virtual channels only, or none")
        for version in config.accept_firmware:
            parse_version(version)
        offsets, unconfirmed, self.notices = _homing_offsets(config, description, is_virtual=all(is_virtual))
        imu = make_imu(config.imu, description.hardware.imu_mounting)
        anchor = _anchor(description, contracts)
        self.live = {} if anchor is None else {ANCHOR_ORIENTATION: 4}
        clock: Callable[[], float] = time.monotonic
        keys: Callable[[], dict[str, FloatArray]] = dict
        self._motors: MockServer | None = None
        if all(is_virtual):
            with punctual_threads(behind=10):  # real motors are not held up by whatever else runs on this computer
                motors = self._motors = MockServer(description, self._addresses, homing_offset=offsets)
            left.callback(motors.close)
            clock, imu = motors.clock, imu or SimulatedImu(lambda: motors.truth)
            if description.is_floating:
                self.support = motors
            if description.piano is not None:
                self.live = {**self.live, KEY_PRESSED: KEY_COUNT}
                keys = lambda: {KEY_PRESSED: motors.truth.extern[KEY_PRESSED].value}  # noqa: E731
        self._has_imu = imu is not None
        self.robot = HardwareRobot(
            description,
            self._addresses,
            calibration=offsets,
            unconfirmed=unconfirmed,
            control_period=control_period,
            clock=clock,
            imu=imu,
            anchor=anchor,
            live=keys,
            allow_no_timeout=config.allow_no_timeout,
            can_timeout=config.can_timeout,
            accepted_firmware=config.accept_firmware,
        )
        model = self.model()
        self._qpos0: FloatArray = model.qpos0.copy()
        self._joints = np.array([model.joint(name).qposadr[0] for name in description.joint_names])

    def qpos(self, state: MITState) -> FloatArray:
        """Return the joints as they are measured; one that never reported is shown in its initial position."""
        qpos = self._qpos0.copy()
        known = np.isfinite(state.joint_position)
        qpos[self._joints] = np.where(known, state.joint_position, self.description.initial_position)
        qpos.setflags(write=False)
        return qpos

    def check_policy(self, contract: PolicyContract) -> list[str]:
        findings = motor_findings(contract, self.description)
        for finding in (*suspicious_findings(contract), *findings):
            if finding.severity == "error":
                name = self.description.name
                raise InputError(f"policy on robot '{name}': {finding}; see python -m humanoid_sim.policy check")
        by_imu = {"motion_anchor_ori"} if self.description.is_floating else set()
        kinds = {term.name: contract.kind(term) for term in contract.terms}
        measured = [name for name, kind in kinds.items() if kind.reads.startswith("imu_") or kind.name in by_imu]
        if measured and not self._has_imu:
            raise InputError(f"--imu: is none, but the policy observes {', '.join(measured)}")
        return [f"{finding.severity}: {finding}" for finding in findings]

    def bring_up(self, config: PlayConfig, console: Console) -> bool:
        """Prepare the robot, print what was checked, and ask the operator; True if it is to be enabled.

        Raises:
            RobotError: if something is wrong with the robot; the list is printed then too.
            InputError: if nobody can be asked.
        """
        asks = self._motors is None and not config.yes and not config.dry_run
        if asks and not (sys.stdin and sys.stdin.isatty()):
            raise InputError("--yes: is needed where nobody can be asked (standard input is not a terminal)")
        try:
            self.robot.prepare()
            self.robot.checks.refuse(questions=not config.dry_run)
        except RobotError as error:
            first = str(error).partition("\n")[0].rstrip(": ")
            raise RobotError(f"{first}: the checks on standard output say why") from None
        finally:
            console.print("[bold]Checks, before anything is enabled[/bold]")
            for verdict, subject, text in self.checks():
                console.print(Text.assemble((f"{verdict:<8} ", _STYLES[verdict]), (subject, "bold"), f"  {text}"))
        if config.dry_run:
            console.print("dry run: everything but enabling was done; no motor was enabled", markup=False)
            return False
        channels = ", ".join(map(str, self._addresses))
        question = f"Enable the motors of {self.description.name} on {channels}, without torque? [y/N] "
        if asks and console.input(Text(question)).strip().lower() not in ("y", "yes"):
            console.print("nothing was enabled", markup=False)
            return False
        return True

    def checks(self) -> Sequence[tuple[str, str, str]]:
        return self.robot.checks.all

    def figures(self) -> dict[str, Any]:
        """Return the robot's figures, and for how long, s, the clock of mock motors stood still."""
        figures, stood_still = self.robot.figures(), 0.0 if self._motors is None else self._motors.stood_still
        if stood_still:
            figures["lines"].append(f"the mock motors stood still for {stood_still:.2f} s: this computer was too slow")
        return {**figures, "emulation_stood_still": stood_still}

    def failure(self) -> str:
        failure = None if self._motors is None else self._motors.failure
        return "" if failure is None else f"mock motors: {failure!r}"


def _anchor(description: RobotDescription, contracts: Sequence[PolicyContract]) -> AnchorOrientation | None:
    oriented = [one for one in contracts if any(one.kind(term).name == "motion_anchor_ori" for term in one.terms)]
    body = shared("anchor_body", [one.anchor_body for one in oriented])
    return None if body is None else AnchorOrientation(description, body)


def _homing_offsets(
    config: PlayConfig, description: RobotDescription, *, is_virtual: bool
) -> tuple[dict[str, float], tuple[str, ...], tuple[str, ...]]:
    """Return the homing offset of every joint, rad, motor frame; joints of unconfirmed direction; and notices."""
    if config.calibration == "none" or (config.calibration is None and is_virtual):
        who = "mock motors, assembled without offsets" if is_virtual else "the motors' zeros are taken for the joints'"
        return dict.fromkeys(description.joint_names, 0.0), (), (f"no calibration: {who}",)
    path = Path(CALIBRATION if config.calibration is None else config.calibration)
    if config.calibration is None and not path.exists():
        raise InputError(
            f"--calibration: is missing, and there is no {CALIBRATION} here; without it nobody knows where the joints "
            "are: run python -m humanoid_sim.hardware calibrate, or say --calibration none for motors of emulate"
        )
    calibration = load_calibration(path, description)
    unconfirmed = () if is_virtual else calibration.unconfirmed(description)
    return calibration.homing_offsets(description), unconfirmed, (f"calibration {path}", *calibration.warnings)
