"""The only place where these tests touch names of the product; a rewrite changes this file and no test."""

import io
import json
import os
import socket
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from humanoid_sim import messages as frozen
from humanoid_sim import replay as replay_program
from humanoid_sim.assets import asset_path
from humanoid_sim.cli import run_program
from humanoid_sim.client import Intake, SessionInfo
from humanoid_sim.controllers.base import Fault, Memory
from humanoid_sim.controllers.contract import PolicyContract, Term
from humanoid_sim.controllers.damping import DampingController, ZeroTorqueController
from humanoid_sim.controllers.guards import Guards
from humanoid_sim.controllers.reference import no_reference
from humanoid_sim.controllers.remote_policy import RemotePolicyController
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.standby import StandbyController
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.errors import FieldError, InputError
from humanoid_sim.hardware import calibration
from humanoid_sim.messages import SessionHeader, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.play import main as play_main
from humanoid_sim.policy.readers.own import GOLDEN_KEY as TRAINER_SAMPLES
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.robots.description import load_robot
from humanoid_sim.ros2 import messages as wire
from humanoid_sim.ros2.dds.endpoints import dds_topic, dds_type
from humanoid_sim.ros2.topics import TICK_TOPIC, TOPICS, joint_states_topic, topic_kind
from humanoid_sim.session.data_socket import DataSocket
from humanoid_sim.session.intent_socket import IntentSocket
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.session import Session
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import VelocityCommand

__all__ = ["TICK_TOPIC", "TRAINER_SAMPLES"]

INPUT_ERRORS = (FieldError, InputError)
"""Exceptions for what a user gave."""


# The pure part.


@dataclass(frozen=True)
class StackConfig:
    """Parameters of a control stack."""

    joints: tuple[str, ...]
    period: float  # s between two ticks
    damping: Mapping[str, float]  # K_d of DAMPING, by joint
    poses: Mapping[str, Mapping[str, float]]  # Last pose of `a` and `b`, rad, by joint; the first is all zeros
    segment_duration: float  # s of each of the two segments of a pose
    standby_gains: tuple[float, float]
    passive_damping: float  # K_d of REMOTE without commands
    policy: Callable[[np.ndarray, int], Any]  # Observation and frame to action
    contract: Mapping[str, Any]  # A checkpoint's, by the keys of its metadata
    live: Mapping[str, int]  # Name and width of live inputs that the policy observes behind its other terms
    stale_command_policy: str = "passive"
    is_floating: bool = False
    guards: Mapping[str, Any] | None = None  # Bounds of the guards, one number for all joints; None: no guards
    replaced: Mapping[str, Any] | None = None  # Controllers of `controller` in place of the product's, by name


def supervisor(config: StackConfig) -> Any:
    """Make the control stack."""
    joints, n, keys = config.joints, len(config.joints), dict(config.contract)
    observation = [*keys.pop("observation_names"), *(Term(name, width=width) for name, width in config.live.items())]
    contract, extern = PolicyContract(**keys, observation=observation), {"velocity_command": 3, **config.live}
    stiffness, damping = config.standby_gains
    controllers: dict[str, Any] = {
        "zero_torque_controller": ZeroTorqueController(joints),
        "damping_controller": DampingController(joints, damping=np.array([config.damping[name] for name in joints])),
        "rl_policy_controller": RLPolicyController(
            joints, contract, no_reference(), config.policy, config.period, extern=extern
        ),
        "remote_policy_controller": RemotePolicyController(
            joints,
            np.full(n, config.passive_damping),
            stale_command_policy=config.stale_command_policy,
            needs_producer=config.is_floating,
        ),
    }
    for name, pose in config.poses.items():
        controllers[f"standby_controller_{name}"] = StandbyController(
            joints,
            target_stiffness=np.full(n, stiffness),
            target_damping=np.full(n, damping),
            segment_durations=np.full(2, config.segment_duration),
            pose_segments=[[0.0] * n, [pose[joint] for joint in joints]],
        )
    controllers.update(config.replaced or {})
    return Supervisor(joints, controllers, guards=_guards(config))


def _guards(config: StackConfig) -> Guards | None:
    if config.guards is None:
        return None
    times = ("following_time", "following_progress", "limit_time", "speed_time")
    given = {name: value for name, value in config.guards.items() if name != "effort_limit"}  # no guard's
    bounds = {name: value if name in times else np.full(len(config.joints), value) for name, value in given.items()}
    return Guards(config.joints, **bounds)


def initial(stack: Any) -> Any:
    """Return the memory before the first tick."""
    return stack.initial()


