"""Build everything that a run of `play` consists of, and check it before anything moves."""

from __future__ import annotations

import platform
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field

import mujoco
import numpy as np
from rich.console import Console

from humanoid_sim import __version__
from humanoid_sim.controllers.action import resolve_action
from humanoid_sim.errors import InputError
from humanoid_sim.play.config import PlayConfig
from humanoid_sim.play.console import ConsoleSink
from humanoid_sim.play.options import Outputs, choose_outputs, control_rate, refuse_conflicts
from humanoid_sim.play.policies import PolicyChoice, choose_policy
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.rendering.backend import has_display
from humanoid_sim.rendering.native_viewer import NativeViewerSink
from humanoid_sim.rendering.video import VideoSink
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.session.control_socket import ControlSocket
from humanoid_sim.session.gravity_source import GravitySource
from humanoid_sim.session.inject import Injector, parse_injections
from humanoid_sim.session.keyboard import Keyboard, key_help
from humanoid_sim.session.monitor import RunMonitor
from humanoid_sim.session.remote import RemoteInbox
from humanoid_sim.session.script import OverriddenScript, Script, parse_script
from humanoid_sim.session.session import LoopSettings, Session
from humanoid_sim.session.sink import SessionHeader, Sink
from humanoid_sim.session.sources import IntentSource, RemoteSource
from humanoid_sim.simulation.model import build_model
from humanoid_sim.simulation.mujoco_robot import MujocoRobot
from humanoid_sim.stack import MOTION_ATTACHMENT, build_supervisor, header_documents
from humanoid_sim.tracking import TrackingErrors

__all__ = ["Run", "assemble"]

_PLACEHOLDER_SECONDS = 5.0
"""s that a policy without a motion runs when nothing else ends the run."""


@dataclass(slots=True)
class Run:
    """The parts of a run that its program needs afterwards."""

    description: RobotDescription
    robot: MujocoRobot
    session: Session
    monitor: RunMonitor
    outputs: Outputs
    policy: PolicyChoice
    control_period: float
    realtime: bool
    tracking: TrackingErrors | None = None
    recorder: McapRecorder | None = None
    video: VideoSink | None = None
    operators: tuple[Keyboard | ControlSocket, ...] = ()
    gravity: GravitySource | None = None
    notices: list[str] = field(default_factory=list)


class _Clock:
    """The robot's clock, once there is a session to ask; parts that the session is made of need it before."""

    session: Session | None = None

    def __call__(self) -> float:
        return self.session.time if self.session is not None else 0.0


def assemble(config: PlayConfig, console: Console) -> Run:
    """Everything for one run.

    Raises:
        InputError: the first thing that is wrong, before anything moves.
    """
    injections = parse_injections(config.inject)
    steps = None if config.script is None else parse_script(config.script)
    refuse_conflicts(config, steps or (), injections)
    description = load_robot(config.robot)
    clock = _Clock()
    injector = Injector(injections, clock)
    policy = choose_policy(config, description, injector.policy)
    control_period, notice = control_rate(config, description, policy.checkpoint.contract.policy_dt)
    use_remote = config.remote != "none"
    supervisor = build_supervisor(description, control_period, policy.loaded, remote=use_remote)
    robot = MujocoRobot(
        description,
        control_period=control_period,
        physics_timestep=config.physics_timestep,
        actuation=config.actuation,
        command_delay=config.command_delay,
        state_delay=config.state_delay,
        state_sampling=config.state_sampling,
    )
    gains = resolve_action(policy.loaded.contract, description.joint_names)
    warnings = [*robot.warnings, robot.stability.check(gains.damping, "policy")]
    realtime = _realtime(config, use_remote)

    frames = 0 if policy.motion is None else len(policy.motion.frames)
    if steps is None and not config.manual:
        steps = parse_script(_automatic(config, frames))
    tracking = None
    if policy.motion is not None and policy.checkpoint.contract.task_type == "tracking":
        contract = policy.checkpoint.contract
        tracking = TrackingErrors(description, policy.motion.frames, contract.body_names, contract.policy_dt)
    monitor = RunMonitor(description.effort_limit, tracking)
    sinks: list[Sink] = [monitor, ConsoleSink(console, _expected(config, policy, description))]

    remote: RemoteSource | None = None
    gravity = None
    if use_remote:
        inbox = RemoteInbox(description.joint_names, clock)
        gravity = GravitySource(description, inbox, config.gravity_form)
        sinks.append(gravity)
        remote = injector.remote(inbox)
    header = _header(config, description, policy, control_period, use_remote)
    # From here on there are files, sockets and a terminal taken over: whatever can fail has been tried above.
    outputs = choose_outputs(config)
    recorder = None if outputs.record is None else McapRecorder(outputs.record)
    video = None if outputs.video is None else VideoSink(outputs.video, _scene(description))
    sinks += [sink for sink in (recorder, video) if sink is not None]
    if config.viewer == "native" or (config.viewer == "auto" and has_display()):
        sinks.append(NativeViewerSink(_scene(description)))

    operators = _operators(config)
    intents: Sequence[IntentSource] = operators
    if steps is not None:
        intents = (OverriddenScript(Script(steps, frames), operators),)
    session = Session(
        robot,
        supervisor,
        LoopSettings(control_period, realtime=realtime, simulated=True, duration=config.duration),
        header=header,
        intents=intents,
        remote=remote,
        sinks=sinks,
        safety_filter=injector.safety,
        qpos=lambda: robot.qpos,
    )
    clock.session = session
    return Run(
        description,
        robot,
        session,
        monitor,
        outputs,
        policy,
        control_period,
        realtime,
        tracking,
        recorder,
        video,
        operators,
        gravity,
        [text for text in (notice, *warnings, key_help() if config.manual else "") if text],
    )


