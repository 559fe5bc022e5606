"""Remote commands, velocities, live inputs and heartbeats from other programs: a Unix datagram socket.

Only the newest sample of each producer counts. What is accepted becomes part of a tick's input, so the recording holds
everything that entered. `humanoid_sim.client.Intake` is the other end.

A sample arrives when its producer stamped it: what waited in a queue is as old as it is. A stamp in the future is
refused, because such a command would stay fresh too long.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path

import numpy as np

from humanoid_sim.client import LIVE_TIMEOUT, VELOCITY_TIMEOUT
from humanoid_sim.messages import Mode, RemoteCommand, TickRecord
from humanoid_sim.mit import Extern, MITCommand
from humanoid_sim.recording.sink import Sink
from humanoid_sim.session.datagrams import Mailbox, Message, read_message
from humanoid_sim.session.sources import ExternSource, Turn, VelocityCommand, remote_problem

_REMEMBERED = 256  # refusals, each of which is reported once until an owner changes


@dataclass(eq=False)
class DataSocket(ExternSource, Sink):
    """A source of live inputs, of remote commands and a velocity too, and a sink that follows the mode.

    Raises `InputError` if the socket cannot be opened.
    """

    path: Path
    joints: tuple[str, ...]  # the robot's, which remote commands name in this order
    stale_timeout: float  # s after which a remote command is stale, and its producer's turn over
    _: KW_ONLY
    clock: Callable[[], float]  # the robot's, s
    velocity: VelocityCommand | None = None  # gets velocity commands; None: nothing observes one
    widths: Mapping[str, int] = field(default_factory=dict)  # of the live inputs that are observed
    timeouts: Mapping[str, float] = field(default_factory=dict)  # of those that state one, s, also infinite
    tell: Callable[[str], None] = lambda _: None  # records a line: owners and refusals as they change

    def __post_init__(self) -> None:
        self._mailbox = Mailbox(self.path)
        self._turns = {"REMOTE": Turn()}
        if self.velocity is not None:
            self._turns["velocity"] = self.velocity.turn
        self._live: dict[str, Extern] = {}
        self._mode, self._entered = Mode.ZERO_TORQUE, 0.0
        self._refused: set[str] = set()
        self.remote: RemoteCommand | None = None  # the latest accepted command
        self.owners = dict.fromkeys(self._turns, "")
        """Name and process id of who commands `REMOTE` and `velocity` at present; '' for nobody."""
        self.heartbeats: dict[str, float] = {}  # arrival of the latest by producer's name, s, robot's clock

    def latest(self) -> Mapping[str, Extern]:
        """Take in what has come since the last call; return the live inputs that ever came."""
        time = self.clock()
        if self.velocity is not None:
            self.velocity.expire(time)
        self._turns["REMOTE"].expire(time)
        newest = {tuple(datagram.split(b"\n", 2)[:2]): datagram for datagram, _ in self._mailbox.take()}
        refusals = []
        for message in map(read_message, newest.values()):
            problem = self._accept(message, time)
            if problem:
                refusals.append(f"refused of {message.producer}: {problem}")
        self._show_owners()
        for text in refusals:
            if text not in self._refused and len(self._refused) < _REMEMBERED:
                self._refused.add(text)
                self.tell(text)
        return self._live

    def tick(self, record: TickRecord) -> None:
        """Follow the mode: with REMOTE a turn begins, and only what comes after may take it."""
        mode = record.output.control_mode.mode
        if mode is not self._mode:
            self._mode, self._entered = mode, float(record.input.state.time)
            self._turns["REMOTE"].owner = ""
            self._show_owners()

    def close(self) -> None:
        self._mailbox.close()

    def _accept(self, message: Message, time: float) -> str:
        """Take what a message holds, or return why not."""
        age = message.age()
        if age < 0.0:
            return "its stamp lies in the future"
        match message.word:
            case "remote":
                return self._accept_remote(message, time, time - age)
            case "velocity":
                return self._accept_velocity(message, time - age)
            case "live":
                return self._accept_live(message, time - age)
            case "heartbeat":
                self.heartbeats[message.producer.partition(" (")[0]] = time - age
                return ""
        return f"'{message.word[:40]}' means nothing, expected one of remote, velocity, live, heartbeat"

    def _accept_remote(self, message: Message, time: float, arrival_time: float) -> str:
        is_remote, names, values = self._mode is Mode.REMOTE, tuple(message.rest.split("\t")), message.values
        if time - arrival_time > self.stale_timeout:
            return f"a remote command that is already stale, expected one younger than {self.stale_timeout:g} s"
        if is_remote and arrival_time <= self._entered:
            return ""  # of before REMOTE was entered: it takes no turn
        if len(values) != 5 * len(names):
            return f"remote command: has {len(values)} values, expected 5 for each of {len(names)} joints"
        command, turn = MITCommand(*values.reshape(5, -1)), self._turns["REMOTE"]
        problem = remote_problem(names, command, self.joints)
        if problem:
            return problem
        if is_remote and turn.owner not in ("", message.producer):
            return f"REMOTE: belongs to {turn.owner}"
        if is_remote:
            turn.take(message.producer, arrival_time + self.stale_timeout)
        self.remote = RemoteCommand(command, arrival_time)
        return ""

    def _accept_velocity(self, message: Message, arrival_time: float) -> str:
        if self.velocity is None:
            return "a velocity command, which the policy does not observe"
        if len(message.values) != 4 or not np.isfinite(message.values).all():
            return "a velocity command that is not four finite numbers: vx, vy, wz, deliberate"
        velocity, is_deliberate = message.values[:3], bool(message.values[3])
        is_owner = self.velocity.offer(
            message.producer, velocity, arrival_time, timeout=VELOCITY_TIMEOUT, deliberate=is_deliberate
        )
        return "" if is_owner or not velocity.any() else f"velocity: belongs to {self.velocity.turn.owner or 'nobody'}"

    def _accept_live(self, message: Message, arrival_time: float) -> str:
        name, values, width = message.rest, message.values, self.widths.get(message.rest)
        if width is None:
            return f"live input '{name[:40]}' is not observed; the policy observes: {', '.join(self.widths) or 'none'}"
        if len(values) != width or not np.isfinite(values).all():
            return f"live input '{name}': has {len(values)} values, expected {width}, all finite"
        self._live = {**self._live, name: Extern(values, arrival_time, self.timeouts.get(name, LIVE_TIMEOUT))}
        return ""

    def _show_owners(self) -> None:
        for name, turn in self._turns.items():
            before = self.owners[name]
            if turn.owner != before:
                self.owners[name] = turn.owner
                self.tell(f"{name}: belongs to {turn.owner}" if turn.owner else f"{name}: left by {before}")
                self._refused.clear()