def step(stack: Any, memory: Any, tick_input: TickInput) -> tuple[Any, TickOutput]:
    """One tick of the pure function."""
    return stack.step(memory, tick_input)  # type: ignore[no-any-return]


@dataclass(frozen=True, eq=False)
class _Controller:
    """A controller from outside the product."""

    joints: tuple[str, ...]
    on_activate: Callable[[TickInput], Any]
    on_update: Callable[[TickInput], Any]

    def activate(self, tick_input: TickInput) -> Any:
        self.on_activate(tick_input)
        return Memory()

    def update(self, memory: Any, tick_input: TickInput) -> Any:
        answer = self.on_update(tick_input)
        return answer if isinstance(answer, Fault) else (memory, answer)


def controller(
    name: str,
    joints: Sequence[str],
    update: Callable[[TickInput], MITCommand],
    activate: Callable[[TickInput], None] = lambda _: None,
) -> Any:
    """Make a controller for `StackConfig.replaced` whose command is what `update` returns; both may raise."""
    return _Controller(tuple(joints), activate, update)


def fault(reason: str) -> Any:
    """What a controller returns in place of a command where it knows that it has failed."""
    return Fault(reason)


# The link: a session's two sockets, and the programs at their other ends.


@dataclass
class _Robot:
    """Stands still; its clock is the number of its ticks."""

    joints: tuple[str, ...]
    read_at: Callable[[float], MITState]
    time: float = 0.0

    def activate(self) -> None:
        return

    def read(self) -> tuple[MITState, tuple[frozen.SafetyStatus, ...]]:
        return self.read_at(self.time), ()

    def write(self, command: MITCommand) -> None:
        return

    def close(self) -> None:
        return


class _Last(Sink):
    record: TickRecord

    def tick(self, record: TickRecord) -> None:
        self.record = record


class Link:
    """A session with both of its sockets, driven tick by tick; others send half a period after the latest tick."""

    def __init__(self, config: StackConfig, read_at: Callable[[float], MITState]) -> None:
        joints, period = config.joints, config.period
        self.refusals: list[str] = []  # Reasons of refusals by the session itself, before the supervisor sees anything
        self._period = period
        self._now = 1000.0  # s, CLOCK_MONOTONIC
        self._robot = _Robot(joints, read_at)
        self._open = ExitStack()
        folder = Path(self._open.enter_context(tempfile.TemporaryDirectory(prefix="hs-")))
        self._open.enter_context(mock.patch("time.clock_gettime_ns", side_effect=lambda _: self._stamp(0.0)))
        self._paths = paths = [folder / "intents", folder / "data"]
        velocity = VelocityCommand(np.zeros(3))
        tell = self.refusals.append
        intents = IntentSocket(paths[0], tell=tell)
        self._open.callback(intents.close)
        data = DataSocket(paths[1], joints, 0.1, clock=lambda: self._robot.time, velocity=velocity, tell=tell)
        self._open.callback(data.close)
        self._last = _Last()
        self._session = Session(
            self._robot,
            supervisor(config),
            LoopSettings(period, realtime=False),
            header=SessionHeader("three", joints, period, 0),
            intents=(intents,),
            remote=lambda: data.remote,
            externs=(data, velocity),
            sinks=(intents, data, self._last),
        )
        info = SessionInfo(process=1, robot="", policy="", folder="", hardware="", path=folder)
        self._intake = self._open.enter_context(Intake(info, "producer"))

    def close(self) -> None:
        self._open.close()

    def _stamp(self, age: float) -> int:
        return round(1e9 * (self._now - age))

    def tick(self) -> TickRecord:
        """One turn of the loop."""
        self._robot.time += self._period
        self._now += 0.5 * self._period
        self._session.tick()
        self._now += 0.5 * self._period
        return self._last.record

    def send(self, word: str, *, age: float = 0.0, sender: str = "operator") -> bool:
        """Send an intent that was meant `age` s ago; False if the socket is full."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as end:
            try:
                end.sendto(f"{word}\n{sender}\n1\n{self._stamp(age)}".encode(), str(self._paths[0]))
            except BlockingIOError:
                return False
        return True

    def send_remote(self, joint_names: Sequence[str], command: MITCommand, *, age: float = 0.0) -> None:
        """Send a remote command that was made `age` s ago."""
        fields = (command.position, command.velocity, command.effort, command.stiffness, command.damping)
        self._intake.remote(joint_names, *(values.tolist() for values in fields), stamp=self._stamp(age))

    def send_velocity(self, vx: float, vy: float, wz: float, *, age: float = 0.0) -> None:
        """Send a velocity command that somebody just gave."""
        self._intake.velocity(vx, vy, wz, deliberate=True, stamp=self._stamp(age))


@contextmanager
def link(config: StackConfig, read_at: Callable[[float], MITState]) -> Iterator[Link]:
    """Run a session with this stack on a robot whose state at a time is `read_at`'s."""
    opened = Link(config, read_at)
    try:
        yield opened
    finally:
        opened.close()


