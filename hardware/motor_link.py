"""The interface between a robot and a family of motors. A family is one class: `RobstrideMotors`, `SitoMotors`."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from humanoid_sim.hardware.can_bus import Frame
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.messages import SafetyFlag, SafetyStatus
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.motors import MotorModel

CAN_TIMEOUT = 0.1  # s without a command after which a motor stops by itself, unless another time is wanted


class Motor(NamedTuple):
    """A motor of a robot, or of a tool."""

    name: str  # the joint that it drives, or a tool's name for it
    channel: int  # index into the open channels
    motor_id: int
    model: MotorModel
    torque_limit: float = 0.0  # N·m, written to the firmware; 0: leave the firmware's own
    current_limit: float = 0.0  # A, likewise
    damping: float = 0.0  # N·m·s/rad with which a watchdog brakes it


class Readings(NamedTuple):
    """The latest state of every motor; NaN for one that was never received. Shape (n,) each, motor frame."""

    time: FloatArray  # s, robot's clock; where position and velocity come in two frames, of the older one
    position: FloatArray  # rad, as reported: within the model's range
    velocity: FloatArray  # rad/s
    effort: FloatArray  # N·m
    temperature: FloatArray  # °C; NaN where the family does not report it


class Finding(NamedTuple):
    """Something that is wrong with a motor."""

    motor: Motor
    flag: SafetyFlag
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class LinkTerms:
    """Settings of a robot for the motors of every family."""

    can_timeout: float  # s without a command after which a motor stops by itself, where it can
    control_period: float  # s between two commands
    uids: dict[str, bytes] = field(default_factory=dict)  # motors' unique ids by joint, as they were found first
    accepted_firmware: Collection[str] = ()  # versions that no document mentions and an operator accepts


class MotorLink(Protocol):
    """One family's motors on open channels, each known by its index in `motors`.

    `examine`, `make_ready`, `enable` and `stop` wait for what they need, and note what is wrong in the checks; the
    robot refuses to go on where there are problems. Nothing else waits or raises.
    """

    motors: Sequence[Motor]

    def receive(self, channel: int, frame: Frame, time: float) -> bool:
        """Take a frame, on its receiver's thread; True if it is one of this family's."""

    def examine(self, checks: CheckList) -> None:
        """Check that these motors are there, known, and driven by nobody else. Changes nothing in any motor."""

    def make_ready(self, checks: CheckList) -> None:
        """Stop the motors, clear their faults, and configure them; leaves them stopped."""

    def enable(self, checks: CheckList) -> None:
        """Enable every motor, without torque, and start their reports."""

    def readings(self) -> Readings:
        """Return the latest state of every motor."""

    def findings(self, since: float) -> Iterable[Finding]:
        """Return what is wrong with the motors now, or was at or after `since`, s, robot's clock."""

    def status(self) -> SafetyStatus | None:
        """Return what is wrong with the watchdog of these motors; FAULT: it has taken over, and nothing is sent."""
        return None

    def command(self, values: FloatArray) -> None:
        """Queue one command to every motor, superseding what has not left.

        Shape (5, motors), within the models' ranges: position rad, velocity rad/s, effort N·m, stiffness, damping.
        """

    def stop(self, motors: Sequence[int]) -> dict[int, str]:
        """Disable motors; returns those that did not confirm it, with the mode that they last reported."""

    def close(self) -> None:
        """Release what belongs to this link: a watchdog brakes motors that did not confirm that they are stopped."""
