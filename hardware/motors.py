"""Motors of any family, as a host knows them: where they are, what is heard of them, and what a session does with them.

A family's folder has a `MotorLink` and a `FrameEncoder`; `families` says which.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Protocol

import numpy as np
import numpy.typing as npt

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.checks import CheckList
from humanoid_sim.messages import SafetyFlag
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.motors import FAMILIES, MotorModel


@dataclass(frozen=True, slots=True, eq=False)
class MotorGroup:
    """Motors on some channels, each known by its index: a robot's, those of one family, or those of a bench tool."""

    names: tuple[str, ...]
    """The joint that each drives, or what a tool calls it."""
    channel: tuple[int, ...]
    """Index into the open channels."""
    motor_id: tuple[int, ...]
    model: tuple[MotorModel, ...]
    torque_limit: tuple[float, ...]
    """N·m, written to the firmware; 0: leave the firmware's own."""
    current_limit: tuple[float, ...]
    """A, written to the firmware; 0: leave the firmware's own."""

    @property
    def count(self) -> int:
        """n, the number of motors."""
        return len(self.names)

    def on_channel(self, channel: int) -> tuple[int, ...]:
        """Return indices of the motors on a channel."""
        return tuple(i for i, index in enumerate(self.channel) if index == channel)

    def period_frames(self, channel: int) -> int:
        """Frames on a channel in a control period to its motors, at most, and as many from them."""
        return sum(FAMILIES[self.model[i].family].period_frames for i in self.on_channel(channel))

    def of_family(self, family: str) -> tuple[int, ...]:
        """Return indices of the motors of a family."""
        return tuple(i for i, model in enumerate(self.model) if model.family == family)

    @property
    def unasked(self) -> tuple[int, ...]:
        """Indices of the motors that cannot be asked who and where they are."""
        return tuple(i for i, model in enumerate(self.model) if not FAMILIES[model.family].has_questions)

    def select(self, indices: Sequence[int]) -> MotorGroup:
        """Return some of these motors as a group of their own, in this order."""
        values = (getattr(self, field.name) for field in fields(MotorGroup))
        return MotorGroup(*(tuple(value[i] for i in indices) for value in values))


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The latest state of every motor; NaN for one that was never heard. Shape (n,) each, motor frame."""

    time: FloatArray
    """s, robot's clock; where position and velocity come in two frames, of the older one."""
    position: FloatArray
    """rad, as reported: within the model's range."""
    velocity: FloatArray
    """rad/s"""
    effort: FloatArray
    """N·m"""
    temperature: FloatArray
    """°C; NaN where the family does not report it."""


Finding = tuple[SafetyFlag, str, str]
"""A flag, what was found, and the joint; no joint where the finding is the channel's."""
STOPPED = "left run mode (mode reset)"
"""Finding on a motor that stopped without a fault, as by its own timeout."""


Rescue = tuple[tuple[Frame, ...], tuple[Frame, ...]]
"""The frames that damp a motor, and those that reset it, see `GuardedMotor`."""


@dataclass(frozen=True, slots=True)
class MotorFigures:
    """Counts of the traffic between a host and one motor."""

    commanded: int
    """Commands that were handed to the channel."""
    acknowledged: int | None
    """Commands that the motor answered; None: its family answers none."""
    reports: int
    """Statuses that the motor sent by itself."""
    invalid_frames: int


@dataclass(frozen=True, slots=True)
class SessionTerms:
    """Terms that a session sets for the motors of every family."""

    host_id: int
    """Our id on the bus, where the family has such a thing."""
    can_timeout: float
    """s without a command after which a motor stops by itself, where it can."""
    control_period: float
    """s between two commands."""
    period_frames: tuple[int, ...] = ()
    """By channel: frames in a control period to the motors of all families, at most, and as many from them."""
    known_uids: Mapping[str, bytes] = field(default_factory=dict)
    """Unique ids at an earlier activation by joint, where motors have them."""


@dataclass(frozen=True, slots=True, eq=False)
class EncodedFrames:
    """One command to each motor of a group as frames, and what did not fit into them."""

    frames: tuple[tuple[int, int, Frame], ...]
    """Motor, a number that tells its kinds of frames apart, and the frame; in the order in which they are to leave."""
    saturated: npt.NDArray[np.bool_]
    """Shape (5, motors): whether position, velocity, effort, stiffness or damping was cut off."""


class FrameEncoder(Protocol):
    """Turns commands into frames, for motors of one family in a fixed order."""

    def encode(self, values: FloatArray) -> EncodedFrames:
        """Return the frames of one command to every motor.

        Args:
            values: shape (5, motors), finite, motor frame: position rad, velocity rad/s, effort N·m, stiffness N·m/rad,
                damping N·m·s/rad.
        """


class MotorLink(Protocol):
    """One family's motors on open channels, as a session drives them; each is known by its index in `motors`.

    `examine`, `make_ready`, `enable`, `start` and `stop` wait for what they need. What a motor does or fails to do is a
    line of the checks.
    """

    motors: MotorGroup
    uids: Mapping[str, bytes]
    """Unique ids by joint, as far as they were found."""
    knows_positions: bool
    """True if a motor tells its position before it is enabled."""

    def receive(self, channel: int, frame: Frame, time: float) -> bool:
        """Take a frame, on its receiver's thread; whether it is one of this family's."""

    # --- activation

    def examine(self, checks: CheckList) -> None:
        """Look whether these motors may be touched: listens, and asks where there are questions. Writes nothing."""

    def make_ready(self, checks: CheckList) -> None:
        """Stop the motors, see to their faults, and configure them; leaves them stopped."""

    def counted(self) -> Mapping[int, float | None]:
        """By motor what it counts by itself, turns included, rad; None: it does not say. Empty: no such question."""
        return {}

    def start(self, checks: CheckList) -> None:
        """Have motors that can report by themselves do so: the last step before enabling."""

    def enable(self, checks: CheckList) -> None:
        """Enable every motor, without torque."""

    def stop(self, motors: Iterable[int]) -> tuple[int, ...]:
        """Disable motors; those that did not confirm it."""

    def state_text(self, motor: int) -> str:
        """Return what a motor last said of its mode, in words."""

    # --- control

    def begin(self) -> None:
        """Begin to watch: the motors are enabled, and only what happens next counts."""

    def readings(self) -> Readings:
        """Return the latest state of every motor."""

    def findings(self, motor: int, recent: float) -> Iterable[Finding]:
        """Return what is wrong with a motor, or was since `recent`, s, robot's clock."""

    def count_commands(self) -> None:
        """One command goes to every motor."""

    def figures(self, motor: int) -> MotorFigures:
        """Return what happened so far."""

    def finish(self) -> None:
        """Before the motors are disabled: await the last answers, and end reports."""
