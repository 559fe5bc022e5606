"""A whole run against emulated motors: real adapter, session and supervisor, and everything written down."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache

import can
import numpy as np
from msgspec.structs import replace

from humanoid_sim.assets import asset_path
from humanoid_sim.hardware.bus.address import BusAddress
from humanoid_sim.hardware.emulation.virtual import VirtualMotors
from humanoid_sim.hardware.robot.robot import RobstrideRobot
from humanoid_sim.messages import Intent, Mode, RemoteCommand, SafetyFlag, SafetyStatus, TickOutput
from humanoid_sim.mit import FloatArray, MITCommand, MITState
from humanoid_sim.play.options import SAMPLE_POLICY
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.policy.onnx_policy import load_checkpoint
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.robots.schema import StandbySettings
from humanoid_sim.session.session import LoopSettings, Session
from humanoid_sim.session.sink import SessionHeader, TickRecord
from humanoid_sim.stack import LoadedPolicy, build_supervisor, load_policy

PERIOD = 0.02
"""s, 50 Hz: the rate on hardware."""
CAN_TIMEOUT = 0.1
"""s"""


def quick_lite() -> RobotDescription:
    """The Lite, at its standby pose within a second."""
    lite = load_robot("lite")
    return replace(lite, standby_controller_a=_quick(lite.standby_controller_a))


def _quick(standby: StandbySettings) -> StandbySettings:
    return replace(standby, segment_durations=(0.8,), pose_segments=standby.pose_segments[-1:])


@cache
def sample_policy() -> LoadedPolicy:
    checkpoint = load_checkpoint(SAMPLE_POLICY)
    motion = read_motion(asset_path("motions", "circle.mcap"))
    return load_policy(checkpoint.contract, checkpoint.policy, motion, checkpoint.observation_width)


Clock = Callable[[], float]


class NotReachedError(Exception):
    """The robot did not get to the mode in which the fault was to happen."""


@dataclass(frozen=True)
class Sent:
    """One operation control frame that was handed to the driver."""

    time: float
    """s, the robot's slow clock."""
    motor_id: int
    has_stiffness: bool
    has_damping: bool
    is_refused: bool
    """The driver did not take it."""


class WatchedBus(can.BusABC):
    """Writes down the commands that are handed to the driver."""

    def __init__(self, bus: can.BusABC, log: list[Sent], clock: Clock) -> None:
        self._bus, self._log, self._clock = bus, log, clock
        super().__init__(bus.channel_info)
        self.channel_info = bus.channel_info

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        is_refused = True
        begin = self._clock()
        try:
            self._bus.send(msg, timeout)
            is_refused = False
        finally:
            if msg.arbitration_id >> 24 == 1:
                stiffness, damping = msg.data[4:6], msg.data[6:8]
                self._log.append(Sent(begin, msg.arbitration_id & 0xFF, any(stiffness), any(damping), is_refused))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self._bus._recv_internal(timeout)

    def shutdown(self) -> None:
        super().shutdown()
        self._bus.shutdown()


@dataclass(frozen=True)
class Tick:
    """What one turn of the loop saw, decided and found to be true."""

    read: float
    """s, slow clock, when the state was read."""
    safety: tuple[SafetyStatus, ...]
    output: TickOutput
    seen: float
    """s, slow clock, of the truth that follows."""
    effort: FloatArray
    """Shape (n,), N·m: the true torques towards the end of the turn."""
    velocity: FloatArray
    """Shape (n,), rad/s: the true velocities then."""

    @property
    def mode(self) -> Mode:
        return self.output.control_mode.mode

    @property
    def flags(self) -> SafetyFlag:
        flags = SafetyFlag.NONE
        for status in self.safety:
            flags |= status.flags
        return flags

    @property
    def is_ok(self) -> bool:
        return all(status.is_ok for status in self.safety)


class _Timed:
    """A robot that notes when it was read."""

    def __init__(self, robot: RobstrideRobot, clock: Clock) -> None:
        self.robot = robot
        self._clock = clock
        self.joints = robot.joints
        self.read_at = 0.0

    def activate(self) -> None:
        self.robot.activate()

    def read(self) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        self.read_at = self._clock()
        return self.robot.read()

    def write(self, command: MITCommand) -> None:
        self.robot.write(command)

    def close(self) -> None:
        self.robot.close()


