"""The real adapter, session and supervisor on one channel, one tick at a time, and everything written down."""

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache

import can
import numpy as np
from msgspec.structs import replace

from humanoid_sim import messages
from humanoid_sim.assets import SAMPLE_POLICY, asset_path
from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.bus.address import BusAddress
from humanoid_sim.hardware.bus.address import open_bus as open_python_can
from humanoid_sim.hardware.bus.channel import ChannelCounters
from humanoid_sim.hardware.robot import HardwareRobot
from humanoid_sim.mit import FloatArray, MITCommand, MITState
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import LoadedPolicy, load_policy
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.motors import FAMILIES
from humanoid_sim.robots.schema import StandbySettings
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.session import Session
from humanoid_sim.stack import build_supervisor

PERIOD = 0.02
"""s, 50 Hz: the rate on hardware."""
CAN_TIMEOUT = 0.1
"""s"""

Clock = Callable[[], float]


class NotReachedError(Exception):
    """The robot did not get to the mode in which the fault was to happen."""


def quick_lite(name: str = "lite") -> RobotDescription:
    """The Lite, with these motors, at its standby pose within a second."""
    lite = load_robot(name)
    return replace(lite, standby_controller_a=_quick(lite.standby_controller_a))


def _quick(standby: StandbySettings) -> StandbySettings:
    return replace(standby, segment_durations=(0.8,), pose_segments=standby.pose_segments[-1:])


@cache
def sample_policy() -> LoadedPolicy:
    checkpoint = load_checkpoint(SAMPLE_POLICY)
    motion = read_motion(asset_path("motions", "circle.mcap"))
    return load_policy(checkpoint.contract, checkpoint.policy, motion, checkpoint.observation_width)


@dataclass(frozen=True)
class Tick:
    """What one turn of the loop saw, decided and found to be true."""

    read: float
    """s, slow clock, when the state was read."""
    safety: tuple[messages.SafetyStatus, ...]
    state: MITState
    """As the robot told it."""
    output: messages.TickOutput
    seen: float
    """s, slow clock, of the truth that follows."""
    effort: FloatArray
    """Shape (n,), N·m: the true torques towards the end of the turn."""
    velocity: FloatArray
    """Shape (n,), rad/s: the true velocities then."""

    @property
    def mode(self) -> messages.Mode:
        return self.output.control_mode.mode

    @property
    def flags(self) -> messages.SafetyFlag:
        flags = messages.SafetyFlag.NONE
        for status in self.safety:
            flags |= status.flags
        return flags

    @property
    def is_ok(self) -> bool:
        return all(status.is_ok for status in self.safety)


class _Timed:
    """A robot that notes when it was read."""

    def __init__(self, robot: HardwareRobot, clock: Clock) -> None:
        self.robot = robot
        self._clock = clock
        self.joints = robot.joints
        self.read_at = 0.0

    def activate(self) -> None:
        self.robot.activate()

    def read(self) -> tuple[MITState, tuple[messages.SafetyStatus, ...]]:
        self.read_at = self._clock()
        return self.robot.read()

    def write(self, command: MITCommand) -> None:
        self.robot.write(command)

    def close(self) -> None:
        self.robot.close()


class _Ticks:
    """A sink that keeps every tick."""

    backlog = 0
    backlog_limit = 0

    def __init__(self, robot: _Timed, truth: Callable[[], MITState] | None) -> None:
        self._robot, self._truth = robot, truth
        self.all: list[Tick] = []

    def start(self, header: messages.SessionHeader) -> None:
        return

    def tick(self, record: messages.TickRecord) -> None:
        known = self._robot.read_at, record.input.safety, record.input.state, record.output
        if self._truth is None:
            self.all.append(Tick(*known, math.nan, np.empty(0), np.empty(0)))
            return
        truth = self._truth()
        self.all.append(Tick(*known, truth.time, truth.joint_effort, truth.joint_velocity))

    def event(self, event: messages.Event) -> None:
        return

    def close(self) -> None:
        return


