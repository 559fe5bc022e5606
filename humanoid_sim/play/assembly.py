"""Put a planned run together: from here on files, sockets and a terminal are taken over."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

from rich.console import Console

from humanoid_sim import __version__
from humanoid_sim.controllers.fsm import MODES
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.errors import InputError
from humanoid_sim.evaluation.joint_use import JointUse
from humanoid_sim.frontends.launcher import FrontEnds
from humanoid_sim.messages import Event, EventKind, Mode, SafetyStatus, SessionHeader
from humanoid_sim.mit import MITState
from humanoid_sim.play.console import ConsoleSink, Told
from humanoid_sim.play.front_ends import has_keys, needs_gamepad
from humanoid_sim.play.loading import JudgedPolicy, PolicyLoader
from humanoid_sim.play.options import PlayConfig
from humanoid_sim.play.plan import Plan, expected_duration
from humanoid_sim.play.played_robot import BringUp
from humanoid_sim.play.policies import PolicyChoice
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.recording.shadow import ShadowStep, ShadowTopics, encode_shadow_step, shadow_documents, shadow_width
from humanoid_sim.rendering.video import VideoSink
from humanoid_sim.session.data_socket import DataSocket
from humanoid_sim.session.feed import MODEL_BLOB, FeedWriter
from humanoid_sim.session.intent_socket import IntentSocket
from humanoid_sim.session.keyboard import Keyboard
from humanoid_sim.session.loading import Loading
from humanoid_sim.session.losses import DeviceWatch, Interruption
from humanoid_sim.session.monitor import RunMonitor
from humanoid_sim.session.outside_safety import OutsideSafety, parse_watchdogs
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.recorded_inputs import RecordedInputs
from humanoid_sim.session.registration import Registration
from humanoid_sim.session.script import OverriddenScript, Planned, Script
from humanoid_sim.session.session import SafetyFilter, Session
from humanoid_sim.session.shadow import ShadowSink
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import ExternSource, IntentSource, RemoteInbox
from humanoid_sim.simulation.gravity import LeverSamples
from humanoid_sim.simulation.model import model_bytes
from humanoid_sim.stack import run_header


class LocalEnds:
    """Open from here on: intents that come before the first tick wait for it."""

    def __init__(
        self,
        plan: Plan,
        header: SessionHeader,
        reactivation: Reactivation,
        loading: Loading | None,
        *,
        show: Callable[[str], None],
        note: Callable[[str], None],
        is_ending: Callable[[], bool],
    ) -> None:
        """Open the sockets, make the feed, and let others find the session.

        Args:
            reactivation: what `reactivate` asks for.
            loading: what `load` asks for; None where no policy can be loaded.
            show: shows operators a line.
            note: records a line.
            is_ending: whether the session need not begin any more.

        Raises:
            InputError: if one of them cannot be had; nothing stays open then.
        """
        self._plan = plan
        self.shadow_figures: Callable[[], Mapping[str, Any]] | None = None
        """Figures of a shadow policy; None without one."""
        description, policy = plan.description, plan.policy
        with ExitStack() as stack:
            registration = Registration()
            stack.callback(registration.close)
            self.safety = OutsideSafety(parse_watchdogs(plan.config.watchdog))
            self.intents = IntentSocket(registration.intents, reactivation, note, self.safety, loading)
            stack.callback(self.intents.close)
            self.inbox = RemoteInbox(description.joint_names, plan.clock)
            self.data = DataSocket(
                registration.data,
                self.inbox,
                1e-3 * description.remote_policy_controller.stale_command_timeout_ms,
                clock=plan.clock,
                velocity=plan.velocity if policy.walks else None,
                live=plan.taken,
                timeouts=None if policy.contract is None else policy.contract.live_timeouts,
                tell=note,
            )
            stack.callback(self.data.close)
            width = 0 if plan.shadow is None or policy.loaded is None else shadow_width(policy.loaded)
            blobs = {MODEL_BLOB: model_bytes(plan.setup.model())}
            self.feed = FeedWriter(header, blobs, plan.taken, shadow_width=width)
            stack.callback(self.feed.close)
            self.front_ends = FrontEnds(
                plan.front_ends, self.feed, show=show, note=note, status=self._status, is_ending=is_ending
            )
            stack.callback(self.front_ends.close)
            registration.register(
                robot=description.name,
                policy=f"{'' if plan.shadow is None else 'shadow '}{policy.source}",
                hardware=plan.config.hardware or "",
                feed=self.feed.path,
            )
            self.rename_policy = registration.rename_policy
            self._close = stack.pop_all()

    def close(self) -> None:
        """Close whatever is still open. May be called twice."""
        self._close.close()

    def _status(self) -> Mapping[str, Any]:
        return {
            **self.data.status(),
            "front_ends": dict(self.front_ends.running),
            "robot": self._plan.setup.figures(),
            "shadow": None if self.shadow_figures is None else dict(self.shadow_figures()),
        }


_STANDSTILL = 0.1
"""s without a tick after which a loop that drives motors stood still: their CAN timeout."""


@dataclass(slots=True)
class Run:
    """The parts of a run that its program needs afterwards."""

    plan: Plan
    session: Session
    monitor: RunMonitor
    console: ConsoleSink
    ends: LocalEnds
    policy: PolicyChoice
    """Policy that was loaded last."""
    config: PlayConfig
    """Options, with those of that policy."""
    judged: JudgedPolicy
    keyboard: Keyboard | None = None
    recorder: McapRecorder | None = None
    video: VideoSink | None = None
    shadow: ShadowSink | None = None
    script: Planned | None = None
    interruption: Interruption | None = None
    """Watch over the suspension of a loop that drives motors."""

    def follow(self, policy: PolicyChoice, config: PlayConfig, judged: JudgedPolicy) -> None:
        """Have what watches the run watch another policy; between two ticks, on the control thread."""
        self.policy, self.config, self.judged = policy, config, judged
        self.monitor.follow(judged.tracking, judged.anchor, judged.keys)
        self.console.follow(
            replace(
                self.console.told,
                available=self.session.controllers,
                walks=policy.walks,
                motion_frames=policy.motion_frames,
            )
        )
        if self.keyboard is not None:
            self.keyboard.velocity = self.plan.velocity if policy.walks else None
        if isinstance(self.script, Script):
            self.script.motion_frames = policy.motion_frames
        if self.video is not None:
            self.video.follow(judged.ghost, judged.goals)

    def close(self) -> None:
        """Let go of the terminal, and of what others on the machine reach the run by."""
        if self.keyboard is not None:
            self.keyboard.close()
        self.ends.close()


def assemble(plan: Plan, console: Console) -> Run:
    """Everything for one run.

    Raises:
        InputError: if the control socket or the terminal cannot be taken over.
    """
    config, description, policy, setup = plan.config, plan.description, plan.policy, plan.setup
    is_shadow = plan.shadow is not None
    is_drawn = plan.outputs.video is not None
    judged = JudgedPolicy() if is_shadow else JudgedPolicy.of(description, policy, is_drawn=is_drawn)
    told = Told(
        has_keys=has_keys(config),
        is_driven=setup.is_driven,
        available=plan.supervisor.controllers,
        walks=policy.walks,
        motion_frames=0 if is_shadow else policy.motion_frames,
        expected_duration=expected_duration(config, policy, description),
    )
    shown = ConsoleSink(console, told)
    recorder = None
    if plan.outputs.record is not None:
        recorder = McapRecorder(
            plan.outputs.record,
            overwrite=config.overwrite,
            encoded=lambda record: ends.feed.encoded(record),  # noqa: PLW0108 - there is no feed yet
            tell=lambda text: session.event(text, EventKind.FAILURE),
        )
    monitor = RunMonitor(
        JointUse(description.joint_names, description.effort_limit, description.lower, description.upper),
        judged.tracking,
        anchor=judged.anchor,
        base=setup.base,
        keys=judged.keys,
        tell=lambda event: _tell(event, shown, recorder, ends.feed),
    )
    video = None
    if plan.outputs.video is not None:
        video = VideoSink(plan.outputs.video, setup.model, ghost=judged.ghost, goals=judged.goals)
    header = _header(plan)
    reactivation = Reactivation(lambda: _warnings(setup.bring_up))
    loader = PolicyLoader(plan, header)
    loading = None if is_shadow else Loading(loader.prepare, loader.cancel)
    ends = LocalEnds(
        plan,
        header,
        reactivation,
        loading,
        show=lambda text: shown.event(Event(plan.clock(), text)),
        note=lambda text: session.event(text),  # noqa: PLW0108 - there is no session yet
        is_ending=lambda: session.is_ending,
    )
    shadow = None if plan.shadow is None else _shadow(plan, plan.shadow, header, shown, recorder, ends)
    try:
        keyboard = _keyboard(plan, reactivation, shown)
    except InputError:
        ends.close()
        raise
    operators = (ends.intents,) if keyboard is None else (ends.intents, keyboard)
    # The last one is closed first: what monitor and shadow find in the last ticks still reaches the others.
    chosen = (ends.feed, shown, recorder, video, monitor, shadow, ends.intents, ends.data, loading, ends.front_ends)
    sinks: list[Sink] = [sink for sink in chosen if sink is not None]
    script: Planned | None = None if plan.steps is None else Script(plan.steps, policy.motion_frames)
    inputs = None if plan.branch is None else plan.branch.inputs
    if inputs is not None and script is None and not config.manual:
        script = inputs
    is_hardware = config.hardware is not None
    interruption = Interruption(plan.control_period, _STANDSTILL) if is_hardware else None
    watched: list[IntentSource] = []
    if is_hardware and needs_gamepad(config):
        watched.append(DeviceWatch("gamepad", lambda: ends.data.heartbeats, lambda text: session.event(text)))  # noqa: PLW0108
    if interruption is not None:
        watched.append(interruption)
    sources = (*watched, *operators)
    intents, safety = _drive(sources, script, _filter(plan, inputs, ends))
    session = Session(
        setup.robot,
        plan.supervisor,
        LoopSettings(
            plan.control_period,
            realtime=plan.realtime,
            simulated=setup.simulated,
            duration=config.duration,
            punctual=is_hardware,
        ),
        header=header,
        intents=intents,
        remote=plan.injector.remote(ends.inbox if inputs is None else inputs.remote(ends.inbox)),
        sinks=sinks,
        safety_filter=safety,
        externs=_externs(plan, ends),
        qpos=lambda: setup.qpos(session.state),
        mode_listener=setup.mode_listener,
        reactivation=reactivation,
        loading=loading,
        interruption=interruption,
        memory=None if plan.branch is None else plan.branch.memory,
    )
    plan.clock.session = session
    loader.run = run = Run(
        plan,
        session,
        monitor,
        shown,
        ends,
        policy,
        config,
        judged,
        keyboard,
        recorder,
        video,
        shadow,
        script,
        interruption,
    )
    return run


def _externs(plan: Plan, ends: LocalEnds) -> tuple[ExternSource, ...]:
    """Live inputs of other programs, the velocity command, and what a recorded run took in."""
    own: tuple[ExternSource, ...] = (ends.data, plan.velocity)
    if plan.setup.levers is not None:
        own = (*own, LeverSamples(plan.setup.levers, plan.control_period, partial(_held_state, plan)))
    return own if plan.branch is None else (*own, plan.branch.inputs)


def _held_state(plan: Plan) -> MITState | None:
    """Return the state of a robot in STANDBY; None in any other mode."""
    session = plan.clock.session
    is_held = session is not None and MODES[session.memory.controller] is Mode.STANDBY
    return session.state if session is not None and is_held else None


def _filter(plan: Plan, inputs: RecordedInputs | None, ends: LocalEnds) -> SafetyFilter:
    """Add recorded safety statuses, those of other programs, and injected ones to the robot's own."""
    if inputs is None:
        return lambda statuses: plan.injector.safety(ends.safety(statuses))
    return lambda statuses: plan.injector.safety(ends.safety(inputs.safety(statuses)))


