"""A robot, its supervisor and mock motors on one channel, tick by tick, in virtual time or in real time."""

import contextlib
import dataclasses
import threading
import time
from collections import deque
from dataclasses import dataclass
from functools import cache

import can
import numpy as np
from msgspec.structs import replace

from humanoid_sim.assets import SAMPLE_POLICY, asset_path
from humanoid_sim.errors import RobotError
from humanoid_sim.hardware.can_bus import frame_of, message_of, open_bus
from humanoid_sim.hardware.mock.motors import MockMotors
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.robot import HardwareRobot
from humanoid_sim.messages import Intent, Mode, RemoteCommand, SafetyFlag, TickInput
from humanoid_sim.mit import MITCommand
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.realtime import punctual_threads, real_time
from humanoid_sim.stack import build_supervisor

PERIOD = 0.02
"""s, 50 Hz: the rate on hardware."""
CAN_TIMEOUT = 0.1
"""s"""
WALK = {
    Mode.ZERO_TORQUE: (),
    Mode.DAMPING: (Intent.DAMP,),
    Mode.STANDBY: (Intent.DAMP, Intent.LOAD_A),
    Mode.LOCOMOTION: (Intent.DAMP, Intent.LOAD_A, Intent.START_LOCOMOTION),
    Mode.REMOTE: (Intent.DAMP, Intent.LOAD_A, Intent.START_REMOTE),
}


@cache
def lite():
    """The robot, which begins in its standby pose."""
    robot = load_robot("lite")
    standby = robot.standby_controller_a
    pose = standby.pose_segments[-1]
    quick = replace(standby, segment_durations=(0.06,), pose_segments=(pose,))
    return replace(robot, standby_controller_a=quick, initial_position=pose)


@cache
def supervisor():
    checkpoint = load_checkpoint(SAMPLE_POLICY)
    motion = read_motion(asset_path("motions", "circle.mcap"))
    policy = load_policy(checkpoint.contract, checkpoint.policy, motion, checkpoint.observation_width)
    return build_supervisor(lite(), PERIOD, policy, remote=True)


@dataclass(frozen=True)
class Tick:
    time: float
    """s, the robot's clock."""
    flags: SafetyFlag
    is_ok: bool
    mode: Mode
    messages: tuple[str, ...]


class VirtualBus(can.BusABC):
    """The computer's end of a channel. While `runs`, a ms passes with every poll; else as much as the test says."""

    def __init__(self, mock):
        super().__init__("mock")
        self.mock, self.runs, self.attempts = mock, True, 0
        self._received = deque()
        self._lock, self._is_idle = threading.Lock(), threading.Event()

    def send(self, msg, timeout=None):
        with self._lock:
            self.attempts += 1
            self.mock.submit(0, frame_of(msg), self.mock.time)

    def _recv_internal(self, timeout):
        with self._lock:
            if not self._received and self.runs:
                self._received.extend(self.mock.advance(self.mock.time + 0.001))
            if self._received:
                arrival = self._received.popleft()
                age = self.mock.time - arrival.time
                return message_of(arrival.frame, time.time() - age), False
            self._is_idle.set()
        time.sleep(0.0002)
        return None, False

    def advance(self, duration):
        """Let time pass, and the robot receive what comes of it."""
        with self._lock:
            self._received.extend(self.mock.advance(self.mock.time + duration))
            self._is_idle.clear()
        assert self._is_idle.wait(10.0)

    def until_sent(self, attempts):
        """Wait until so many frames were handed over."""
        deadline = time.monotonic() + 10.0
        while self.attempts < attempts:
            assert time.monotonic() < deadline, "commands do not leave"
            time.sleep(0.0001)