class _Holder:
    """A remote source that is never late: hold the standby pose."""

    def __init__(self, description: RobotDescription) -> None:
        n = description.joint_count
        pose = np.array(description.standby_controller_a.pose_segments[-1])
        self._command = MITCommand(pose, np.zeros(n), np.zeros(n), np.full(n, 50.0), np.full(n, 2.0))
        self.clock: Callable[[], float] = lambda: 0.0

    def latest(self) -> messages.RemoteCommand:
        return messages.RemoteCommand(self._command, self.clock())


@dataclass
class Drive:
    """A running robot; `ticks` grows as it goes."""

    joints: tuple[str, ...]
    session: Session
    ticks: list[Tick]
    clock: Clock
    counters: ChannelCounters
    """Of its first channel."""
    deadline: float = 0.0
    """s, of the next tick."""

    def run(self, seconds: float, *intents: messages.Intent) -> None:
        """Ticks for a time; the intents go with the first."""
        for number in range(max(round(seconds / PERIOD), 1)):
            while (left := self.deadline - self.clock()) > 0.0:
                time.sleep(left)
            self.deadline = max(self.deadline, self.clock() - PERIOD) + PERIOD
            self.session.tick(intents if number == 0 else ())

    def reach(self, mode: messages.Mode) -> None:
        """Walk up to a mode as an operator would, to where its motors hold the arms up."""
        self.run(3 * PERIOD)
        if mode is messages.Mode.ZERO_TORQUE:
            return
        self.run(4 * PERIOD, messages.Intent.DAMP)
        if mode is messages.Mode.DAMPING:
            return
        self.run(PERIOD, messages.Intent.LOAD_A)
        for _ in range(100):
            if not self._has_arrived():
                self.run(PERIOD)
        if mode is messages.Mode.STANDBY:
            self.run(0.2)
        else:
            self.run(
                0.3,
                messages.Intent.START_LOCOMOTION if mode is messages.Mode.LOCOMOTION else messages.Intent.START_REMOTE,
            )
        if self.session.mode is not mode:
            bad = next((status for tick in self.ticks for status in tick.safety if not status.is_ok), None)
            raise NotReachedError(bad.message if bad else self.ticks[-1].output.control_mode.status_message)

    def _has_arrived(self) -> bool:
        standby = self.ticks[-1].output.standby
        return standby is not None and standby.is_finished


@contextmanager
def driven(
    address: str,
    *,
    clock: Clock = time.monotonic,
    open_bus: Callable[[BusAddress], can.BusABC] = open_python_can,
    truth: Callable[[], MITState] | None = None,
    before_closing: Callable[[], None] = lambda: None,
    description: RobotDescription | None = None,
) -> Iterator[Drive]:
    """A robot that is activated, in ZERO_TORQUE.

    Args:
        address: of its channel.
        description: what the host takes the robot for; None: what it is.
        clock: s, the robot's.
        open_bus: opens the channel.
        truth: what is really so, if anybody knows.
        before_closing: is called before the robot is closed.
    """
    description = quick_lite() if description is None else description
    robot = HardwareRobot(
        description,
        [address],
        calibration=dict.fromkeys(description.joint_names, 0.0),
        control_period=PERIOD,
        can_timeout=CAN_TIMEOUT,
        allow_no_timeout=True,
        clock=clock,
        open_bus=open_bus,
    )
    timed = _Timed(robot, clock)
    sink, remote = _Ticks(timed, truth), _Holder(description)
    session = Session(
        timed,
        build_supervisor(description, PERIOD, sample_policy(), remote=True),
        LoopSettings(PERIOD, realtime=False),  # `Drive.run` keeps the time
        header=messages.SessionHeader("lite", description.joint_names, PERIOD, 0),
        remote=remote,
        sinks=[sink],
    )
    remote.clock = lambda: session.time
    try:
        robot.activate()
        assert robot._line is not None
        counters = robot._line.channels[0].counters
        yield Drive(description.joint_names, session, sink.all, clock, counters)
    finally:
        before_closing()
        if all(FAMILIES[joint.motor.family].has_timeout for joint in description.joints if joint.motor is not None):
            robot.close()
        else:
            with contextlib.suppress(RobotError):  # a motor that is silent, or disabled, confirms nothing
                robot.close()
