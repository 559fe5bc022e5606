"""Put a planned run together: from here on files, sockets and a terminal are taken over."""

from __future__ import annotations

from dataclasses import dataclass

from rich.console import Console

from humanoid_sim.evaluation.tracking import AnchorErrors, TrackingErrors
from humanoid_sim.messages import Event
from humanoid_sim.play.console import ConsoleSink
from humanoid_sim.play.header import session_header
from humanoid_sim.play.operators import Operator, drive, open_operators
from humanoid_sim.play.plan import Plan
from humanoid_sim.play.policies import PolicyChoice
from humanoid_sim.play.robot_parts import BringUp
from humanoid_sim.play.schedule import expected_duration
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.rendering.native_viewer import NativeViewerSink
from humanoid_sim.rendering.video import VideoSink
from humanoid_sim.robots.description import RobotDescription
from humanoid_sim.session.gravity_source import GravitySource
from humanoid_sim.session.monitor import RunMonitor
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.script import Script
from humanoid_sim.session.session import Session
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import RemoteInbox, RemoteSource

__all__ = ["Run", "assemble"]


@dataclass(slots=True)
class Run:
    """The parts of a run that its program needs afterwards."""

    plan: Plan
    session: Session
    monitor: RunMonitor
    console: ConsoleSink
    operators: tuple[Operator, ...]
    tracking: TrackingErrors | None = None
    anchor: AnchorErrors | None = None
    recorder: McapRecorder | None = None
    video: VideoSink | None = None
    gravity: GravitySource | None = None


def assemble(plan: Plan, console: Console) -> Run:
    """Everything for one run.

    Raises:
        InputError: if the control socket or the terminal cannot be taken over.
    """
    config, description, policy, parts = plan.config, plan.description, plan.policy, plan.parts
    tracking, anchor = _errors(policy, description)
    monitor = RunMonitor(
        description.effort_limit, tracking, anchor=anchor, floating_base=description.is_floating and parts.simulated
    )
    shown = ConsoleSink(console, expected_duration(config, policy, description))
    recorder = None if plan.outputs.record is None else McapRecorder(plan.outputs.record)
    video = None if plan.outputs.video is None else VideoSink(plan.outputs.video, parts.model)
    gravity, remote = _remote(plan)
    viewer = NativeViewerSink(parts.model) if plan.shows_window else None
    sinks: list[Sink] = [sink for sink in (monitor, shown, gravity, recorder, video, viewer) if sink is not None]

    reactivation = Reactivation(lambda: _warnings(parts.bring_up))
    operators = open_operators(
        config.manual,
        plan.velocity if policy.walks else None,
        reactivation,
        lambda text: shown.event(Event(plan.clock(), text)),
    )
    script = None if plan.steps is None else Script(plan.steps, plan.motion_frames)
    intents, safety = drive(operators, script, plan.injector.safety)
    session = Session(
        parts.robot,
        plan.supervisor,
        LoopSettings(
            plan.control_period,
            realtime=plan.realtime,
            simulated=parts.simulated,
            duration=config.duration,
            punctual=config.hardware is not None,
        ),
        header=session_header(plan),
        intents=intents,
        remote=remote,
        sinks=sinks,
        safety_filter=safety,
        externs=(plan.velocity,) if policy.walks else (),
        qpos=lambda: parts.qpos(session.state),
        mode_listener=parts.mode_listener,
        reactivation=reactivation,
    )
    plan.clock.session = session
    return Run(plan, session, monitor, shown, operators, tracking, anchor, recorder, video, gravity)


def _warnings(bring_up: BringUp | None) -> tuple[str, ...]:
    """The warnings of a real robot's latest check list, one line each."""
    checks = () if bring_up is None else bring_up.checks()
    return tuple(f"{subject}: {text}" for verdict, subject, text in checks if verdict == "warning")


def _remote(plan: Plan) -> tuple[GravitySource | None, RemoteSource | None]:
    """Who sends remote commands, and where they come in."""
    if plan.config.remote == "none":
        return None, None
    inbox = RemoteInbox(plan.description.joint_names, plan.clock)
    return GravitySource(plan.description, inbox, plan.config.gravity_form), plan.injector.remote(inbox)


def _errors(policy: PolicyChoice, description: RobotDescription) -> tuple[TrackingErrors | None, AnchorErrors | None]:
    """What measures how well a motion is followed: poses of bodies in the base frame, or joints and an anchor."""
    tracking = anchor = None
    reference, contract = policy.loaded.reference, policy.loaded.contract
    if "motion_body_pos_b" in reference.terms and policy.motion is not None:
        tracking = TrackingErrors(description, policy.motion.frames, contract.body_names, contract.policy_dt)
    if "anchor_pos" in reference.terms:
        anchor = AnchorErrors(reference, contract.joint_names, description.joint_names, align=contract.align_reference)
    return tracking, anchor