class Rig:
    """A robot that is activated, in ZERO_TORQUE; what its motors do, and the loop."""

    def __init__(self, clock, opens):
        description = lite()
        self.robot = HardwareRobot(
            description,
            ["virtual:faults"],
            calibration=dict.fromkeys(description.joint_names, 0.0),
            control_period=PERIOD,
            can_timeout=CAN_TIMEOUT,
            allow_no_timeout=True,
            clock=clock,
            open_bus=opens,
        )
        self._step = supervisor().step
        self._memory = supervisor().initial()
        n, pose = description.joint_count, np.array(description.standby_controller_a.pose_segments[-1])
        self._hold = MITCommand(pose, np.zeros(n), np.zeros(n), np.full(n, 50.0), np.full(n, 2.0))

    def __enter__(self):
        self.robot.activate()
        return self

    def __exit__(self, *_):
        self.call(lambda mock: mock.clear_faults())
        with contextlib.suppress(RobotError):  # a motor that is silent confirms nothing
            self.robot.close()

    def tick(self, *intents):
        """One turn of the loop, a period after the last."""
        self.wait(PERIOD)
        state, safety = self.robot.read()
        remote = RemoteCommand(self._hold, float(state.time))
        self._memory, output = self._step(self._memory, TickInput(state, safety, intents, remote))
        self.write(output.command)
        flags = SafetyFlag.NONE
        for status in safety:
            flags |= status.flags
        words = tuple(status.message for status in safety)
        mode = output.control_mode.mode
        return Tick(float(state.time), flags, all(status.is_ok for status in safety), mode, words)

    def reach(self, mode):
        """Walk up to a mode as an operator would, to where its motors hold the arms up."""
        for _ in range(2):
            tick = self.tick()
        for intent in WALK[mode]:
            tick = self.tick(intent)
            for _ in range(5 if intent is Intent.LOAD_A else 2):
                tick = self.tick()
                assert tick.is_ok, tick.messages
        assert tick.mode is mode

    def inject(self, fault):
        """Let a fault begin within the next period; returns when, s, robot's clock."""
        began = self.robot.time + 0.007
        self.call(lambda mock: mock.inject(dataclasses.replace(fault, start=mock.time + 0.007)))
        return began

    def is_harmless(self, only=()):
        """Whether no motor that still has power pulls anywhere; `only`: of these joints."""
        drives = []

        def look(mock):
            motors = zip(mock.names, mock.motors, mock.has_power, strict=True)
            drives.extend(motor.drive() for name, motor, power in motors if power and (not only or name in only))

        self.call(look)
        return not any(drive.stiffness > 0.0 or drive.effort != 0.0 for drive in drives)


class VirtualRig(Rig):
    """In virtual time: nothing waits for a clock, so that no machine is too slow."""

    def __init__(self):
        self.mock = MockMotors(lite())
        self.bus = VirtualBus(self.mock)
        super().__init__(lambda: self.mock.time, lambda _: self.bus)

    def __enter__(self):
        super().__enter__()
        self.bus.runs = False
        return self

    def __exit__(self, *_):
        self.bus.runs = True
        super().__exit__()
        self.bus.shutdown()

    def wait(self, duration):
        self.bus.advance(duration)

    def write(self, command):
        sent = self.bus.attempts
        self.robot.write(command)
        self.bus.until_sent(sent + len(self.robot.joints))

    def call(self, action):
        action(self.mock)


class RealRig(Rig):
    """In real time, with motors on a thread of their own, as `play --hardware virtual:lite` has them."""

    def __init__(self):
        self._measures = contextlib.ExitStack()
        with punctual_threads(behind=10):
            self._motors = self._measures.enter_context(MockServer(lite(), ["virtual:faults"]))
        self._measures.enter_context(real_time())
        super().__init__(self._motors.clock, open_bus)
        self.call, self._deadline = self._motors.call, 0.0

    def __exit__(self, *_):
        super().__exit__()
        self._measures.close()

    def wait(self, duration):
        self._deadline = max(self._deadline, time.monotonic() - PERIOD) + duration
        time.sleep(max(self._deadline - time.monotonic(), 0.0))

    def write(self, command):
        self.robot.write(command)