def _tell(event: Event, *sinks: Sink | None) -> None:
    """Hand an event that a sink has found to some others."""
    for sink in sinks:
        if sink is not None:
            sink.event(event)


def _warnings(bring_up: BringUp | None) -> tuple[str, ...]:
    """Return the warnings of a real robot's latest check list, one line each."""
    checks = () if bring_up is None else bring_up.checks()
    return tuple(f"{subject}: {text}" for verdict, subject, text in checks if verdict == "warning")


def _shadow(
    plan: Plan,
    controller: RLPolicyController,
    header: SessionHeader,
    shown: ConsoleSink,
    recorder: McapRecorder | None,
    ends: LocalEnds,
) -> ShadowSink:
    """Return the sink in which a shadow policy runs, and where its steps go."""
    topics = ShadowTopics(header)

    def publish(step: ShadowStep) -> None:
        encoded = encode_shadow_step(step)
        ends.feed.shadow(encoded)
        if recorder is not None:
            recorder.beside(step.time, tuple(topics.messages(step, encoded)))

    sink = ShadowSink(
        controller,
        plan.policy.source,
        plan.description.effort_limit,
        realtime=plan.realtime,
        publish=publish,
        tell=lambda event: _tell(event, shown, recorder, ends.feed),
    )
    ends.shadow_figures = sink.figures
    return sink