def _operators(config: PlayConfig) -> tuple[Keyboard | ControlSocket, ...]:
    socket = ControlSocket()
    if not config.manual:
        return (socket,)
    try:
        return socket, Keyboard()
    except InputError:
        socket.close()
        raise


def _realtime(config: PlayConfig, use_remote: bool) -> bool:
    """Whether somebody, or a thread that lives in real time, takes part."""
    if config.pace != "auto":
        return config.pace == "realtime"
    return config.manual or use_remote or config.viewer == "native" or (config.viewer == "auto" and has_display())


def _automatic(config: PlayConfig, frames: int) -> str:
    """The script that plays when nobody drives: long enough in each mode to see it."""
    run = "motion; hold 0.5" if frames else f"hold {config.duration or _PLACEHOLDER_SECONDS}"
    start = "start_remote" if config.remote != "none" else "start_locomotion"
    run = f"hold {config.duration or _PLACEHOLDER_SECONDS}" if config.remote != "none" else run
    return f"hold 0.5; damp; hold 1; load_{config.pose}; wait; hold 0.2; {start}; {run}; damp; hold 1"


def _expected(config: PlayConfig, policy: PolicyChoice, description: RobotDescription) -> float | None:
    """About how long the run takes, s on the robot's clock; None if only its driver knows."""
    if config.duration is not None:
        return config.duration
    if config.manual or config.script is not None:
        return None
    standby = description.standby_controller_a if config.pose == "a" else description.standby_controller_b
    motion = _PLACEHOLDER_SECONDS if policy.motion is None or config.remote != "none" else policy.motion.duration
    return 0.5 + 1.0 + sum(standby.segment_durations) + 0.2 + motion + 0.5 + 1.0


def _scene(description: RobotDescription) -> Callable[[], mujoco.MjModel]:
    """Makes models for viewers: each draws with its own, so that none can touch the robot's."""
    return lambda: build_model(description)


def _header(
    config: PlayConfig, description: RobotDescription, policy: PolicyChoice, control_period: float, use_remote: bool
) -> SessionHeader:
    settings: dict[str, object] = {
        "program": f"humanoid_sim.play {__version__}",
        "options": asdict(config),
        "policy": policy.checkpoint.source,
        "policy_sha256": policy.checkpoint.sha256,
        "motion": None if policy.motion_file is None else str(policy.motion_file),
        "versions": {"python": sys.version.split()[0], "mujoco": mujoco.__version__, "numpy": np.__version__},
        "platform": platform.platform(),
    }
    attachments = {} if policy.motion_file is None else {MOTION_ATTACHMENT: policy.motion_file.read_bytes()}
    layout = policy.loaded.layout
    return SessionHeader(
        robot=description.name,
        joint_names=description.joint_names,
        control_period=control_period,
        start_time_ns=time.time_ns(),
        documents=header_documents(description, policy.loaded, remote=use_remote, settings=settings),
        attachments=attachments,
        observation_terms=tuple((term.name, term.width) for term in layout.terms),
    )
