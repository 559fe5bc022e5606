"""Build everything that a run of `play` consists of, and check it before anything moves."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from rich.console import Console

from humanoid_sim.controllers.action import resolve_action
from humanoid_sim.controllers.context import EXTERN_WIDTHS, VELOCITY_COMMAND
from humanoid_sim.play.config import PlayConfig
from humanoid_sim.play.console import ConsoleSink
from humanoid_sim.play.header import session_header
from humanoid_sim.play.operators import Operator, drive, keys_of, open_operators
from humanoid_sim.play.options import Outputs, choose_outputs, control_rate, refuse_conflicts
from humanoid_sim.play.policies import PolicyChoice, choose_policy
from humanoid_sim.play.robot_parts import RobotParts
from humanoid_sim.play.schedule import automatic_script, expected_duration
from humanoid_sim.play.simulated import simulated_robot
from humanoid_sim.policy.readers.sources import assumptions
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.rendering.backend import has_display
from humanoid_sim.rendering.native_viewer import NativeViewerSink
from humanoid_sim.rendering.video import VideoSink
from humanoid_sim.robots.contract_gains import with_contract
from humanoid_sim.robots.description import RobotDescription, load_robot
from humanoid_sim.session.anchor_errors import AnchorErrors
from humanoid_sim.session.gravity_source import GravitySource
from humanoid_sim.session.inject import Injector, parse_injections
from humanoid_sim.session.monitor import RunMonitor
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.remote import RemoteInbox
from humanoid_sim.session.script import Script, parse_script
from humanoid_sim.session.session import LoopSettings, Session
from humanoid_sim.session.sink import Sink
from humanoid_sim.session.sources import RemoteSource
from humanoid_sim.session.velocity import VelocityCommand, parse_velocity
from humanoid_sim.stack import build_supervisor
from humanoid_sim.tracking import TrackingErrors

__all__ = ["Run", "assemble"]


@dataclass(slots=True)
class Run:
    """The parts of a run that its program needs afterwards."""

    description: RobotDescription
    parts: RobotParts
    session: Session
    monitor: RunMonitor
    console: ConsoleSink
    outputs: Outputs
    policy: PolicyChoice
    control_period: float
    realtime: bool
    tracking: TrackingErrors | None = None
    anchor: AnchorErrors | None = None
    recorder: McapRecorder | None = None
    video: VideoSink | None = None
    operators: tuple[Operator, ...] = ()
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
    contract = policy.loaded.contract
    if Path(config.robot).suffix.lower() == ".xml":
        description = with_contract(description, contract)
    control_period, notice = control_rate(config, description, contract.policy_dt)
    use_remote = config.remote != "none"
    parts = simulated_robot(config, description, control_period, contract.anchor_body)
    supervisor = build_supervisor(
        description,
        control_period,
        policy.loaded,
        remote=use_remote,
        live={**parts.live, VELOCITY_COMMAND: EXTERN_WIDTHS[VELOCITY_COMMAND]},
        action_limit=config.action_limit,
    )
    gains = resolve_action(contract, description.joint_names)
    warning = parts.check_gains(gains.stiffness, gains.damping)
    golden = f"golden vectors: {policy.checkpoint.golden}" if policy.checkpoint.golden else ""
    realtime = _realtime(config, use_remote)

    frames = 0 if policy.motion is None else len(policy.motion.frames)
    if steps is None and not config.manual:
        steps = parse_script(automatic_script(config, frames))
    tracking, anchor = _errors(policy, description)
    monitor = RunMonitor(description.effort_limit, tracking, anchor=anchor, floating_base=description.is_floating)
    velocity = VelocityCommand(parse_velocity(config.command, contract.command_ranges), contract.command_ranges)
    shown = ConsoleSink(console, expected_duration(config, policy, description))
    sinks: list[Sink] = [monitor, shown]

    remote: RemoteSource | None = None
    gravity = None
    if use_remote:
        inbox = RemoteInbox(description.joint_names, clock)
        gravity = GravitySource(description, inbox, config.gravity_form)
        sinks.append(gravity)
        remote = injector.remote(inbox)
    header = session_header(config, description, policy, control_period, use_remote)
    # From here on there are files, sockets and a terminal taken over: whatever can fail has been tried above.
    outputs = choose_outputs(config)
    recorder = None if outputs.record is None else McapRecorder(outputs.record)
    video = None if outputs.video is None else VideoSink(outputs.video, parts.model)
    sinks += [sink for sink in (recorder, video) if sink is not None]
    if config.viewer == "native" or (config.viewer == "auto" and has_display()):
        sinks.append(NativeViewerSink(parts.model))

    reactivation = Reactivation()
    operators = open_operators(
        config.manual, velocity if policy.walks else None, reactivation, lambda text: shown.event(clock(), text)
    )
    script = None if steps is None else Script(steps, frames)
    intents, safety = drive(operators, script, injector.safety)
    session = Session(
        parts.robot,
        supervisor,
        LoopSettings(control_period, realtime=realtime, simulated=parts.simulated, duration=config.duration),
        header=header,
        intents=intents,
        remote=remote,
        sinks=sinks,
        safety_filter=safety,
        externs=(velocity,) if policy.walks else (),
        qpos=parts.qpos,
        mode_listener=parts.mode_listener,
        reactivation=reactivation,
    )
    clock.session = session
    keys = keys_of(config.manual, walks=policy.walks)
    return Run(
        description,
        parts,
        session,
        monitor,
        shown,
        outputs,
        policy,
        control_period,
        realtime,
        tracking,
        anchor,
        recorder,
        video,
        operators,
        gravity,
        [text for text in (notice, *parts.notices, warning, *assumptions(contract), golden, *keys) if text],
    )


def _errors(policy: PolicyChoice, description: RobotDescription) -> tuple[TrackingErrors | None, AnchorErrors | None]:
    """What measures how well a motion is followed: poses of bodies in the base frame, or joints and an anchor."""
    tracking = anchor = None
    reference, contract = policy.loaded.reference, policy.loaded.contract
    if "motion_body_pos_b" in reference.terms and policy.motion is not None:
        tracking = TrackingErrors(description, policy.motion.frames, contract.body_names, contract.policy_dt)
    if "anchor_pos" in reference.terms:
        anchor = AnchorErrors(reference, contract.joint_names, description.joint_names, align=contract.align_reference)
    return tracking, anchor


def _realtime(config: PlayConfig, use_remote: bool) -> bool:
    """Whether somebody, or a thread that lives in real time, takes part."""
    if config.pace != "auto":
        return config.pace == "realtime"
    return config.manual or use_remote or config.viewer == "native" or (config.viewer == "auto" and has_display())
