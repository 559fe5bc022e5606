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
from humanoid_sim.errors import FieldError
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import Extern, FloatArray, MITCommand
from humanoid_sim.session.intent_socket import BoundedTelling, listening, queue_length
from humanoid_sim.session.sinks import Sink
from humanoid_sim.session.sources import ExternSource, RemoteInbox, VelocityCommand


@dataclass(frozen=True, slots=True)
class Producer:
    """A program that sends data."""

    name: str
    process: int
    """Process id; 0 for one elsewhere, which its name alone identifies."""

    def __str__(self) -> str:
        return f"{self.name} ({self.process})" if self.process else self.name


class Turn:
    """Belongs to the first producer that is accepted, until it is stale; others are refused meanwhile."""

    def __init__(self, timeout: float) -> None:
        """Start without an owner; `timeout` s after its last sample an owner has none of it any more."""
        self.timeout = timeout
        self.owner: Producer | None = None
        self._heard = -math.inf

    def expire(self, time: float) -> None:
        """Take the turn from an owner that is stale; `time` in s, robot's clock."""
        if self.owner is not None and not time - self._heard <= self.timeout:
            self.owner = None

    def clear(self) -> None:
        """Take the turn from whoever has it."""
        self.owner = None

    def admit(self, producer: Producer, arrival_time: float) -> bool:
        """Tell whether a sample of that producer counts; if nobody has the turn, it is the producer's from here on."""
        if self.owner is not None and self.owner != producer:
            return False
        self._heard = arrival_time if self.owner is None else max(arrival_time, self._heard)
        self.owner = producer
        return True


_LINE_PERIOD = 1.0
"""s between two lines about one producer."""
_LONGEST_REASON = 1000
"""Characters of a reason."""
_MOST_REFUSALS = 256
"""Different refusals that are remembered, so that each is told once, and producers that are told apart."""


class Refusals:
    """Reports each reason of a producer once until `forget`, and at most one line per second for one producer."""

    def __init__(self, tell: Callable[[str], object]) -> None:
        """Start with none; `tell` takes a line."""
        self._tell = tell
        self._reasons: dict[tuple[str, str], bool] = {}
        """Producers and their reasons; True while a reason is still to be reported."""
        self._told_at: dict[str, float] = {}
        """s, robot's clock, by producer."""
        self.counts: dict[str, int] = {}
        """Samples refused since the session began, by producer; those beyond the first so many count under `others`."""
        self.latest = ""

    @property
    def count(self) -> int:
        """Samples refused since the session began."""
        return sum(self.counts.values())

    @property
    def lines(self) -> tuple[str, ...]:
        """Return what was refused since the last `forget`, one line each."""
        return tuple(f"{producer}: {reason}" for producer, reason in sorted(self._reasons))

    def add(self, producer: Producer, reason: str, count: int = 1) -> None:
        """Count a refusal; `count` samples for this reason."""
        name = str(producer) if str(producer) in self.counts or len(self.counts) < _MOST_REFUSALS else "others"
        self.counts[name] = self.counts.get(name, 0) + count
        # Others chose these words: no line ends and nothing that steers a terminal, and not too many of them.
        reason = "".join(c if c.isprintable() else "?" for c in reason[:_LONGEST_REASON])
        self.latest = f"{producer}: {reason}"
        if len(self._reasons) < _MOST_REFUSALS:
            self._reasons.setdefault((str(producer), reason), True)

    def forget(self) -> None:
        """Forget what was said: what is refused from here on is said again."""
        self._reasons = {key: True for key, is_new in self._reasons.items() if is_new}

    def flush(self, time: float) -> None:
        """Tell what may be told at a time in s, robot's clock."""
        if not any(self._reasons.values()):
            return
        if len(self._told_at) > _MOST_REFUSALS:
            self._told_at.clear()
        for (producer, reason), is_new in self._reasons.items():
            # Also when the clock has jumped back.
            if is_new and not abs(time - self._told_at.get(producer, -math.inf)) < _LINE_PERIOD:
                self._told_at[producer] = time
                self._reasons[producer, reason] = False
                self._tell(f"refused of {producer}: {reason}")


