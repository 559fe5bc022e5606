"""The robot that a run plays on: its interface, and the simulated one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import mujoco
from rich.console import Console

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import resolve_action
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.policy.checks import effort_findings, model_findings, suspicious_findings
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.mjcf import bare_model, imu_line
from humanoid_sim.simulation import DROP
from humanoid_sim.simulation.floating_base import BaseObserver, Supported, support_in_mode
from humanoid_sim.simulation.model import SimConfig, build_model
from humanoid_sim.simulation.sim_robot import SimRobot

if TYPE_CHECKING:
    from humanoid_sim.hardware.robot import HardwareRobot


class RobotSetup:
    """A robot, and how a run shows and drives it."""

    robot: SimRobot | HardwareRobot
    live: Mapping[str, int]  # names and widths of the live inputs that its state carries
    notices: tuple[str, ...] = ()
    base: BaseObserver | None = None  # sees a simulated floating base, from the monitor's thread
    support: Supported | None = None  # of a floating base in MuJoCo

    def __init__(self, description: RobotDescription) -> None:
        self.description = description

    def model(self) -> mujoco.MjModel:
        """Return a model to draw the robot with. Each viewer draws with its own."""
        return build_model(self.description)

    def qpos(self, state: MITState) -> FloatArray:
        """Return MuJoCo's generalised position of the model, shape (nq,), given the robot's latest state."""
        raise NotImplementedError

    def check_policy(self, contract: PolicyContract) -> list[str]:
        """Return notices about driving this robot with a policy. Raises `InputError` if it cannot be driven."""
        raise NotImplementedError

    def enter(self, mode: Mode) -> str:
        """Note that a mode begins; returns a line to record. See `Session.mode_listener`."""
        return "" if self.support is None else support_in_mode(self.support, mode)

    def bring_up(self, config: PlayConfig, console: Console) -> bool:
        """Prepare the robot, print what was checked, and ask the operator; True if it is to be enabled."""
        return True

    def checks(self) -> Sequence[tuple[str, str, str]]:
        """Return the findings of the latest bring-up: verdict, subject, text."""
        return ()

    def warnings(self) -> Sequence[str]:
        return [f"{subject}: {text}" for verdict, subject, text in self.checks() if verdict == "warning"]

    def figures(self) -> dict[str, Any] | None:
        """Return figures of its buses, for the summary: JSON, with `lines` for people."""
        return None

    def failure(self) -> str:
        """Return why what the robot needs beside itself has failed; empty while it works."""
        return ""


_Value = TypeVar("_Value")


def shared(field: str, values: Sequence[_Value]) -> _Value | None:
    """Return the value that all policies have who have one. Raises `InputError` if they differ."""
    for value in values[1:]:
        if value != values[0]:
            raise InputError(f"--policy: {field} differs, {values[0]} and {value}; a session's policies share it")
    return values[0] if values else None


class SimulatedSetup(RobotSetup):
    """A robot in MuJoCo that measures what the policies of contracts observe."""

    robot: SimRobot

    def __init__(
        self, description: RobotDescription, control_period: float, contracts: Sequence[PolicyContract]
    ) -> None:
        """Make the robot; the control period is in s."""
        super().__init__(description)
        settings = SimConfig(
            control_period=control_period,
            drop=DROP,
            anchor_body=shared("anchor_body", [one.anchor_body for one in contracts if one.anchor_body]) or "",
            velocity_at=tuple(dict.fromkeys(point for one in contracts for point in one.velocity_points)),
            height_scan=shared("height_scan", [one.height_scan for one in contracts if one.height_scan is not None]),
        )
        self.robot = SimRobot(description, settings)
        self.live = self.robot.extern
        self._bare = bare_model(description)
        self.notices = tuple(self.robot.warnings)
        if description.is_floating:
            self.notices = (f"IMU: {imu_line(self._bare, description)}", *self.notices)
            self.base, self.support = BaseObserver(self.robot.model, description), self.robot

    def qpos(self, state: MITState) -> FloatArray:
        return self.robot.qpos

    def check_policy(self, contract: PolicyContract) -> list[str]:
        gains = resolve_action(contract, self.description.joint_names)
        findings = [
            *(finding for finding in suspicious_findings(contract) if finding.severity == "error"),
            *model_findings(contract, self.description, self._bare),
            *effort_findings(contract, self.description),
        ]
        return [*self.robot.stability.check(gains.damping, "policy", gains.stiffness), *map(str, findings)]
