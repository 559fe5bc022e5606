"""A session of this process, registered in a folder of the test's own and driven tick by tick."""

import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager

import numpy as np
import rig

from humanoid_sim.client import Intake, SessionInfo, find_session, monotonic_ns
from humanoid_sim.messages import Intent, Mode, SafetyStatus, SessionHeader, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand, MITState
from humanoid_sim.session.data_socket import DataSocket
from humanoid_sim.session.feed import FeedWriter
from humanoid_sim.session.intent_socket import IntentSocket
from humanoid_sim.session.outside_safety import OutsideSafety
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.registration import Registration
from humanoid_sim.session.session import Session
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import IntentSource, PolicySelection, VelocityCommand

HEADER = SessionHeader("three", rig.JOINTS, rig.PERIOD, 0, {"robot": "{}"}, {"motion.mcap": b"motion"}, (("joint", 3),))


class _Robot(IntentSource, Sink):
    """Stands still; also a source of intents, and the sink that keeps the latest tick."""

    joints = rig.JOINTS
    intents: tuple[Intent, ...] = ()
    safety: tuple[SafetyStatus, ...] = ()
    time = 10.0
    record: TickRecord
    sent = 0

    def read(self) -> tuple[MITState, tuple[SafetyStatus, ...]]:
        return rig.state(self.time), self.safety

    def write(self, command: MITCommand) -> None:
        return

    def poll(self, time: float, output: TickOutput | None) -> tuple[Intent, ...]:
        return self.intents

    def tick(self, record: TickRecord) -> None:
        self.record, self.sent = record, monotonic_ns()


class LocalSession:
    """All but what `play` puts around a session."""

    def __init__(self, takes: Mapping[str, int] | None = None, timeouts: Mapping[str, float] | None = None) -> None:
        """Take live inputs from outside, by default `keys`; `timeouts`, s, of those that state one."""
        self.takes = {"keys": 2} if takes is None else takes
        self.robot, self.told, self.stack = _Robot(), list[str](), ExitStack()
        self.registration = self.stack.enter_context(closing(Registration()))
        folder, tell = self.registration.path, self.told.append
        outside, selection, self.velocity = OutsideSafety({}), PolicySelection(), VelocityCommand(np.zeros(3))
        self.intents = IntentSocket(folder / "intents", Reactivation(), tell, outside, selection=selection)
        self.stack.callback(self.intents.close)
        self.data = DataSocket(
            folder / "data",
            rig.JOINTS,
            0.1,
            clock=lambda: self.robot.time,
            velocity=self.velocity,
            live=self.takes,
            timeouts=timeouts,
            tell=tell,
        )
        self.stack.callback(self.data.close)
        self.feed = self.stack.enter_context(closing(FeedWriter(folder, HEADER, {"model.mjb": b"model"}, self.takes)))
        self.registration.register(robot="three", policy="p.onnx", hardware="")
        self.session = Session(
            self.robot,
            rig.two_policies(),
            LoopSettings(rig.PERIOD, realtime=False),
            header=HEADER,
            intents=(self.robot, self.intents),
            remote=lambda: self.data.remote,
            externs=(self.data, self.velocity),
            sinks=(self.robot, self.feed, self.intents, self.data),
            safety_filter=outside,
            selection=selection,
        )

    @property
    def info(self) -> SessionInfo:
        return find_session(os.getpid())

    def intake(self, name: str = "test") -> Intake:
        return self.stack.enter_context(Intake(self.info, name))

    def tick(self, *intents: Intent) -> TickRecord:
        """One turn of the loop."""
        self.robot.time += rig.PERIOD
        self.robot.intents = intents
        self.session.tick()
        if self.robot.record.index % 25 == 24:
            self.feed.status({"owners": self.data.owners})
        return self.robot.record

    def enter_remote(self) -> None:
        """To REMOTE, as an operator would."""
        for intent in (Intent.DAMP, Intent.LOAD_A):
            self.tick(intent)
        for _ in range(6):
            self.tick()
        assert self.tick(Intent.START_REMOTE).output.control_mode.mode is Mode.REMOTE


@contextmanager
def ticking(local: LocalSession, pause: float = 0.005) -> Iterator[list[TickRecord]]:
    """The session's loop, on a thread; `pause` in s between two ticks."""
    stop, records = threading.Event(), [local.tick()]

    def loop() -> None:
        while not stop.wait(pause):
            records.append(local.tick())

    thread = threading.Thread(target=loop)
    thread.start()
    try:
        yield records
    finally:
        stop.set()
        thread.join()
