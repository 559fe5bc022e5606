"""A session of this process, registered in a folder of the test's own and driven tick by tick."""

import math
import os
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager

import numpy as np
import rig
from fakes import FakeRobot, FakeSink, FakeSource

from humanoid_sim.client import Intake, SessionInfo, find_session, monotonic_ns
from humanoid_sim.messages import Intent, Mode, SessionHeader, TickRecord
from humanoid_sim.session.data_socket import DataSocket
from humanoid_sim.session.feed import FeedWriter
from humanoid_sim.session.intent_socket import IntentSocket
from humanoid_sim.session.outside_safety import OutsideSafety
from humanoid_sim.session.pace import LoopSettings
from humanoid_sim.session.registration import Registration
from humanoid_sim.session.requests import Requests
from humanoid_sim.session.session import Session
from humanoid_sim.session.sources import VelocityCommand

HEADER = SessionHeader("three", rig.JOINTS, rig.PERIOD, 0, {"robot": "{}"}, {"motion.mcap": b"motion"}, (("joint", 3),))


class LocalSession:
    """All but what `play` puts around a session."""

    def __init__(self, takes: Mapping[str, int] | None = None) -> None:
        """Take live inputs from outside, by default `keys`, and `pose`, which does not grow old."""
        takes = {"keys": 2, "pose": 1} if takes is None else takes
        self.robot, self.told, self.stack = FakeRobot(time=10.0), list[str](), ExitStack()
        self._source, self._sink, self.sent = FakeSource(), FakeSink(on_tick=self._note), 0
        self.registration = self.stack.enter_context(closing(Registration()))
        folder, tell = self.registration.path, self.told.append
        outside, requests, self.velocity = OutsideSafety({}), Requests(), VelocityCommand(np.zeros(3))
        self.intents = IntentSocket(folder / "intents", requests, tell, outside)
        self.stack.callback(self.intents.close)
        self.data = DataSocket(
            folder / "data",
            rig.JOINTS,
            0.1,
            clock=lambda: self.robot.time,
            velocity=self.velocity,
            widths=takes,
            timeouts={"pose": math.inf},
            tell=tell,
        )
        self.stack.callback(self.data.close)
        self.feed = self.stack.enter_context(closing(FeedWriter(folder, HEADER, {"model.mjb": b"model"}, takes)))
        self.registration.register(robot="three", policy="p.onnx", hardware="")
        self.session = Session(
            self.robot,
            rig.two_policies(),
            LoopSettings(rig.PERIOD, realtime=False),
            header=HEADER,
            intents=(self._source, self.intents),
            remote=lambda: self.data.remote,
            externs=(self.data, self.velocity),
            sinks=(self._sink, self.feed, self.intents, self.data),
            safety_filter=outside,
            requests=requests,
        )

    @property
    def info(self) -> SessionInfo:
        return find_session(os.getpid())

    def intake(self, name: str = "test") -> Intake:
        return self.stack.enter_context(Intake(self.info, name))

    def tick(self, *intents: Intent) -> TickRecord:
        """One turn of the loop."""
        self._source.intents = {self._source.polls: intents}
        self.session.tick()
        if len(self._sink.records) % 25 == 0:
            self.feed.status({"owners": self.data.owners})
        return self._sink.records[-1]

    def _note(self, record: TickRecord) -> None:
        self.sent = monotonic_ns()

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