_LONGEST = 1 << 14
"""Bytes; a longer datagram is not a message."""
_MOST_SAMPLES = 32
"""Samples that are looked into in one tick; each is the newest of its producer and topic."""
_LONGEST_TIMEOUT = 5.0
"""s that a live input may hold without being repeated."""
_MOST_REPORTED = 2.0**53
"""Samples that a producer may have refused in all."""
_MOST_STAMPS = 256
"""Producers and topics whose newest stamp is remembered."""


@dataclass(frozen=True, slots=True)
class _Sample:
    kind: int
    producer: Producer
    topic: str
    values: FloatArray
    arrival_time: float
    """s, robot's clock."""


class _RefusedError(Exception):
    """Refusal of a sample; the message is the reason."""


class DataSocket(ExternSource, Sink):
    """A source of live inputs that feeds an inbox and a velocity command too, and a sink that follows the mode."""

    def __init__(
        self,
        path: Path,
        inbox: RemoteInbox,
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
            path: where it will be, in a folder that only its user can enter.
            stale_timeout: s after which a remote command is stale, and its producer's turn over.
            velocity: gets velocity commands; None: nothing observes one.
            live: name and width of the live inputs that are observed.
            timeouts: of those that state one, s, also infinite; a producer may only shorten it.
            tell: records a line: owners and refusals as they change.
        """
        self._path = path
        self._socket = listening(path)
        self._most = queue_length() + 1
        self._inbox = inbox
        self._clock = clock
        self._velocity = velocity
        self._widths, self._timeouts = dict(live or {}), dict(timeouts or {})
        self._say = BoundedTelling(tell, clock)  # two producers may quarrel in every tick
        self._turn = Turn(stale_timeout)
        self._live_turns = {name: Turn(math.inf) for name in self._widths}
        self._live: dict[str, Extern] = {}
        self._mode = Mode.ZERO_TORQUE
        self._entered = 0.0
        self._newest_stamp: dict[tuple[int, Producer, str], int] = {}
        self.refusals = Refusals(self._say)
        self._reported: dict[Producer, int] = {}
        """Samples that a producer has refused itself, in all."""
        self.owners: dict[str, str] = {}
        """Name and process id of who commands `REMOTE`, `velocity`, and each live input at present; '' for nobody."""
        self._lost: dict[str, str] = {}
        """Producers that fell silent while they commanded REMOTE or a velocity, until somebody commands it anew."""
        self.heartbeats: dict[str, float] = {}
        """Arrival of the latest heartbeat by its producer's name, s, robot's clock."""
        self.discarded = 0
        """Samples that nobody looked into, because newer ones of their producers came with them."""

    def latest(self) -> Mapping[str, Extern]:
        """Take in what has come since the last call; the live inputs that were ever heard."""
        time = self._clock()
        self._expire(time)
        refused: list[tuple[Producer, str]] = []
        for sample in self._drain(time):
            try:
                self._accept(sample)
            except _RefusedError as refusal:
                refused.append((sample.producer, str(refusal)))
        self._show_owners()
        for producer, reason in refused:
            self.refusals.add(producer, reason)
        self.refusals.flush(time)
        return self._live

    def tick(self, record: TickRecord) -> None:
        """Follow the mode: with REMOTE a turn begins, and only what comes after may take it."""
        mode = record.output.control_mode.mode
        if mode is not self._mode:
            self._mode, self._entered = mode, float(record.input.state.time)
            self._turn.clear()
            self._lost.clear()
            self._show_owners()

    def close(self) -> None:
        """Remove the socket. May be called twice."""
        self._socket.close()
        self._path.unlink(missing_ok=True)

    def _expire(self, time: float) -> None:
        before, moved = self.owners, self._velocity is not None and self._velocity.command.any()
        self._turn.expire(time)
        for name, turn in self._live_turns.items():
            heard = self._live.get(name)
            # A value may count for ever; its producer owns the input only while it may still be there.
            turn.timeout = wire.LIVE_TIMEOUT if heard is None or math.isinf(heard.timeout) else heard.timeout
            turn.expire(time)
        if self._velocity is not None:
            self._velocity.expire(time)
            if moved and before.get("velocity") and not self._velocity.owner:
                self._lost["velocity"] = before["velocity"]
        if self._turn.owner is None and before.get("REMOTE"):
            self._lost["REMOTE"] = before["REMOTE"]

    def _drain(self, time: float) -> list[_Sample]:
        """Return the newest sample of each producer and topic, in the order in which their producers came first."""
        begun = wire.monotonic_ns()
        newest: dict[bytes, tuple[bytes, int]] = {}
        count = 0
        for _ in range(self._most):
            try:
                datagram = self._socket.recv(_LONGEST)
            except OSError:  # nothing more
                break
            count += 1
            # The stamp is the head's last field; what is before it and behind the values' own name tells senders apart.
            head = wire.DATA_HEAD.size
            if len(datagram) < head or not datagram.startswith(wire.DATA_MAGIC):
                continue
            name_end = head + int.from_bytes(datagram[8:10], "little") + int.from_bytes(datagram[10:12], "little")
            newest[datagram[: head - 8] + datagram[head:name_end]] = (datagram, wire.monotonic_ns())
        self.discarded += count - len(newest)
        samples = []
        for datagram, received in list(newest.values())[:_MOST_SAMPLES]:
            sample = self._read(datagram, received, begun, time)
            if sample is not None:
                samples.append(sample)
        return samples

    def _read(self, datagram: bytes, received: int, begun: int, time: float) -> _Sample | None:
        _, kind, _, name_size, topic_size, process, stamp = wire.DATA_HEAD.unpack_from(datagram)
        start = wire.DATA_HEAD.size
        name = datagram[start : start + name_size].decode(errors="replace")
        start += name_size
        topic = datagram[start : start + topic_size].decode(errors="replace")
        body = datagram[start + topic_size :]
        producer = Producer(" ".join(name.split())[:40] or "?", process)
        if len(body) % 8:
            self.refusals.add(
                producer, f"a datagram of {len(datagram)} bytes, expected whole float64 values at its end"
            )
            return None
        if stamp > received:
            self.refusals.add(producer, "a stamp in the future, expected the time of CLOCK_MONOTONIC on this machine")
            return None
        key = (kind, producer, topic)
        if stamp < self._newest_stamp.get(key, 0):  # overtaken on its way
            return None
        if len(self._newest_stamp) > _MOST_STAMPS:
            self._newest_stamp.clear()
        self._newest_stamp[key] = stamp
        arrival = time - 1e-9 * max(begun - stamp, 0)
        return _Sample(kind, producer, topic, np.frombuffer(body, dtype="<f8"), arrival)

    def _accept(self, sample: _Sample) -> None:
        # In the order of their numbers.
        kinds = (self._accept_remote, self._accept_velocity, self._accept_live, self._accept_beat, self._accept_report)
        if sample.kind >= len(kinds):
            raise _RefusedError(f"kind {sample.kind}, expected 0 to {wire.REFUSED}")
        kinds[sample.kind](sample)

    def _accept_beat(self, sample: _Sample) -> None:
        self.heartbeats[sample.producer.name] = sample.arrival_time

    def _accept_remote(self, sample: _Sample) -> None:
        age = self._clock() - sample.arrival_time
        if age > self._turn.timeout:
            raise _RefusedError(
                f"a remote command that is already stale, expected one younger than {self._turn.timeout:g} s"
            )
        is_remote = self._mode is Mode.REMOTE
        if is_remote and sample.arrival_time <= self._entered:
            return  # of before REMOTE was entered: it takes no turn
        if is_remote and self._turn.owner not in (None, sample.producer):
            raise _RefusedError(f"REMOTE: belongs to {self._turn.owner}")
        names = tuple(sample.topic.split("\n"))
        if len(sample.values) != 5 * len(names):
            raise _RefusedError(
                f"remote command: has {len(sample.values)} values, expected 5 for each of {len(names)} joints"
            )
        try:
            self._inbox.put(names, MITCommand(*sample.values.reshape(5, -1)), sample.arrival_time)
        except FieldError as error:
            raise _RefusedError(str(error)) from None
        if is_remote:
            self._turn.admit(sample.producer, sample.arrival_time)

    def _accept_velocity(self, sample: _Sample) -> None:
        if self._velocity is None:
            raise _RefusedError("a velocity command, which the policy does not observe")
        if len(sample.values) != 4 or not np.isfinite(sample.values).all():
            raise _RefusedError("a velocity command that is not four finite numbers: vx, vy, wz, deliberate")
        owner = self._velocity.offer(
            sample.producer,
            sample.values[:3],
            sample.arrival_time,
            timeout=wire.VELOCITY_TIMEOUT,
            deliberate=bool(sample.values[3]),
        )
        if owner != sample.producer and sample.values[:3].any():
            whose = f"controlled by {owner}" if owner else "no longer controlled by anyone"
            raise _RefusedError(f"velocity: {whose}; move a stick or a slider, or press a key, to take it over")

    def _accept_live(self, sample: _Sample) -> None:
        width = self._widths.get(sample.topic)
        if width is None:
            known = ", ".join(self._widths) or "none"
            raise _RefusedError(f"live input '{sample.topic[:40]}' is not observed; the policy observes: {known}")
        given, values = sample.values[:1], sample.values[1:]
        if len(values) != width or not np.isfinite(values).all():
            raise _RefusedError(f"live input '{sample.topic}': has {len(values)} values, expected {width}, all finite")
        timeout = self._timeouts.get(sample.topic, wire.LIVE_TIMEOUT)
        if not np.isnan(given).all():  # its producer says
            if not 0.0 < given <= _LONGEST_TIMEOUT:
                raise _RefusedError(
                    f"live input '{sample.topic}': timeout is {given[0]:g} s, expected 0 to {_LONGEST_TIMEOUT:g} s"
                )
            timeout = min(float(given[0]), self._timeouts.get(sample.topic, math.inf))
        if not self._live_turns[sample.topic].admit(sample.producer, sample.arrival_time):
            raise _RefusedError(f"live input '{sample.topic}': belongs to {self._live_turns[sample.topic].owner}")
        self._live = {**self._live, sample.topic: Extern(values, sample.arrival_time, timeout)}

    def _accept_report(self, sample: _Sample) -> None:
        """Take over what a producer has refused itself: the latest reason, and how many samples in all."""
        if len(sample.values) != 1 or not 0.0 < sample.values[0] < _MOST_REPORTED:
            raise _RefusedError("a report of refusals without a number of them")
        total, before = int(sample.values[0]), self._reported.get(sample.producer, 0)
        if len(self._reported) > _MOST_STAMPS:
            self._reported.clear()
        self._reported[sample.producer] = total
        if total > before:
            self.refusals.add(sample.producer, sample.topic, total - before)

    def status(self) -> dict[str, object]:
        """Return what to tell beside ticks: owners, refusals since they last changed, and in all."""
        return {
            "owners": dict(self.owners),
            "lost": dict(self._lost),
            "refused": list(self.refusals.lines),
            "refused_samples": dict(self.refusals.counts),
            "refused_last": self.refusals.latest,
        }

    def _show_owners(self) -> None:
        """Tell owners as they change."""
        owners = {"REMOTE": str(self._turn.owner or "")}
        if self._velocity is not None:
            owners["velocity"] = str(self._velocity.owner or "")
        owners |= {name: str(turn.owner or "") for name, turn in self._live_turns.items()}
        if owners == self.owners:
            return
        for name, owner in owners.items():
            before = self.owners.get(name, "")
            if owner != before:
                self._say(f"{name}: belongs to {owner}" if owner else f"{name}: no longer controlled by {before}")
        self.owners = owners
        self._lost = {name: before for name, before in self._lost.items() if not owners.get(name)}
        self.refusals.forget()
