"""Put a planned run together: from here on files, sockets and a terminal are taken over."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from humanoid_sim import __version__
from humanoid_sim.evaluation.run_figures import JointUse
from humanoid_sim.frontends.launcher import FrontEnds
from humanoid_sim.messages import Event, EventKind, SafetyStatus, SessionHeader
from humanoid_sim.play.console import ConsoleSink, Told
from humanoid_sim.play.front_ends import expected_duration, has_keys, needs_gamepad
from humanoid_sim.play.judged import JudgedPolicy
from humanoid_sim.play.plan import Plan
from humanoid_sim.play.played_robot import BringUp
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.rendering.moments import Moments
from humanoid_sim.session.data_socket import DataSocket
from humanoid_sim.session.feed import MODEL_BLOB, FeedWriter
from humanoid_sim.session.intent_socket import IntentSocket
from humanoid_sim.session.keyboard import Keyboard
from humanoid_sim.session.losses import DeviceWatch, Interruption
from humanoid_sim.session.monitor import RunMonitor
from humanoid_sim.session.outside_safety import OutsideSafety, parse_watchdogs
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.registration import Registration
from humanoid_sim.session.script import Script
from humanoid_sim.session.session import Session
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import IntentSource, PolicySelection, RemoteInbox
from humanoid_sim.simulation.model import model_bytes
from humanoid_sim.simulation.push import Push
from humanoid_sim.simulation.sim_robot import SimRobot
from humanoid_sim.stack import run_header

_STANDSTILL = 0.1
"""s without a tick after which a loop that drives motors stood still: their CAN timeout."""


class Run:
    """The parts of a run, and what connects them."""

    session: Session
    feed: FeedWriter
    interruption: Interruption | None
    """Watch over the suspension of a loop that drives motors."""
    _start_time_ns = 0
    """Header's, once the run begins."""

    def __init__(self, plan: Plan, console: Console) -> None:
        """Put everything together. Intents that come from here on wait for the first tick.

        Raises `InputError` if a socket or the terminal cannot be taken over; nothing stays open then.
        """
        config, description, setup, policy = plan.config, plan.description, plan.setup, plan.policy
        self.plan, self.policy, self.config = plan, policy, config
        is_hardware = config.hardware is not None
        shown = self._watch(console)
        self.header, self._made = _header(plan), time.monotonic_ns()
        reactivation = Reactivation(lambda: _warnings(setup.bring_up))
        selection = PolicySelection()
        self.interruption = Interruption(plan.control_period, _STANDSTILL) if is_hardware else None
        self._pushes = setup.robot.pushes if isinstance(setup.robot, SimRobot) else None
        with ExitStack() as stack:
            registration = Registration.create()
            stack.callback(registration.close)
            self._outside_safety = OutsideSafety(parse_watchdogs(config.watchdog))
            push = None if self._pushes is None else self._push
            intents = IntentSocket(
                registration.path / "intents", reactivation, self._note, self._outside_safety, push, selection
            )
            stack.callback(intents.close)
            inbox = RemoteInbox(description.joint_names)
            self.data = DataSocket(
                registration.path / "data",
                inbox,
                1e-3 * description.remote_policy_controller.stale_command_timeout_ms,
                clock=plan.clock,
                velocity=plan.velocity if policy.walks else None,
                live=plan.taken,
                timeouts={
                    name: topic.timeout
                    for one in policy.contracts
                    for name, topic in one.live_topics.items()
                    if topic.timeout is not None
                },
                tell=self._note,
            )
            stack.callback(self.data.close)
            self.feed = FeedWriter(registration.path, self.header, {MODEL_BLOB: model_bytes(setup.model())}, plan.taken)
            stack.callback(self.feed.close)
            self.front_ends = FrontEnds(
                plan.front_ends,
                self.feed,
                show=lambda text: shown.event(Event(plan.clock(), text)),
                note=self._note,
                status=self._status,
                is_ending=lambda: self.session.is_ending,
                begin=self._begin,
            )
            stack.callback(self.front_ends.close)
            registration.register(
                robot=description.name,
                policy=", ".join(policy.named) or policy.source,
                hardware=config.hardware or "",
            )
            keyboard = self._keyboard(reactivation, shown)
            if keyboard is not None:
                stack.callback(keyboard.close)
            self.keyboard = keyboard
            self._open = stack.pop_all()
        sources: list[IntentSource] = [intents] if keyboard is None else [intents, keyboard]
        if self.interruption is not None:
            sources.insert(0, self.interruption)
        if is_hardware and needs_gamepad(config):
            sources.insert(0, DeviceWatch("gamepad", lambda: self.data.heartbeats, self._note))
        self.script = None
        if plan.steps is not None:
            frames = {one.name: one.motion_frames for one in policy.choices}
            self.script = Script(plan.steps, frames, selection=selection, operators=sources)
        # The last one is closed first: what the monitor finds in the last ticks still reaches the others. The
        # front ends wait in `start` until they work, and then set the header's time: those behind them get that header.
        shows = (self.feed, shown, self.front_ends, *self.recorders, self.moments, self.monitor)
        sinks = (*shows, intents, self.data)
        self.session = plan.session = Session(
            setup.robot,
            plan.supervisor,
            LoopSettings(
                plan.control_period,
                realtime=plan.realtime,
                simulated=setup.simulated,
                duration=config.duration,
                punctual=is_hardware,
            ),
            header=self.header,
            intents=sources if self.script is None else (self.script,),
            remote=inbox,
            sinks=[sink for sink in sinks if sink is not None],
            safety_filter=self._with_other_safety,
            externs=(self.data, plan.velocity),
            qpos=lambda: setup.qpos(self.session.state),
            mode_listener=setup.mode_listener,
            reactivation=reactivation,
            interruption=self.interruption,
            selection=selection,
        )

    def _push(self, vx: float, vy: float, body: str) -> None:
        robot = self.plan.setup.robot
        assert isinstance(robot, SimRobot)
        robot.pushes.add(Push(vx, vy, robot.time, body))

    def _watch(self, console: Console) -> ConsoleSink:
        """Make what shows, records and judges the run; what shows it."""
        plan, config, description, setup = self.plan, self.config, self.plan.description, self.plan.setup
        is_drawn = plan.outputs.html is not None or plan.outputs.video is not None
        self.judged = judged = JudgedPolicy.of(description, plan.policy, is_drawn=is_drawn)
        told = Told(
            has_keys=has_keys(config),
            is_driven=setup.is_driven,
            available=plan.supervisor.controllers,
            walks=plan.policy.walks,
            motion_frames=plan.policy.motion_frames,
            expected_duration=expected_duration(config, plan.steps, plan.policy.motion, description),
        )
        self.console = ConsoleSink(console, told)
        self.recorders = [] if plan.outputs.record is None else [self._recorder(plan.outputs.record)]
        """Those of a run that was reset are several; the last one records."""
        self.monitor = RunMonitor(
            JointUse(description.joint_names, description.effort_limit, description.lower, description.upper),
            judged.update,
            base=setup.base,
            tell=self._tell,
        )
        self.moments = Moments(judged.ghost) if is_drawn else None
        return self.console

    def _keyboard(self, reactivation: Reactivation, shown: ConsoleSink) -> Keyboard | None:
        """Return the keyboard, if somebody sits at it. Raises `InputError` if it cannot be taken over."""
        if not has_keys(self.config):
            return None
        return Keyboard(
            self.plan.velocity if self.policy.walks else None,
            reactivation=reactivation,
            tell=lambda text: shown.event(Event(self.plan.clock(), text)),
        )

    def _recorder(self, path: Path) -> McapRecorder:
        return McapRecorder(
            path,
            overwrite=self.config.overwrite,
            encoded=lambda record: self.feed.encoded(record),  # noqa: PLW0108 - the feed comes later
            tell=lambda text: self.session.event(text, EventKind.FAILURE),
        )

    def close(self) -> None:
        """Let go of the terminal, and of what others on the machine reach the run by. May be called twice."""
        self._open.close()

    def _begin(self, header: SessionHeader) -> SessionHeader:
        """Return the header of a run that begins now: a simulated robot's clock has stood still since it was made."""
        if self.config.hardware is None:
            waited = time.monotonic_ns() - self._made
            header = replace(header, start_time_ns=header.start_time_ns + waited)
        self.header, self._start_time_ns = header, header.start_time_ns
        return header

    def _note(self, text: str) -> None:
        """Record a line."""
        self.session.event(text)

    def _tell(self, event: Event) -> None:
        """Hand an event that a sink has found to the others."""
        moments = () if self.moments is None else (self.moments,)
        sinks: list[Sink] = [self.console, *self.recorders[-1:], self.feed, *moments]
        for sink in sinks:
            sink.event(event)

    def _status(self) -> Mapping[str, Any]:
        recorder = self.recorders[-1] if self.recorders else None
        return {
            **self.data.status(),
            "front_ends": dict(self.front_ends.running),
            "start_time_ns": self._start_time_ns,
            "robot": self.plan.setup.figures(),
            "recording": recorder and {"file": str(recorder.path.absolute()), "error": recorder.error},
            "simulation": None if self._pushes is None else {"bodies": list(self._pushes.bodies)},
        }

    def _with_other_safety(self, statuses: tuple[SafetyStatus, ...]) -> tuple[SafetyStatus, ...]:
        """Add the statuses of other programs to the robot's own; the script looks on."""
        statuses = self._outside_safety(statuses)
        if self.script is not None:
            self.script.note_safety(statuses)
        return statuses


def _warnings(bring_up: BringUp | None) -> tuple[str, ...]:
    """Return the warnings of a real robot's latest check list, one line each."""
    checks = () if bring_up is None else bring_up.checks()
    return tuple(f"{subject}: {text}" for verdict, subject, text in checks if verdict == "warning")


def _header(plan: Plan) -> SessionHeader:
    """Everything that interprets the run, and repeats it. A real robot has been prepared: its checks are part of it."""
    config, policy, bring_up = plan.config, plan.policy, plan.setup.bring_up
    since_zero = float(plan.setup.robot.read()[0].time)  # a real robot's clock runs already
    return run_header(
        plan.description,
        plan.control_period,
        policy.loaded,
        policy.motion,
        policies=policy.named,
        motions=policy.motions,
        settings={
            "program": f"humanoid_sim.play {__version__}",
            "options": asdict(config),
            **policy.settings,
            "checks": None if bring_up is None else [": ".join(check) for check in bring_up.checks()],
        },
        start_time_ns=time.time_ns() - round(1e9 * since_zero),
        remote=True,
        action_limit=config.action_limit,
    )
