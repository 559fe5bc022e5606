"""Remote commands, velocities, live inputs and heartbeats from other programs: a Unix datagram socket.

Only the newest sample of each producer counts, and a flood costs a bounded time per tick. What is accepted becomes part
of a tick's input, so the recording holds everything that entered. `humanoid_sim.client.Intake` is the other end.

A sample arrives when its producer stamped it or when it is received, whichever is earlier: what waited in a queue is as
old as it is. A stamp in the future is refused, because such a command would stay fresh too long.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from humanoid_sim import client as wire
from humanoid_sim.messages import Mode, RemoteCommand, TickRecord
from humanoid_sim.mit import Extern, FloatArray, MITCommand
from humanoid_sim.session.intent_socket import LimitedLog, listening, queue_length
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import ExternSource, VelocityCommand, remote_problem

_LONGEST = 1 << 14  # bytes; a longer datagram is not a message
_MOST_SAMPLES = 32  # samples that are read in one tick; each is the newest of its producer and topic
_REMEMBERED = 256  # refusals, each of which is reported once


@dataclass(slots=True)
class Turn:
    """Belongs to the first producer that is accepted, until it is stale; others are refused meanwhile."""

    timeout: float
    """s after its owner's last sample."""
    owner: str = ""
    _arrival: float = -math.inf

    def expire(self, time: float) -> None:
        """Release an owner that is stale; `time` in s, robot's clock."""
        if not time - self._arrival <= self.timeout:
            self.owner = ""

    def admit(self, producer: str, arrival_time: float) -> bool:
        """Return True if a sample of that producer counts; an unowned turn becomes the producer's."""
        if self.owner not in ("", producer):
            return False
        self._arrival = max(arrival_time, self._arrival) if self.owner else arrival_time
        self.owner = producer
        return True


@dataclass(frozen=True, slots=True)
class _Sample:
    kind: int
    producer: str
    """Name and process id."""
    topic: str
    values: FloatArray
    arrival_time: float
    """s, robot's clock."""


class _RefusedError(Exception):
    """Refusal of a sample; the message is the reason."""


