"""The real robot of a run: motors on CAN channels, or mock motors in this process that speak the same protocol."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.errors import InputError
from humanoid_sim.hardware.calibration import load_calibration
from humanoid_sim.hardware.can_bus import BusAddress, parse_addresses
from humanoid_sim.hardware.imu import SimulatedImu, make_imu
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.robot import HardwareRobot
from humanoid_sim.hardware.robstride.firmware import parse_version
from humanoid_sim.mit import ANCHOR_ORIENTATION, KEY_PRESSED, FloatArray, MITState
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.played_robot import BringUp, RobotSetup, shared
from humanoid_sim.policy.checks import motor_findings, suspicious_findings
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.piano import KEY_COUNT
from humanoid_sim.session.realtime import punctual_threads
from humanoid_sim.simulation.floating_base import support_in_mode
from humanoid_sim.simulation.kinematics import AnchorOrientation
from humanoid_sim.simulation.model import build_model

CALIBRATION = "calibration.yaml"
"""File of a robot's calibration, unless an option names another."""


def real_robot(
    config: PlayConfig,
    description: RobotDescription,
    control_period: float,
    left: ExitStack,
    contracts: Sequence[PolicyContract] = (),
) -> RobotSetup:
    """Return a robot on the channels of `--hardware`, which measures what the policies of contracts observe.

    Opens nothing, but for mock motors, which run until `left`.

    On channels of the interface `virtual`, which exist in this process only, there are mock motors, assembled as the
    calibration says. Everywhere else they are somebody else's: real ones, or those of `humanoid_sim.hardware emulate`.
    """
    assert config.hardware is not None
    addresses = parse_addresses(config.hardware)
    for version in config.accept_firmware:
        parse_version(version)
    is_virtual = [address.interface == "virtual" for address in addresses]
    if any(is_virtual) and not all(is_virtual):
        raise InputError(f"--hardware: is '{config.hardware}', expected virtual channels only, or none")
    offsets, unconfirmed, notices = _homing_offsets(config, description, addresses)
    motors: MockServer | None = None
    if all(is_virtual):
        with punctual_threads(behind=10):  # real motors are not held up by whatever else runs on this computer
            motors = MockServer(description, addresses, homing_offset=offsets)
        left.callback(motors.close)
    imu = make_imu(config.imu, config.imu_mounting)
    if imu is None and motors is not None:
        imu = SimulatedImu(lambda: motors.truth)
    anchor = _anchor(description, contracts)
    keys = None if motors is None or description.piano is None else motors
    robot = HardwareRobot(
        description,
        addresses,
        calibration=offsets,
        unconfirmed=unconfirmed,
        control_period=control_period,
        clock=time.monotonic if motors is None else motors.clock,
        imu=imu,
        anchor=anchor,
        live=dict if keys is None else lambda: {KEY_PRESSED: keys.truth.extern[KEY_PRESSED].value},
        allow_no_timeout=config.allow_no_timeout,
        can_timeout=config.can_timeout,
        accepted_firmware=config.accept_firmware,
    )
    channels = ", ".join(map(str, addresses))
    question = f"Enable the motors of {description.name} on {channels}, without torque?"
    return RobotSetup(
        robot,
        live=({} if anchor is None else {ANCHOR_ORIENTATION: 4}) | ({} if keys is None else {KEY_PRESSED: KEY_COUNT}),
        qpos=MeasuredPose(description),
        model=lambda: build_model(description),
        check_policy=lambda contract: check_policy(contract, description, has_imu=imu is not None),
        mode_listener=partial(support_in_mode, motors) if motors is not None and description.is_floating else None,
        notices=notices,
        bring_up=_bring_up(robot, "" if motors is not None else question),
        figures=lambda: _figures(robot, motors),
        is_driven=lambda: robot.is_enabled,
        failure=lambda: "" if motors is None or motors.failure is None else f"mock motors: {motors.failure!r}",
    )


