"""The robot that a run plays on: its interface, and the simulated one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeVar

import mujoco

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.policy_step import resolve_action
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode
from humanoid_sim.mit import FloatArray, MITState
from humanoid_sim.policy.checks import effort_findings, model_damping_findings, suspicious_findings
from humanoid_sim.policy.song import key_name
from humanoid_sim.robots.actuators import own_joint_damping
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.robots.imu import imu_line
from humanoid_sim.robots.mjcf import bare_model
from humanoid_sim.robots.robot import Robot
from humanoid_sim.simulation import DROP
from humanoid_sim.simulation.floating_base import BaseObserver, support_in_mode
from humanoid_sim.simulation.model import SimConfig, build_model
from humanoid_sim.simulation.sim_robot import SimRobot, Touch


class PlayedRobot(Robot, Protocol):
    """A robot that can tell whether there is still anything to protect."""

    @property
    def is_closed(self) -> bool:
        """Return True if `close` was called."""


@dataclass(frozen=True, slots=True)
class BringUp:
    """Checks and questions for an operator before a real robot is enabled."""

    question: str
    """To be answered with yes before anything is enabled; empty where nothing can be hurt."""
    prepare: Callable[[], None]
    """Does everything but enable. Raises `RobotError` if something is wrong."""
    checks: Callable[[], Sequence[tuple[str, str, str]]]
    """Findings so far: verdict (`ok`, `warning`, `problem`), subject, text."""

    def warnings(self) -> tuple[str, ...]:
        """Return the warnings of the latest checks, one line each."""
        return tuple(f"{subject}: {text}" for verdict, subject, text in self.checks() if verdict == "warning")


class Touches:
    """Hardest touch of a simulated piano's key, against the robot's limit; to be called with each new mode.

    The limit is for a robot that is driven. In DAMPING and ZERO_TORQUE arms sink onto the keys by their weight.
    """

    def __init__(self, robot: SimRobot, limit: float) -> None:
        self._robot, self._limit, self._is_limp = robot, limit, True
        self._driven: Touch | None = None
        self._sunk = 0.0

    def __call__(self, mode: Mode) -> str:
        """Take in that a mode begins."""
        self._note()
        self._is_limp = mode in (Mode.ZERO_TORQUE, Mode.DAMPING)
        return ""

    def figures(self) -> dict[str, Any]:
        """Return force in N, time in s and name of the key of the hardest touch, the limit, and the force when limp."""
        self._note()
        hardest: dict[str, Any] = {"force": 0.0, "key": None, "time": None}
        if self._driven is not None:
            hardest = self._driven._asdict() | {"key": key_name(self._driven.key)}
        return hardest | {"limit": self._limit, "sunk": self._sunk}

    def _note(self) -> None:
        touch = self._robot.hardest_touch
        if touch is not None and self._is_limp:
            self._sunk = max(self._sunk, touch.force)
        elif touch is not None and (self._driven is None or touch.force > self._driven.force):
            self._driven = touch
        self._robot.forget_touches()


@dataclass(frozen=True, slots=True)
class RobotSetup:
    """A robot, and how a run shows and drives it."""

    robot: PlayedRobot
    live: Mapping[str, int]
    """Names and widths of the live inputs that its state carries."""
    qpos: Callable[[MITState], FloatArray]
    """Shape (nq,), MuJoCo's generalised position of `model` with the robot as it is, given its latest state."""
    model: Callable[[], mujoco.MjModel]
    """A model to draw the robot with. Each viewer draws with its own, so that none can touch the robot's."""
    check_policy: Callable[[PolicyContract], tuple[str, ...]]
    """Notices about driving this robot with a policy, one line each. Raises `InputError` if it cannot be driven."""
    base: BaseObserver | None = None
    """Sees a simulated floating base, from the monitor's thread; None where there is none."""
    mode_listener: Callable[[Mode], str] | None = None
    """See `Session`."""
    key_force: Callable[[], Mapping[str, Any] | None] = lambda: None
    """Hardest touch of a simulated piano's keys; None without one."""
    notices: tuple[str, ...] = ()
    bring_up: BringUp | None = None
    """None in simulation."""
    figures: Callable[[], Mapping[str, Any] | None] = lambda: None
    """Figures of its buses, for the summary: JSON, with `lines` for people."""
    is_driven: Callable[[], bool] = lambda: True
    """True if commands reach its motors."""
    failure: Callable[[], str] = lambda: ""
    """Why what the robot needs beside itself has failed; empty while it works."""


_Value = TypeVar("_Value")


def shared(field: str, values: Sequence[_Value]) -> _Value | None:
    """Return the value that all policies have who have one. Raises `InputError` if they differ."""
    for value in values[1:]:
        if value != values[0]:
            raise InputError(f"--policy: {field} differs, {values[0]} and {value}; a session's policies share it")
    return values[0] if values else None


def simulated_robot(
    description: RobotDescription, control_period: float, contracts: Sequence[PolicyContract]
) -> RobotSetup:
    """Return a robot in MuJoCo that measures what the policies of contracts observe; the control period is in s."""
    settings = SimConfig(
        control_period=control_period,
        drop=DROP,
        anchor_body=shared("anchor_body", [one.anchor_body for one in contracts if one.anchor_body]) or "",
        velocity_at=tuple(dict.fromkeys(point for one in contracts for point in one.velocity_points)),
        height_scan=shared("height_scan", [one.height_scan for one in contracts if one.height_scan is not None]),
    )
    robot = SimRobot(description, settings)
    touches = None if description.piano is None else Touches(robot, description.piano.key_force_limit)
    bare = bare_model(description)
    imu = (f"IMU: {imu_line(bare, description)}",) if description.is_floating else ()

    def check_policy(contract: PolicyContract) -> tuple[str, ...]:
        gains = resolve_action(contract, description.joint_names)
        findings = [
            *(finding for finding in suspicious_findings(contract) if finding.severity == "error"),
            *model_damping_findings(contract, own_joint_damping(bare, description)),
            *effort_findings(contract, description),
        ]
        return robot.stability.check(gains.damping, "policy", gains.stiffness), *map(str, findings)

    return RobotSetup(
        robot,
        live=robot.extern,
        key_force=(lambda: None) if touches is None else touches.figures,
        qpos=lambda _: robot.qpos,
        model=lambda: build_model(description),
        check_policy=check_policy,
        base=BaseObserver(robot.model, description) if description.is_floating else None,
        mode_listener=partial(support_in_mode, robot) if description.is_floating else touches,
        notices=(*imu, *robot.warnings),
    )
