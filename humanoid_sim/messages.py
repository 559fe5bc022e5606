"""Modes, intents, safety and the records that cross the boundary of the control stack.

Numeric values are frozen: they are those of `humanoid_control_msgs` on the wire and in recordings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum, IntFlag

import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray, MITCommand, MITState


class Mode(IntEnum):
    """`ControlMode.mode`: what the robot is doing."""

    ZERO_TORQUE = 0
    DAMPING = 1
    STANDBY = 2
    LOCOMOTION = 3
    REMOTE = 4

    @property
    def is_free(self) -> bool:
        """Whether what commands the robot balances it too, so that no support holds a floating base."""
        return self in (Mode.LOCOMOTION, Mode.REMOTE)


class SafetyLevel(IntEnum):
    """`SafetyStatus.level`."""

    OK = 0
    WARNING = 1
    FAULT = 2
    CRITICAL = 3


class SafetyFlag(IntFlag):
    """Bits of `SafetyStatus.flags`."""

    NONE = 0
    BUS_OFF = 1 << 0
    RX_TIMEOUT = 1 << 1
    TX_QUEUE_OVERRUN = 1 << 2
    MOTOR_FAULT = 1 << 3
    TEMPERATURE_LIMIT = 1 << 4
    INVALID_FRAME = 1 << 5


class Intent(Enum):
    """An operator's request. The value is the name of the ROS 2 service, and the word on the command line."""

    DAMP = "damp"
    LOAD_A = "load_a"
    LOAD_B = "load_b"
    START_LOCOMOTION = "start_locomotion"
    START_REMOTE = "start_remote"
    QUIT = "quit"


@dataclass(frozen=True, slots=True)
class SafetyStatus:
    """The health of one source (a bus, the simulator), or of all of them merged."""

    level: SafetyLevel = SafetyLevel.OK
    flags: SafetyFlag = SafetyFlag.NONE
    source: str = ""
    message: str = ""

    @property
    def is_ok(self) -> bool:
        """Whether the level is OK; flags alone do not decide."""
        return self.level is SafetyLevel.OK


OK = SafetyStatus()  # nothing is wrong; of no source in particular


@dataclass(frozen=True, slots=True)
class ControlMode:
    """Mode and controller in force, and the latest thing an operator should know about them."""

    mode: Mode
    controller_name: str
    status_message: str = ""


@dataclass(frozen=True, slots=True)
class StandbyState:
    """Progress of a standby controller."""

    current_segment: int  # index into the pose sequence
    total_segments: int
    progress: float  # [0, 1] within the current segment
    is_finished: bool  # the command is at the final pose and the final gains


@dataclass(frozen=True, slots=True, eq=False)
class RemoteCommand:
    """A command from outside the control loop, its joint names already checked, stamped when it arrived."""

    command: MITCommand
    arrival_time: float  # s, robot's clock. The sender's clock plays no part


@dataclass(frozen=True, slots=True, eq=False)
class PolicyStep:
    """One inference: what the policy saw and what it answered."""

    frame: int  # index of the reference frame that was shown
    observation: npt.NDArray[np.float32]  # shape (N,), the terms in their order
    action: npt.NDArray[np.float32]  # shape (M,), raw: neither scaled nor offset


@dataclass(frozen=True, slots=True)
class FaultReport:
    """A controller that failed in this tick, and who took over."""

    controller: str
    fallback: str
    message: str
    is_bug: bool = False  # the controller raised instead of returning a fault


@dataclass(frozen=True, slots=True, eq=False)
class TickInput:
    """Everything that one tick may depend on."""

    state: MITState
    safety: tuple[SafetyStatus, ...] = ()  # one status per source
    intents: tuple[Intent, ...] = ()  # all of this tick, in order of arrival
    remote: RemoteCommand | None = None  # the latest accepted remote command, if there ever was one
    policy: str = ""  # name of the loaded policy to select; '' keeps the one that is selected


@dataclass(frozen=True, slots=True, eq=False)
class TickOutput:
    """Everything that one tick decides."""

    command: MITCommand
    control_mode: ControlMode
    standby: StandbyState | None = None  # set in STANDBY
    quit: bool = False
    faults: tuple[FaultReport, ...] = ()
    refusals: tuple[str, ...] = ()  # reasons why intents of this tick took no effect
    policy_step: PolicyStep | None = None  # set in the ticks in which the policy ran
    policy_error: str | None = None  # error that the policy raised instead of an answer in this tick


URDF_DOCUMENT = "urdf"
"""Document of a header: the robot as URDF. The `qpos` of ticks begins with that of its joints, in their order."""


@dataclass(frozen=True, slots=True)
class SessionHeader:
    """Description of a run: everything that a reader needs to interpret, and to repeat, its ticks."""

    robot: str  # the robot's name, e.g. `lite`
    joint_names: tuple[str, ...]
    control_period: float  # s
    start_time_ns: int  # Wall-clock nanoseconds (Unix epoch) of the robot clock's zero
    documents: Mapping[str, str] = field(default_factory=dict)  # JSON texts by name: robot, contract, settings, …
    attachments: Mapping[str, bytes] = field(default_factory=dict)  # files by name: the motion that was played
    observation_terms: tuple[tuple[str, int], ...] = ()  # name and width of each; empty without a policy


@dataclass(frozen=True, slots=True, eq=False)
class TickRecord:
    """One tick of the loop."""

    index: int  # counts from 0; a skipped deadline does not skip an index
    input: TickInput
    output: TickOutput
    duration: float  # s of wall time from the start of `read` to the end of `write`, less a simulation's physics
    overrun: bool  # the tick missed its deadline
    qpos: FloatArray | None = None  # (nq,), MuJoCo's when the state was read, for viewers; None without a simulator


class EventKind(IntEnum):
    """Kind of an event outside the ticks; the text of an event is for people alone."""

    NOTE = 0
    FRESH_START = 1  # the control stack began again, in ZERO_TORQUE, because an operator had the robot activated afresh
    SUPPORT = 2  # the support let the base go, or holds it again
    FAILURE = 3  # a part beside the control stack failed, or the run ended with an exception
    LOSS = 4  # ticks are missing from the recording
    ENDING = 5  # the run is about to end
    FALL = 6  # the robot fell, or lost the motion that it follows
    PUSH = 7  # an operator pushed the simulated robot, from the tick that follows on


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened outside the ticks."""

    time: float  # s, robot's clock
    text: str  # one line
    kind: EventKind = EventKind.NOTE
