"""A session's local ends without a loop: registered for this process, in a folder of the test's own."""

import os
import shutil
import socket
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rig

from humanoid_sim.client import Intake, SessionInfo, find_session, monotonic_ns
from humanoid_sim.messages import Intent, Mode, SafetyStatus, SessionHeader, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import Extern
from humanoid_sim.session.data_socket import DataSocket
from humanoid_sim.session.feed import FeedWriter
from humanoid_sim.session.intent_socket import IntentSocket
from humanoid_sim.session.outside_safety import OutsideSafety
from humanoid_sim.session.reactivation import Reactivation
from humanoid_sim.session.registration import Registration
from humanoid_sim.session.sources import PolicySelection, VelocityCommand

HEADER = SessionHeader("three", rig.JOINTS, rig.PERIOD, 0, {"robot": "{}"}, {"motion.mcap": b"motion"}, (("joint", 3),))


@dataclass
class LocalSession:
    """Its `time` is the robot's clock."""

    time: float = 10.0
    stack: ExitStack = field(default_factory=ExitStack)
    told: list[str] = field(default_factory=list)
    index: int = 0
    sent: int = 0
    """ns, when the latest tick was published."""
    safety: tuple[SafetyStatus, ...] = ()
    takes: Mapping[str, int] = field(default_factory=lambda: {"keys": 2})
    """Live inputs from outside."""
    timeouts: Mapping[str, float] = field(default_factory=dict)
    """Of those that state one, s."""
    makes: dict[str, Extern] = field(default_factory=dict)
    """Live inputs of its own."""
    watchdogs: Mapping[str, float] = field(default_factory=dict)
    """Timeout of each source that must report, s."""

    def __post_init__(self) -> None:
        self.run = rig.Run(rig.two_policies())
        self.output: TickOutput | None = None
        self.reactivation = Reactivation()
        self.registration = Registration()
        self.stack.callback(self.registration.close)
        self.outside = OutsideSafety(self.watchdogs)
        self.selection = PolicySelection()
        self.intents = IntentSocket(
            self.registration.path / "intents",
            self.reactivation,
            self.told.append,
            self.outside,
            selection=self.selection,
        )
        self.stack.callback(self.intents.close)
        self.velocity = VelocityCommand(np.zeros(3))
        self.data = DataSocket(
            self.registration.path / "data",
            rig.JOINTS,
            0.1,
            clock=lambda: self.time,
            velocity=self.velocity,
            live=self.takes,
            timeouts=self.timeouts,
            tell=self.told.append,
        )
        self.stack.callback(self.data.close)
        self.feed = FeedWriter(self.registration.path, HEADER, {"model.mjb": b"model"}, live_inputs=self.takes)
        self.stack.callback(self.feed.close)
        self.registration.register(robot="three", policy="p.onnx", hardware="")

    @property
    def info(self) -> SessionInfo:
        return find_session(os.getpid())

    def publish(
        self, header: SessionHeader, blobs: Mapping[str, bytes] | None = None, *, robot: str, hardware: str = ""
    ) -> None:
        """Register again, as a session of another robot."""
        self.feed.close()
        shutil.rmtree(self.registration.path / "files")
        (self.registration.path / "ticks").unlink()
        self.feed = FeedWriter(self.registration.path, header, blobs or {})
        self.stack.callback(self.feed.close)
        self.registration.register(robot=robot, policy="none", hardware=hardware)

    def intake(self, name: str = "test") -> Intake:
        return self.stack.enter_context(Intake(self.info, name))

    def tick(self, *more: Intent) -> TickRecord:
        """One turn of the loop: intents, data, the stack, the sinks."""
        self.time += rig.PERIOD
        intents = (*more, *self.intents.poll(self.time, self.output))
        live = {**self.makes, **self.data.latest(), **self.velocity.latest()}
        state = rig.state(self.time, extern=live)
        tick_input = TickInput(
            state, self.outside(self.safety), tuple(intents), self.data.remote, self.selection.take()
        )
        self.run.memory, output = self.run.supervisor.step(self.run.memory, tick_input)
        self.output = output
        record = TickRecord(self.index, tick_input, output, 1e-4, False, None)
        self.index += 1
        self.sent = monotonic_ns()
        for sink in (self.feed, self.intents, self.data):
            sink.tick(record)
        if self.index % 25 == 0:
            self.feed.status({"owners": self.data.owners})
        return record

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


def datagram(path: Path | str, data: bytes) -> None:
    """Send without waiting."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as client:
        client.setblocking(False)
        client.sendto(data, str(path))