def _anchor(description: RobotDescription, contracts: Sequence[PolicyContract]) -> AnchorOrientation | None:
    """Return what measures the anchor body's orientation; None where no policy observes it."""
    oriented = [one for one in contracts if any(one.kind(term).name == "motion_anchor_ori" for term in one.terms)]
    body = shared("anchor_body", [one.anchor_body for one in oriented])
    return None if body is None else AnchorOrientation(description, body)


def _homing_offsets(
    config: PlayConfig, description: RobotDescription, addresses: Sequence[BusAddress]
) -> tuple[dict[str, float], tuple[str, ...], tuple[str, ...]]:
    """Return the homing offset of every joint, rad, motor frame; joints of unconfirmed direction; and notices."""
    interfaces = {address.interface for address in addresses}
    if config.calibration is None and interfaces == {"virtual"}:
        return dict.fromkeys(description.joint_names, 0.0), (), ("mock motors, assembled without offsets",)
    if config.calibration == "none":
        notice = "no calibration: the motors' zeros are taken for the joints'"
        return dict.fromkeys(description.joint_names, 0.0), (), (notice,)
    path = Path(CALIBRATION if config.calibration is None else config.calibration)
    if config.calibration is None and not path.exists():
        none = ", or add --calibration none for motors of hardware emulate" if interfaces == {"udp_multicast"} else ""
        raise InputError(
            f"--calibration: is missing, and there is no {CALIBRATION} here; without it nobody knows where the joints "
            f"are: run python -m humanoid_sim.hardware calibrate{none}"
        )
    calibration = load_calibration(path, description)
    unconfirmed = () if interfaces == {"virtual"} else calibration.unconfirmed(description)
    return calibration.homing_offsets(description), unconfirmed, (f"calibration {path}", *calibration.warnings)


def check_policy(contract: PolicyContract, description: RobotDescription, *, has_imu: bool) -> tuple[str, ...]:
    """Refuse what the motors cannot be told, what cannot be meant, and what nobody measures."""
    suspicious = (finding for finding in suspicious_findings(contract) if finding.severity == "error")
    findings = [*suspicious, *motor_findings(contract, description)]
    for finding in findings:
        if finding.severity == "error":
            raise InputError(
                f"policy on robot '{description.name}': {finding}; see python -m humanoid_sim.policy check"
            )
    by_imu = {"motion_anchor_ori"} if description.is_floating else set()
    kinds = {term.name: contract.kind(term) for term in contract.terms}
    measured = [name for name, kind in kinds.items() if kind.reads.startswith("imu_") or kind.name in by_imu]
    if measured and not has_imu:
        raise InputError(f"--imu: is none, but the policy observes {', '.join(measured)}")
    return tuple(f"{finding.severity}: {finding}" for finding in findings)


def _bring_up(robot: HardwareRobot, question: str) -> BringUp:
    return BringUp(
        question,
        prepare=robot.prepare,
        checks=lambda: robot.checks.all,
    )


def _figures(robot: HardwareRobot, motors: MockServer | None) -> Mapping[str, Any]:
    """Return the robot's figures, and for how long, s, the clock of mock motors stood still."""
    figures, stood_still = robot.figures(), 0.0 if motors is None else motors.stood_still
    if stood_still:
        figures["lines"].append(f"the mock motors stood still for {stood_still:.2f} s: this computer was too slow")
    return {**figures, "emulation_stood_still": stood_still}


class MeasuredPose:
    """From a state to MuJoCo's generalised position. A joint that was never heard stands in its initial position."""

    def __init__(self, description: RobotDescription) -> None:
        model = build_model(description, scene=False)
        self._initial = np.array(description.initial_position)
        self._qpos: FloatArray = model.qpos0.copy()
        self._joints = np.array([model.joint(name).qposadr[0] for name in description.joint_names])

    def __call__(self, state: MITState) -> FloatArray:
        """Shape (nq,), read-only."""
        qpos = self._qpos.copy()
        qpos[self._joints] = np.where(np.isfinite(state.joint_position), state.joint_position, self._initial)
        qpos.setflags(write=False)
        return qpos
