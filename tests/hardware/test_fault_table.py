"""Every fault in every mode, in virtual and in real time: the flag that the operator sees, and s until DAMPING."""

import contextlib
import threading
import time
from collections import deque
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace

import can
import msgspec
import pytest
from motor_surface import mit_command, short_waits
from waiting import until

from humanoid_sim.errors import RobotError
from humanoid_sim.hardware import can_bus
from humanoid_sim.hardware.can_bus import frame_of, message_of
from humanoid_sim.hardware.mock.faults import FAULTS, Fault
from humanoid_sim.hardware.mock.motors import MockMotors
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.hardware.robot import HardwareRobot
from humanoid_sim.hardware.robstride.protocol import FrameType
from humanoid_sim.messages import Intent, Mode, RemoteCommand, SafetyFlag, TickInput
from humanoid_sim.policy.checkpoint import placeholder_checkpoint
from humanoid_sim.policy.loaded_policy import load_policy
from humanoid_sim.robots.description import load_robot
from humanoid_sim.session.realtime import punctual_threads, real_time
from humanoid_sim.stack import build_supervisor

PERIOD = 0.02
"""s, 50 Hz: the rate on hardware."""
CAN_TIMEOUT = 0.1
"""s"""
STANDSTILL = 0.3
"""s"""
AFTERWARDS = 0.08
"""s that are watched after a fault is over."""
ELBOW = ("left_elbow_pitch",)
STALL = "host stalls"
BUS_OFF, RX_TIMEOUT = SafetyFlag.BUS_OFF, SafetyFlag.RX_TIMEOUT
MOTOR_FAULT, TEMPERATURE, INVALID = SafetyFlag.MOTOR_FAULT, SafetyFlag.TEMPERATURE_LIMIT, SafetyFlag.INVALID_FRAME
CASES = {
    "silent": (Fault("silent", ELBOW), RX_TIMEOUT, 0.24),
    "late": (Fault("late", ELBOW), RX_TIMEOUT, 0.24),
    "wrong_id": (Fault("wrong_id", ELBOW), RX_TIMEOUT, 0.24),
    "power lost": (Fault("brown_out", ELBOW, value=3.0), RX_TIMEOUT, 0.24),
    "brown_out": (Fault("brown_out", ELBOW), MOTOR_FAULT, 0.04),
    "motor_fault": (Fault("motor_fault", ELBOW), MOTOR_FAULT, 0.04),
    "over_temperature": (Fault("over_temperature", ELBOW), TEMPERATURE, 0.04),
    "encoder_jump": (Fault("encoder_jump", ELBOW), MOTOR_FAULT, 0.04),
    "garbage": (Fault("garbage", ELBOW), INVALID, 0.04),
    "second_master": (Fault("second_master"), INVALID, 0.04),
    "bus_off": (Fault("bus_off"), BUS_OFF, 0.04),
    STALL: (None, MOTOR_FAULT, STANDSTILL + 0.04),
}
"""By case: the fault, its flag, and s until DAMPING at most."""
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
    quick = msgspec.structs.replace(standby, segment_durations=(0.06,), pose_segments=(pose,))
    return msgspec.structs.replace(robot, standby_controller_a=quick, initial_position=pose)


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
                return message_of(arrival.frame, arrival.time), False
            self._is_idle.set()
        time.sleep(0.0002)
        return None, False

    def advance(self, duration):
        """Let time pass, and the robot receive what comes of it."""
        with self._lock:
            self._received.extend(self.mock.advance(self.mock.time + duration))
            self._is_idle.clear()
        assert self._is_idle.wait(60.0)


@dataclass(frozen=True)
class Tick:
    time: float
    """s, the robot's clock."""
    flags: SafetyFlag
    is_ok: bool
    mode: Mode
    messages: tuple[str, ...]


class Rig:
    """A robot, its motors and the loop; nothing waits for a clock, so that no machine is too slow."""

    def __init__(self):
        self.mock = MockMotors(lite())
        self.bus = VirtualBus(self.mock)
        self._assemble(lambda: self.mock.time, lambda _: self.bus)

    def _assemble(self, clock, open_bus):
        description = lite()
        self.robot = HardwareRobot(
            description,
            ["virtual:faults"],
            calibration=dict.fromkeys(description.joint_names, 0.0),
            control_period=PERIOD,
            can_timeout=CAN_TIMEOUT,
            clock=clock,
            open_bus=open_bus,
        )
        checkpoint = placeholder_checkpoint(description)
        policy = load_policy(checkpoint.contract, checkpoint.policy, None)
        self._supervisor = build_supervisor(description, PERIOD, policy, remote=True)
        self._memory = self._supervisor.initial()

    def __enter__(self):
        self.robot.activate()
        self.bus.runs = False
        return self

    def __exit__(self, *_):
        self.bus.runs = True
        self._close()
        self.bus.shutdown()

    def _close(self):
        self.call(lambda mock: mock.clear_faults())
        with contextlib.suppress(RobotError):  # a motor that is silent confirms nothing
            self.robot.close()

    def call(self, action):
        action(self.mock)

    def wait(self, duration):
        self.bus.advance(duration)

    def write(self, command):
        sent = self.bus.attempts
        self.robot.write(command)
        until(lambda: self.bus.attempts >= sent + len(self.robot.joints))

    def tick(self, *intents):
        """One turn of the loop, a period after the last."""
        self.wait(PERIOD)
        state, safety = self.robot.read()
        remote = RemoteCommand(mit_command(lite().initial_position, 50.0, 2.0), float(state.time))
        self._memory, output = self._supervisor.step(self._memory, TickInput(state, safety, intents, remote))
        self.write(output.command)
        flags = SafetyFlag.NONE
        for status in safety:
            flags |= status.flags
        words = tuple(status.message for status in safety)
        return Tick(float(state.time), flags, all(one.is_ok for one in safety), output.control_mode.mode, words)

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
        self.call(lambda mock: mock.inject(replace(fault, start=mock.time + 0.007)))
        return began

    def is_harmless(self, only=()):
        """Whether no motor that still has power pulls anywhere; `only`: of these joints."""
        drives = []

        def look(mock):
            motors = zip(mock.names, mock.motors, mock.has_power, strict=True)
            drives.extend(motor.drive() for name, motor, power in motors if power and (not only or name in only))

        self.call(look)
        return not any(drive.stiffness > 0.0 or drive.effort != 0.0 for drive in drives)


