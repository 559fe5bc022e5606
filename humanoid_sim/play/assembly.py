"""Put a planned run together: from here on files, sockets and a terminal are taken over."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from dataclasses import asdict
from typing import Any

from rich.console import Console

from humanoid_sim import __version__
from humanoid_sim.evaluation.run_figures import MotionFigures, RunFigures
from humanoid_sim.frontends.launcher import FrontEnds
from humanoid_sim.messages import Event, EventKind, SafetyStatus, TickRecord
from humanoid_sim.play.console import ConsoleSink
from humanoid_sim.play.plan import Plan
from humanoid_sim.recording.recorder import McapRecorder
from humanoid_sim.recording.sink import Sink, WorkerSink
from humanoid_sim.rendering.ghost import ReferenceGhost
from humanoid_sim.rendering.poses import Poses
from humanoid_sim.session.data_socket import DataSocket
from humanoid_sim.session.feed import MODEL_BLOB, FeedWriter
from humanoid_sim.session.intent_socket import IntentSocket
from humanoid_sim.session.keyboard import Keyboard
from humanoid_sim.session.losses import DeviceWatch, Interruption
from humanoid_sim.session.outside_safety import OutsideSafety
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.registration import Registration
from humanoid_sim.session.requests import Requests
from humanoid_sim.session.script import Script
from humanoid_sim.session.session import Session
from humanoid_sim.session.sources import IntentSource
from humanoid_sim.simulation.model import model_bytes
from humanoid_sim.simulation.sim_robot import SimRobot
from humanoid_sim.stack import run_header

_STANDSTILL = 0.1  # s without a tick after which a loop that drives motors stood still: their CAN timeout


class Monitor(WorkerSink):
    """Keeps the figures of the final table, and tells of a fall when it happens."""

    def __init__(self, figures: RunFigures, tell: Callable[[Event], None], *, inline: bool) -> None:
        super().__init__("monitor", inline=inline)
        self.figures, self._tell = figures, tell

    def handle_tick(self, record: TickRecord) -> None:
        fell = self.figures.tick(record)
        if fell:
            self._tell(Event(self.figures.time, fell, EventKind.FALL))

    def handle_event(self, event: Event) -> None:
        self.figures.event(event)


class Run:
    """The parts of a run, and what connects them."""

    def __init__(self, plan: Plan, console: Console) -> None:
        """Put everything together. Intents that come from here on wait for the first tick.

        Raises `InputError` if a socket or the terminal cannot be taken over; nothing stays open then.
        """
        config, setup, policies = plan.config, plan.setup, plan.policies
        self.plan = plan
        self._sim = setup.robot if isinstance(setup.robot, SimRobot) else None
        self._outside_safety = OutsideSafety(plan.watchdogs)
        requests = Requests(setup.warnings)
        since_zero = float(setup.robot.read()[0].time)  # a real robot's clock runs already
        header = run_header(
            plan.description,
            plan.control_period,
            policies.loaded,
            settings={
                "program": f"humanoid_sim.play {__version__}",
                "options": asdict(config),
                **policies.settings,
                "checks": [": ".join(check) for check in setup.checks()],  # a real robot has been prepared
            },
            start_time_ns=time.time_ns() - round(1e9 * since_zero),
            remote=True,
        )
        with ExitStack() as stack:
            registration = stack.enter_context(closing(Registration()))
            folder, push = registration.path, None if self._sim is None else self._sim.push
            intents = IntentSocket(folder / "intents", requests, self._note, self._outside_safety, push)
            stack.callback(intents.close)
            self.data = DataSocket(
                folder / "data",
                plan.description.joint_names,
                1e-3 * plan.description.remote_policy_controller.stale_command_timeout_ms,
                clock=lambda: self.session.time,
                velocity=plan.velocity,
                widths=plan.external,
                timeouts=policies.live_timeouts,
                tell=self._note,
            )
            stack.callback(self.data.close)
            blobs = {MODEL_BLOB: model_bytes(setup.model())}
            self.feed = stack.enter_context(closing(FeedWriter(folder, header, blobs, plan.external)))
            registration.register(robot=plan.description.name, policy=policies.label, hardware=config.hardware or "")
            self.keyboard = None
            if config.has_keys:
                self.keyboard = Keyboard(plan.velocity, requests=requests, tell=self._show)
                stack.callback(self.keyboard.close)
            self.front_ends = FrontEnds(
                plan.front_ends,
                self.feed,
                show=self._show,
                note=self._note,
                status=self._status,
                is_ending=lambda: self.session.is_ending,
            )
            stack.callback(self.front_ends.close)
            self._open = stack.pop_all()
        sources: list[IntentSource] = []
        self.interruption = None
        if self._sim is None:
            if config.needs_gamepad:
                sources.append(DeviceWatch("gamepad", lambda: self.data.heartbeats, self._note))
            self.interruption = Interruption(_STANDSTILL, self._note)
            sources.append(self.interruption)
        sources += [intents] if self.keyboard is None else [intents, self.keyboard]
        self.script = None
        if plan.steps is not None:
            self.script = Script(plan.steps, requests=requests, operators=sources)
        self.session = Session(
            setup.robot,
            plan.supervisor,
            LoopSettings(
                plan.control_period,
                realtime=plan.realtime,
                simulated=self._sim is not None,
                duration=config.duration,
            ),
            header=header,
            intents=sources if self.script is None else (self.script,),
            remote=lambda: self.data.remote,
            sinks=[*self._sinks(console), intents, self.data],
            safety_filter=self._with_other_safety,
            externs=(self.data,) if plan.velocity is None else (self.data, plan.velocity),
            qpos=lambda: setup.qpos(self.session.state),
            mode_listener=setup.enter,
            requests=requests,
            interruption=self.interruption,
        )

    def _sinks(self, console: Console) -> list[Sink]:
        plan, outputs, first = self.plan, self.plan.outputs, self.plan.policies.first
        is_drawn = "html" in outputs or "video" in outputs
        motion = ghost = None
        if first is not None and len(plan.policies.choices) == 1:
            motion = MotionFigures(plan.description, first.loaded)
            if is_drawn:
                ghost = ReferenceGhost(plan.description, first.loaded.contract, first.loaded.reference)
        available = plan.supervisor.controllers
        self.console = ConsoleSink(console, has_keys=plan.config.has_keys, available=available)
        self.recorder = None
        if "record" in outputs:
            self.recorder = McapRecorder(
                outputs["record"],
                overwrite=plan.config.overwrite,
                inline=not plan.realtime,
                tell=lambda text: self.session.event(text, EventKind.FAILURE),
            )
        self.poses = Poses(ghost) if is_drawn else None
        figures = RunFigures(plan.description, motion=motion, base=plan.setup.base)
        self.monitor = Monitor(figures, self._tell, inline=not plan.realtime)
        # The last one is closed first: what the monitor finds in the last ticks still reaches the others.
        sinks = (self.feed, self.console, self.front_ends, self.recorder, self.poses, self.monitor)
        return [sink for sink in sinks if sink is not None]

    def close(self) -> None:
        """Release the terminal, and what others on the machine reach the run by. May be called twice."""
        self._open.close()

    def _show(self, text: str) -> None:
        """Show operators a line that is not recorded."""
        self.console.event(Event(self.session.time, text))

    def _note(self, text: str) -> None:
        self.session.event(text)

    def _tell(self, event: Event) -> None:
        for sink in self.session.sinks:
            sink.event(event)

    def _status(self) -> Mapping[str, Any]:
        recorder = self.recorder
        return {
            "owners": self.data.owners,
            "recording": recorder and {"file": str(recorder.path.absolute()), "error": recorder.error},
            "simulation": self._sim and {"bodies": list(self._sim.pushable)},
        }

    def _with_other_safety(self, statuses: tuple[SafetyStatus, ...]) -> tuple[SafetyStatus, ...]:
        statuses = self._outside_safety(statuses)
        if self.script is not None:
            self.script.note_safety(statuses)
        return statuses