def _header(plan: Plan) -> SessionHeader:
    """Everything that interprets the run, and repeats it. A real robot has been prepared: its checks are part of it."""
    config, policy, bring_up = plan.config, plan.policy, plan.setup.bring_up
    nothing = dict.fromkeys(policy.settings)
    is_shadow = plan.shadow is not None
    since_zero = float(plan.setup.robot.read()[0].time)  # a real robot's clock runs already
    header = run_header(
        plan.description,
        plan.control_period,
        None if is_shadow else policy.loaded,
        None if is_shadow else policy.motion,
        settings={
            "program": f"humanoid_sim.play {__version__}",
            "options": asdict(config),
            **(nothing if is_shadow else policy.settings),
            "checks": None if bring_up is None else [": ".join(check) for check in bring_up.checks()],
        },
        start_time_ns=time.time_ns() - round(1e9 * since_zero),
        start=None if plan.branch is None else plan.branch.memory,
        remote=not is_shadow,
        loads=not is_shadow,
        action_limit=config.action_limit,
        signs=None if plan.supervisor.signs is None else plan.supervisor.signs.allowed,
    )
    if not is_shadow or policy.checkpoint is None or policy.loaded is None:
        return header
    motion = policy.settings["motion"]
    beside = shadow_documents(policy.checkpoint.source, policy.checkpoint.sha256, motion, policy.loaded)
    return replace(header, documents={**header.documents, **beside})


def _keyboard(plan: Plan, reactivation: Reactivation, shown: ConsoleSink) -> Keyboard | None:
    """Return the keyboard, if somebody sits at it. Raises `InputError` if it cannot be taken over."""
    if not has_keys(plan.config):
        return None
    velocity = plan.velocity if plan.policy.walks else None
    return Keyboard(velocity, reactivation=reactivation, tell=lambda text: shown.event(Event(plan.clock(), text)))


def _drive(
    operators: Sequence[IntentSource], script: Planned | None, safety: SafetyFilter
) -> tuple[tuple[IntentSource, ...], SafetyFilter]:
    """Return the sources of intents, and the safety filter with the script, if there is one, looking on."""
    if script is None:
        return tuple(operators), safety

    def watched(statuses: tuple[SafetyStatus, ...]) -> tuple[SafetyStatus, ...]:
        filtered = safety(statuses)
        script.note_safety(filtered)
        return filtered

    return (OverriddenScript(script, operators),), watched
