"""Remote commands, velocities, live inputs and heartbeats from other programs: a Unix datagram socket.

Only the newest sample of each producer counts, and a flood costs a bounded time per tick. What is accepted becomes part
of a tick's input, so the recording holds everything that entered. `humanoid_sim.client.Intake` is the other end.

A sample arrives when its producer stamped it: what waited in a queue is as old as it is. A stamp in the future is
refused, because such a command would stay fresh too long.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from humanoid_sim import client as wire
from humanoid_sim.messages import Mode, RemoteCommand, TickRecord
from humanoid_sim.mit import Extern, FloatArray, MITCommand
from humanoid_sim.session.intent_socket import LimitedLog, listening, queue_length
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import ExternSource, Turn, VelocityCommand, printable, remote_problem

_LONGEST = 1 << 14  # bytes; a longer datagram is not a message
_MOST_SAMPLES = 32  # samples that are read in one tick; each is the newest of its producer and topic
_REMEMBERED = 256  # refusals, each of which is reported once


class _Sample(NamedTuple):
    kind: int
    producer: str  # name and process id
    topic: str
    values: FloatArray
    arrival_time: float  # s, robot's clock


class _RefusedError(Exception):
    """Refusal of a sample; the message is the reason."""


class DataSocket(ExternSource, Sink):
    """A source of live inputs, of remote commands and a velocity too, and a sink that follows the mode."""

    def __init__(
        self,
        path: Path,
        joints: tuple[str, ...],
        stale_timeout: float,
        *,
        clock: Callable[[], float],
        velocity: VelocityCommand | None = None,
        live: Mapping[str, int] | None = None,
        timeouts: Mapping[str, float] | None = None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Open the socket. Raises `InputError` if it cannot be opened.

        Args:
            joints: the robot's, which remote commands name in this order.
            stale_timeout: s after which a remote command is stale, and its producer's turn over.
            velocity: gets velocity commands; None: nothing observes one.
            live: name and width of the live inputs that are observed.
            timeouts: of those that state one, s, also infinite.
            tell: records a line: owners and refusals as they change.
        """
        self._socket, self._most = listening(path), queue_length() + 1
        self._joints, self._stale_timeout, self._clock = joints, stale_timeout, clock
        self._velocity, self._widths, self._timeouts = velocity, live or {}, timeouts or {}
        self._tell = LimitedLog(tell, clock)
        self._turns = {"REMOTE": Turn(), **{name: Turn() for name in self._widths}}
        if velocity is not None:
            self._turns["velocity"] = velocity.turn
        self._live: dict[str, Extern] = {}
        self._mode, self._entered = Mode.ZERO_TORQUE, 0.0
        self._refused: set[str] = set()
        self.remote: RemoteCommand | None = None  # the latest accepted command
        self.owners = dict.fromkeys(self._turns, "")
        """Name and process id of who commands `REMOTE`, `velocity`, and each live input at present; '' for nobody."""
        self.heartbeats: dict[str, float] = {}  # arrival of the latest by producer's name, s, robot's clock

    def latest(self) -> Mapping[str, Extern]:
        """Take in what has come since the last call; return the live inputs that ever came."""
        time = self._clock()
        if self._velocity is not None:
            self._velocity.expire(time)
        for turn in self._turns.values():
            turn.expire(time)
        refusals = []
        for datagram in self._drain():
            try:
                self._accept(_read(datagram, time), time)
            except _RefusedError as refusal:
                refusals.append(str(refusal))
        self._show_owners()
        for text in refusals:
            if text not in self._refused and len(self._refused) < _REMEMBERED and self._tell(text):
                self._refused.add(text)
        return self._live

    def tick(self, record: TickRecord) -> None:
        """Follow the mode: with REMOTE a turn begins, and only what comes after may take it."""
        mode = record.output.control_mode.mode
        if mode is not self._mode:
            self._mode, self._entered = mode, float(record.input.state.time)
            self._turns["REMOTE"].owner = ""
            self._show_owners()

    def close(self) -> None:
        self._socket.close()

    def _drain(self) -> list[bytes]:
        """Return the newest datagram of each producer and topic."""
        newest: dict[bytes, bytes] = {}
        head = wire.DATA_HEAD.size
        for _ in range(self._most):
            try:
                datagram = self._socket.recv(_LONGEST)
            except OSError:  # nothing more
                break
            if len(datagram) < head or not datagram.startswith(wire.DATA_MAGIC):
                continue
            # The stamp is the head's last field; what is before it, the name and the topic tell senders apart.
            name_end = head + int.from_bytes(datagram[8:10], "little") + int.from_bytes(datagram[10:12], "little")
            newest[datagram[: head - 8] + datagram[head:name_end]] = datagram
        return list(newest.values())[:_MOST_SAMPLES]

    def _accept(self, sample: _Sample, time: float) -> None:
        if sample.kind == wire.REMOTE:
            problem = self._accept_remote(sample, time)
        elif sample.kind == wire.VELOCITY:
            problem = self._accept_velocity(sample)
        elif sample.kind == wire.LIVE:
            problem = self._accept_live(sample)
        else:
            self.heartbeats[sample.producer.partition(" (")[0]] = sample.arrival_time
            return
        if problem:
            raise _RefusedError(f"refused of {sample.producer}: {problem[:1000]}")

    def _accept_remote(self, sample: _Sample, time: float) -> str:
        is_remote, names = self._mode is Mode.REMOTE, tuple(sample.topic.split("\n"))
        if time - sample.arrival_time > self._stale_timeout:
            return f"a remote command that is already stale, expected one younger than {self._stale_timeout:g} s"
        if is_remote and sample.arrival_time <= self._entered:
            return ""  # of before REMOTE was entered: it takes no turn
        if len(sample.values) != 5 * len(names):
            return f"remote command: has {len(sample.values)} values, expected 5 for each of {len(names)} joints"
        command = MITCommand(*sample.values.reshape(5, -1))
        problem = remote_problem(names, command, self._joints)
        if not problem and is_remote:
            problem = self._owner_problem("REMOTE", sample, self._stale_timeout)
        if not problem:
            self.remote = RemoteCommand(command, sample.arrival_time)
        return problem

    def _accept_velocity(self, sample: _Sample) -> str:
        if self._velocity is None:
            return "a velocity command, which the policy does not observe"
        if len(sample.values) != 4 or not np.isfinite(sample.values).all():
            return "a velocity command that is not four finite numbers: vx, vy, wz, deliberate"
        velocity, is_deliberate = sample.values[:3], bool(sample.values[3])
        is_owner = self._velocity.offer(
            sample.producer, velocity, sample.arrival_time, timeout=wire.VELOCITY_TIMEOUT, deliberate=is_deliberate
        )
        return "" if is_owner or not velocity.any() else f"velocity: belongs to {self._velocity.turn.owner or 'nobody'}"

    def _accept_live(self, sample: _Sample) -> str:
        name, values, width = sample.topic, sample.values, self._widths.get(sample.topic)
        if width is None:
            return f"live input '{name[:40]}' is not observed; the policy observes: {', '.join(self._widths) or 'none'}"
        if len(values) != width or not np.isfinite(values).all():
            return f"live input '{name}': has {len(values)} values, expected {width}, all finite"
        timeout = self._timeouts.get(name, wire.LIVE_TIMEOUT)
        # A value may count for ever; its producer owns the input only while it may still be there.
        problem = self._owner_problem(name, sample, timeout if math.isfinite(timeout) else wire.LIVE_TIMEOUT)
        if not problem:
            self._live = {**self._live, name: Extern(values, sample.arrival_time, timeout)}
        return problem

    def _owner_problem(self, name: str, sample: _Sample, timeout: float) -> str:
        """Take the turn for a sample's producer, or return whose it is."""
        turn = self._turns[name]
        is_owner = turn.admit(sample.producer, sample.arrival_time + timeout)
        return "" if is_owner else f"{name}: belongs to {turn.owner}"

    def _show_owners(self) -> None:
        for name, turn in self._turns.items():
            before = self.owners[name]
            if turn.owner != before:
                self.owners[name] = turn.owner
                self._tell(f"{name}: belongs to {turn.owner}" if turn.owner else f"{name}: left by {before}")
                self._refused.clear()


def _read(datagram: bytes, time: float) -> _Sample:
    """Return the sample in a datagram that has just been received, at a time in s on the robot's clock."""
    _, kind, _, name_size, topic_size, process, stamp = wire.DATA_HEAD.unpack_from(datagram)
    topic_at = wire.DATA_HEAD.size + name_size
    name = printable(datagram[wire.DATA_HEAD.size : topic_at].decode(errors="replace"))[:40] or "?"
    producer = f"{name} ({process})" if process else name
    topic, body = datagram[topic_at : topic_at + topic_size], datagram[topic_at + topic_size :]
    age = 1e-9 * (wire.monotonic_ns() - stamp)
    if len(body) % 8 or age < 0.0 or kind > wire.HEARTBEAT:
        raise _RefusedError(f"refused of {producer}: a message of another version, or a stamp in the future")
    topics = map(printable, topic.decode(errors="replace").split("\n"))
    return _Sample(kind, producer, "\n".join(topics), np.frombuffer(body, dtype="<f8"), time - age)