class DataSocket(ExternSource, Sink):
    """A source of live inputs of remote commands and a velocity too, and a sink that follows the mode."""

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
            timeouts: of those that state one, s, also infinite; a producer may only shorten it.
            tell: records a line: owners and refusals as they change.
        """
        self._socket, self._most = listening(path), queue_length() + 1
        self._joints, self._velocity, self._clock = joints, velocity, clock
        self._widths, self._timeouts = dict(live or {}), dict(timeouts or {})
        self._tell = LimitedLog(tell, clock)
        self._turns = {"REMOTE": Turn(stale_timeout), **{name: Turn(wire.LIVE_TIMEOUT) for name in self._widths}}
        self._live: dict[str, Extern] = {}
        self._mode, self._entered = Mode.ZERO_TORQUE, 0.0
        self._refusals: dict[str, None] = {}
        self.remote: RemoteCommand | None = None
        """The latest accepted command."""
        self.owners: dict[str, str] = {}
        """Name and process id of who commands `REMOTE`, `velocity`, and each live input at present; '' for nobody."""
        self.heartbeats: dict[str, float] = {}
        """Arrival of the latest heartbeat by its producer's name, s, robot's clock."""

    def latest(self) -> Mapping[str, Extern]:
        """Take in what has come since the last call; return the live inputs that ever came."""
        time = self._clock()
        for turn in self._turns.values():
            turn.expire(time)
        if self._velocity is not None:
            self._velocity.expire(time)
        refused: list[str] = []
        for datagram, received in self._drain():
            try:
                self._accept(_read(datagram, received, time))
            except _RefusedError as refusal:
                refused.append(str(refusal))
        self._show_owners()
        for text in refused:
            if text not in self._refusals and len(self._refusals) < _REMEMBERED and self._tell(text):
                self._refusals[text] = None
        return self._live

    def tick(self, record: TickRecord) -> None:
        """Follow the mode: with REMOTE a turn begins, and only what comes after may take it."""
        mode = record.output.control_mode.mode
        if mode is not self._mode:
            self._mode, self._entered = mode, float(record.input.state.time)
            self._turns["REMOTE"].owner = ""
            self._show_owners()

    def close(self) -> None:
        """Close the socket. May be called twice."""
        self._socket.close()

    def status(self) -> dict[str, object]:
        """Return what to publish beside ticks: owners, and refusals since they last changed."""
        return {"owners": dict(self.owners), "refused": list(self._refusals)}

    def _drain(self) -> list[tuple[bytes, int]]:
        """Return the newest datagram of each producer and topic, and when it was received, ns."""
        newest: dict[bytes, tuple[bytes, int]] = {}
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
            newest[datagram[: head - 8] + datagram[head:name_end]] = (datagram, wire.monotonic_ns())
        return list(newest.values())[:_MOST_SAMPLES]

    def _accept(self, sample: _Sample) -> None:
        accept = {
            wire.REMOTE: self._accept_remote,
            wire.VELOCITY: self._accept_velocity,
            wire.LIVE: self._accept_live,
            wire.HEARTBEAT: self._accept_heartbeat,
        }.get(sample.kind)
        problem = f"kind {sample.kind}, expected 0 to {wire.HEARTBEAT}" if accept is None else accept(sample)
        if problem:
            raise _RefusedError(f"refused of {sample.producer}: {problem[:1000]}")

    def _accept_heartbeat(self, sample: _Sample) -> str:
        self.heartbeats[sample.producer.partition(" (")[0]] = sample.arrival_time
        return ""

    def _accept_remote(self, sample: _Sample) -> str:
        turn, is_remote = self._turns["REMOTE"], self._mode is Mode.REMOTE
        names = tuple(sample.topic.split("\n"))
        if self._clock() - sample.arrival_time > turn.timeout:
            return f"a remote command that is already stale, expected one younger than {turn.timeout:g} s"
        if is_remote and sample.arrival_time <= self._entered:
            return ""  # of before REMOTE was entered: it takes no turn
        if is_remote and turn.owner not in ("", sample.producer):
            return f"REMOTE: belongs to {turn.owner}"
        if len(sample.values) != 5 * len(names):
            return f"remote command: has {len(sample.values)} values, expected 5 for each of {len(names)} joints"
        command = MITCommand(*sample.values.reshape(5, -1))
        if problem := remote_problem(names, command, self._joints):
            return problem
        self.remote = RemoteCommand(command, sample.arrival_time)
        if is_remote:
            turn.admit(sample.producer, sample.arrival_time)
        return ""

    def _accept_velocity(self, sample: _Sample) -> str:
        if self._velocity is None:
            return "a velocity command, which the policy does not observe"
        if len(sample.values) != 4 or not np.isfinite(sample.values).all():
            return "a velocity command that is not four finite numbers: vx, vy, wz, deliberate"
        velocity, is_deliberate = sample.values[:3], bool(sample.values[3])
        owner = self._velocity.offer(
            sample.producer, velocity, sample.arrival_time, timeout=wire.VELOCITY_TIMEOUT, deliberate=is_deliberate
        )
        if owner == sample.producer or not velocity.any():
            return ""
        return f"velocity: controlled by {owner or 'nobody'}; move a stick or a slider, or press a key, to take it over"

    def _accept_live(self, sample: _Sample) -> str:
        name, width = sample.topic, self._widths.get(sample.topic)
        if width is None:
            return f"live input '{name[:40]}' is not observed; the policy observes: {', '.join(self._widths) or 'none'}"
        given, values = sample.values[:1], sample.values[1:]
        if len(values) != width or not np.isfinite(values).all():
            return f"live input '{name}': has {len(values)} values, expected {width}, all finite"
        timeout = self._timeouts.get(name, wire.LIVE_TIMEOUT)
        if not np.isnan(given).any():  # its producer says
            if not 0.0 < given[0] <= wire.LONGEST_TIMEOUT:
                return f"live input '{name}': timeout is {given[0]:g} s, expected 0 to {wire.LONGEST_TIMEOUT:g} s"
            timeout = min(float(given[0]), self._timeouts.get(name, math.inf))
        turn = self._turns[name]
        if not turn.admit(sample.producer, sample.arrival_time):
            return f"live input '{name}': belongs to {turn.owner}"
        # A value may count for ever; its producer owns the input only while it may still be there.
        turn.timeout = timeout if math.isfinite(timeout) else wire.LIVE_TIMEOUT
        self._live = {**self._live, name: Extern(values, sample.arrival_time, timeout)}
        return ""

    def _show_owners(self) -> None:
        """Record owners as they change; what is refused from then on is recorded again."""
        owners = {name: turn.owner for name, turn in self._turns.items()}
        if self._velocity is not None:
            owners["velocity"] = self._velocity.owner
        if owners == self.owners:
            return
        for name, owner in owners.items():
            before = self.owners.get(name, "")
            if owner != before:
                self._tell(f"{name}: belongs to {owner}" if owner else f"{name}: no longer controlled by {before}")
        self.owners = owners
        self._refusals.clear()


def _read(datagram: bytes, received: int, time: float) -> _Sample:
    """Return the sample in a datagram that was received at a time in ns, and in s on the robot's clock."""
    _, kind, _, name_size, topic_size, process, stamp = wire.DATA_HEAD.unpack_from(datagram)
    name_at = wire.DATA_HEAD.size
    topic_at = name_at + name_size
    body = datagram[topic_at + topic_size :]
    name = _plain(datagram[name_at:topic_at])[:40] or "?"
    producer = f"{name} ({process})" if process else name
    if len(body) % 8:
        raise _RefusedError(f"refused of {producer}: {len(body)} bytes of values, expected whole float64 values")
    if stamp > received:
        raise _RefusedError(f"refused of {producer}: a stamp in the future, expected CLOCK_MONOTONIC of this host")
    topic = "\n".join(map(_plain, datagram[topic_at : topic_at + topic_size].split(b"\n")))
    return _Sample(kind, producer, topic, np.frombuffer(body, dtype="<f8"), time - 1e-9 * (received - stamp))


def _plain(text: bytes) -> str:
    """Return a text that cannot steer a terminal."""
    return "".join(c if c.isprintable() else "?" for c in " ".join(text.decode(errors="replace").split()))