# The wire.


def encode(message: Any, time_ns: int, names: tuple[str, ...] = ()) -> bytes:
    """Return the CDR message of a frozen type; an `MITState` is its JointState, an array a Float32MultiArray."""
    if isinstance(message, MITState):
        measured = message.joint_position, message.joint_velocity, message.joint_effort
        return wire.encode_joint_state(time_ns, names, *measured)
    if isinstance(message, MITCommand):
        return wire.encode_mit_command(time_ns, names, message)
    if isinstance(message, np.ndarray):
        return wire.encode_float32_array(message)
    encoders: dict[type, Callable[[int, Any], bytes]] = {
        frozen.ControlMode: wire.encode_control_mode,
        frozen.StandbyState: wire.encode_standby_state,
        frozen.SafetyStatus: wire.encode_safety_status,
    }
    return encoders[type(message)](time_ns, message)


def encode_imu(state: MITState, time_ns: int) -> bytes:
    """Return the CDR message of a state's IMU."""
    return wire.encode_imu(time_ns, state)


def topics(robot: str) -> dict[str, tuple[str, int, bool]]:
    """Return type, depth and durability (True: transient local) of a robot's topics; all are reliable."""
    return {name: topic_kind(name) for name in (*TOPICS, joint_states_topic(robot), "/piano/key_state")}


def dds_names(topic: str, kind: str) -> tuple[str, str]:
    """Return topic and type as DDS knows them."""
    return dds_topic(topic), dds_type(kind)


# Runs and their recordings.


def play(*options: str) -> int:
    """Run the command line of `play` in this process, without viewers, as fast as it goes; its exit status."""
    with tempfile.TemporaryDirectory(prefix="hs-") as folder, mock.patch.dict(os.environ, {"XDG_RUNTIME_DIR": folder}):
        return run_program(play_main, [*options, "--viewer", "none", "--video", "none", "--pace", "fast"])


@dataclass(frozen=True)
class Replayed:
    """Result of a replay."""

    is_identical: bool
    ticks: int  # Ticks that were the same
    first_tick: int | None  # The first that differs
    is_complete: bool | None


def replay(path: Path) -> Replayed:
    """Feed a recording's inputs through `step` again."""
    found, status = _replay_program(path)
    assert found["identical"] == (status == 0)
    return Replayed(status == 0, found["ticks"], found["tick"], found["complete"])


def replay_policy(path: Path, policy: Path) -> Replayed:
    """Compare what a policy would have commanded on the recorded states with what was commanded."""
    found, status = _replay_program(path, "--policy", str(policy))
    times = [joint["first_time"] for joint in found["joints"] if joint["first_time"] is not None]
    period = open_recording(path).header.control_period
    return Replayed(status == 0, found["ticks"], round(min(times) / period) if times else None, None)


def _replay_program(path: Path, *options: str) -> tuple[dict[str, Any], int]:
    with redirect_stdout(io.StringIO()) as out:
        status = run_program(replay_program.main, [str(path), "--json", *options])
    return json.loads(out.getvalue()), status


def recorded_ticks(path: Path) -> list[TickRecord]:
    """Return the ticks of a recording, up to where it ends or is damaged."""
    return list(open_recording(path).ticks())


def start_recording(path: Path, like: Path) -> McapRecorder:
    """Begin a recording with the header of another one: `tick` takes a record, `close` ends it."""
    recorder = McapRecorder(path)
    recorder.start(open_recording(like).header)
    return recorder


def shipped_policy(name: str) -> Path:
    """Return the ONNX file of a policy that ships with the product."""
    return asset_path("policies", f"{name}.onnx")


# Files.


def load_calibration(path: Path, robot: str) -> tuple[dict[str, tuple[int, int, float]], dict[str, float]]:
    """Return id, direction and homing offset of each entry, and the offsets of the robot's joints, rad."""
    description = load_robot(robot)
    loaded = calibration.load_calibration(path, description)
    entries = {name: (entry.id, entry.direction, entry.homing_offset) for name, entry in loaded.entries.items()}
    return entries, loaded.homing_offsets(description)