class RealRig(Rig):
    """In real time, with motors on a thread of their own, as `play --hardware virtual:mock` has them."""

    def __init__(self):
        self._measures, self._deadline = contextlib.ExitStack(), 0.0
        with punctual_threads(behind=10):
            motors = self._measures.enter_context(MockServer(lite(), ["virtual:faults"]))
        self._measures.enter_context(real_time())
        self.call = motors.call
        self._assemble(motors.clock, can_bus.open_bus)

    def __enter__(self):
        self.robot.activate()
        return self

    def __exit__(self, *_):
        self._close()
        self._measures.close()

    def wait(self, duration):
        self._deadline = max(self._deadline, time.monotonic() - PERIOD) + duration
        time.sleep(max(self._deadline - time.monotonic(), 0.0))

    def write(self, command):
        self.robot.write(command)


@pytest.fixture
def virtual(monkeypatch):
    short_waits(monkeypatch, answers=0.3, listening=0.005)
    rig = Rig()
    stamps = SimpleNamespace(time=lambda: rig.mock.time, monotonic=time.monotonic, sleep=time.sleep)
    monkeypatch.setattr(can_bus, "time", stamps)
    with rig:
        yield rig


@pytest.fixture(params=["virtual", pytest.param("real", marks=pytest.mark.soak)])
def rig(request):
    if request.param == "virtual":
        yield request.getfixturevalue("virtual")
        return
    with RealRig() as rig:
        yield rig


def test_every_fault_has_a_case():
    kinds = {fault.kind for fault, _, _ in CASES.values() if fault is not None}
    assert kinds == set(FAULTS) - {"stuck"}, "a stuck joint has no flag: its motion alone shows it"


@pytest.mark.parametrize("mode", Mode, ids=lambda mode: mode.name)
@pytest.mark.parametrize("name", CASES)
def test_a_fault_ends_in_damping(name, mode, rig):
    fault, flag, longest = CASES[name]
    harmless = Mode.ZERO_TORQUE if mode is Mode.ZERO_TORQUE else Mode.DAMPING
    rig.reach(mode)
    assert rig.is_harmless() == (mode is harmless), "there is something to fall"
    began = rig.robot.time
    if fault is None:
        rig.wait(STANDSTILL)
    else:
        began = rig.inject(replace(fault, duration=longest))
    ticks = [rig.tick() for _ in range(round((longest + AFTERWARDS) / PERIOD))]
    detected = next((tick for tick in ticks if not tick.is_ok), None)
    assert detected is not None, "never noticed"
    assert flag in detected.flags
    assert detected.time - began <= longest
    assert {tick.mode for tick in ticks[ticks.index(detected) :]} == {harmless}, "from this tick on"
    assert rig.is_harmless(), "the motors as well"
    refused = rig.tick(Intent.LOAD_A)
    assert refused.mode is harmless or refused.is_ok


@pytest.mark.parametrize("name", ["wrong_id", "bus_off"])
def test_motors_that_no_command_reaches_stop_by_their_own_timeout(name, rig):
    fault = CASES[name][0]
    rig.reach(Mode.STANDBY)
    rig.inject(fault)
    for _ in range(round(CAN_TIMEOUT / PERIOD) + 2):
        rig.tick()
    assert rig.is_harmless(fault.joints)


def test_a_few_lost_frames_are_tolerated(rig):
    rig.reach(Mode.LOCOMOTION)
    rig.inject(Fault("silent", value=0.1))
    ticks = [rig.tick() for _ in range(25)]
    assert all(tick.is_ok for tick in ticks), [tick.messages for tick in ticks if not tick.is_ok]
    assert {tick.mode for tick in ticks} == {Mode.LOCOMOTION}


def test_a_clear_that_is_lost_is_sent_again_though_reports_of_an_earlier_run_go_on(virtual, monkeypatch):
    clears = []

    def lossy(message, timeout=None):
        kind, motor = message.arbitration_id >> 24, message.arbitration_id & 0xFF
        is_clear = kind == FrameType.STOP and motor == 14 and message.data[:1] == b"\x01"
        if is_clear:
            clears.append(message)
        if kind != FrameType.ACTIVE_REPORT and not (is_clear and len(clears) == 1):
            send(message, timeout)

    virtual.reach(Mode.DAMPING)
    virtual.inject(Fault("motor_fault", ELBOW, duration=0.01))
    assert not [virtual.tick(), virtual.tick()][-1].is_ok
    send, virtual.bus.runs = virtual.bus.send, True
    monkeypatch.setattr(virtual.bus, "send", lossy)
    virtual.robot.activate()
    assert "had faults, cleared: " in "".join(virtual.robot.checks.of("warning"))