class _Ticks:
    """A sink that keeps every tick."""

    backlog = 0

    def __init__(self, robot: _Timed, motors: VirtualMotors) -> None:
        self._robot, self._motors = robot, motors
        self.all: list[Tick] = []

    def start(self, header: SessionHeader) -> None:
        return

    def tick(self, record: TickRecord) -> None:
        truth = self._motors.truth
        read, safety = self._robot.read_at, record.input.safety
        self.all.append(Tick(read, safety, record.output, truth.time, truth.joint_effort, truth.joint_velocity))

    def event(self, time: float, text: str) -> None:
        return

    def close(self) -> None:
        return


class _Holder:
    """A remote source that is never late: hold the pose in which it was first asked."""

    def __init__(self, description: RobotDescription) -> None:
        n = description.joint_count
        pose = np.array(description.standby_controller_a.pose_segments[-1])
        self._command = MITCommand(pose, np.zeros(n), np.zeros(n), np.full(n, 50.0), np.full(n, 2.0))
        self.clock: Callable[[], float] = lambda: 0.0

    def latest(self) -> RemoteCommand:
        return RemoteCommand(self._command, self.clock())


@dataclass
class Campaign:
    """A running robot; `ticks` and `sent` grow as it goes."""

    motors: VirtualMotors
    robot: _Timed
    session: Session
    ticks: list[Tick]
    sent: list[Sent]
    events: list[tuple[float, str]]
    """What happened to the motors: s, slow clock, and a line."""
    clock: Clock
    deadline: float = 0.0
    """s, slow clock, of the next tick."""

    def run(self, seconds: float, *intents: Intent) -> None:
        """Ticks for a time; the intents go with the first."""
        for number in range(max(round(seconds / PERIOD), 1)):
            while (left := self.deadline - self.clock()) > 0.0:
                time.sleep(left)
            self.deadline = max(self.deadline, self.clock() - PERIOD) + PERIOD
            self.session.tick(intents if number == 0 else ())

    def reach(self, mode: Mode) -> None:
        """Walk up to a mode as an operator would, into the middle of its motion."""
        self.run(3 * PERIOD)
        if mode is Mode.ZERO_TORQUE:
            return
        self.run(4 * PERIOD, Intent.DAMP)
        if mode is Mode.DAMPING:
            return
        self.run(0.4, Intent.LOAD_A)
        if mode is not Mode.STANDBY:
            for _ in range(100):
                if not self._has_arrived():
                    self.run(PERIOD)
            self.run(0.3, Intent.START_LOCOMOTION if mode is Mode.LOCOMOTION else Intent.START_REMOTE)
        if self.session.mode is not mode:
            raise NotReachedError(self.ticks[-1].output.control_mode.status_message)

    def _has_arrived(self) -> bool:
        standby = self.ticks[-1].output.standby
        return standby is not None and standby.is_finished


@contextmanager
def campaign(slowness: float = 1.0, address: str = "virtual:campaign") -> Iterator[Campaign]:
    """Emulated motors, activated and in ZERO_TORQUE, on one channel; all of it in slow motion by that factor."""
    description = quick_lite()
    sent: list[Sent] = []
    events: list[tuple[float, str]] = []

    def clock() -> float:
        return time.monotonic() / slowness

    begin = clock()
    with VirtualMotors(
        description, [address], told=lambda when, text: events.append((begin + when, text)), clock=clock
    ) as motors:
        begin = clock() - motors.time

        def open_watched(channel: BusAddress) -> can.BusABC:
            return WatchedBus(motors.open_bus(channel), sent, clock)

        robot = _Timed(
            RobstrideRobot(
                description,
                [address],
                calibration=dict.fromkeys(description.joint_names, 0.0),
                control_period=PERIOD,
                can_timeout=CAN_TIMEOUT,
                clock=clock,
                open_bus=open_watched,
            ),
            clock,
        )
        sink = _Ticks(robot, motors)
        remote = _Holder(description)
        session = Session(
            robot,
            build_supervisor(description, PERIOD, sample_policy(), remote=True),
            LoopSettings(PERIOD, realtime=False),  # `Campaign.run` keeps the time
            header=SessionHeader("lite", description.joint_names, PERIOD, 0),
            remote=remote,
            sinks=[sink],
        )
        remote.clock = lambda: session.time
        try:
            robot.activate()
            yield Campaign(motors, robot, session, sink.all, sent, events, clock)
        finally:
            motors.clear_faults()  # so that the robot can be closed, and the motors confirm it
            robot.robot.close()
