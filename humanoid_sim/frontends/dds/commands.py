"""From DDS to the intake: commands for REMOTE, safety statuses and live inputs, on a thread of their own.

What lay in a socket while this process stood still is old when it goes on, although nobody saw it come: see
`ArrivalClock`.
"""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import NamedTuple

from humanoid_sim.client import Intake, SessionError, SessionInfo, monotonic_ns
from humanoid_sim.controllers.contract import live_topic
from humanoid_sim.errors import FieldError, blaming
from humanoid_sim.frontends.attach import Attachment
from humanoid_sim.mit import MITCommand
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.dds.domain import Participant
from humanoid_sim.ros2.dds.endpoints import Reader, Received
from humanoid_sim.ros2.messages import (
    SESSION_FRAME,
    ForeignStatus,
    decode_float32_array,
    decode_mit_command,
    decode_safety_status,
)
from humanoid_sim.ros2.topics import COMMAND_TOPIC, LIVE_INPUT, SAFETY_TOPIC
from humanoid_sim.session.sources import remote_problem


class Wanted(NamedTuple):
    """A live input that the session takes from outside."""

    topic: str
    width: int
    latched: bool
    """True where a value counts until the next one, so that one from before the bridge does too."""


def wanted_inputs(attachment: Attachment) -> dict[str, Wanted]:
    """Return the live inputs that a session takes from outside, by name."""
    topics = {name: live_topic(attachment.contract, name) for name in attachment.feed.live_inputs}
    return {
        name: Wanted(topic.name, attachment.feed.live_inputs[name], topic.timeout == math.inf)
        for name, topic in topics.items()
        if topic is not None
    }


class LiveForwarder:
    """Hands values on as they arrive. For one thread."""

    def __init__(
        self,
        participant: Participant,
        intake: Intake,
        refuse: Callable[[str, str], None],
        wanted: Mapping[str, Wanted],
    ) -> None:
        """Subscribe to what the session takes; `refuse` counts a message that is not accepted, by topic and reason."""
        self._participant, self._intake, self._refuse = participant, intake, refuse
        self._readers = {name: (one, self._subscribed(one)) for name, one in wanted.items()}

    def take(self, stamp: Callable[[Received], int]) -> None:
        """Hand on the newest value of each; `stamp` gives a sample's arrival, ns."""
        for name, (wanted, readers) in self._readers.items():
            for sample in [one for reader in readers for one in reader.take()[-1:]]:
                try:
                    values = decode_float32_array(sample.data)
                except CdrError as error:
                    self._refuse(wanted.topic, str(error))
                    continue
                if len(values) != wanted.width:
                    problem = f"has {len(values)} values, expected {wanted.width} for the live input '{name}'"
                    self._refuse(wanted.topic, problem)
                    continue
                self._intake.live(name, values.tolist(), stamp=stamp(sample))

    def _subscribed(self, wanted: Wanted) -> Sequence[Reader]:
        """Subscribe reliably, and to writers of any other quality of service as well."""
        kind = LIVE_INPUT._replace(latched=wanted.latched)
        return [Reader(self._participant, wanted.topic, kind, any_writer=any_writer) for any_writer in (True, False)]


_REPEAT = 0.05
"""s between two reports of a source, unless it has just ceased to be OK: a flood costs the session no more."""
_MOST_SOURCES = 64
"""Sources that are told apart; of more the one that reported longest ago is forgotten, and its status stands."""


@dataclass(slots=True)
class _Source:
    pending: ForeignStatus | None = None
    """Latest status that the session does not have yet."""
    stamp: int = 0
    """ns of CLOCK_MONOTONIC, its arrival."""
    is_ok: bool = True
    """True where the session has it as OK, or not at all."""
    reported: float = float("-inf")
    """s, when the session got the latest one."""


class StatusForwarder:
    """Hands statuses on: a fault at once, everything else at most twenty times a second."""

    def __init__(self, intake: Intake, refuse: Callable[[str], None]) -> None:
        """Know of no source yet; `refuse` counts a message that is not a status."""
        self._intake, self._refuse = intake, refuse
        self._sources: OrderedDict[str, _Source] = OrderedDict()

    def take(self, samples: Sequence[Received], stamp: Callable[[Received], int], now: float) -> None:
        """Take in what has come; `stamp` gives a sample's arrival, ns, and `now` is in s."""
        for sample in samples:
            try:
                status = decode_safety_status(sample.data)
            except CdrError as error:
                self._refuse(str(error))
                continue
            if status.frame == SESSION_FRAME:  # published by a session, this one or another robot's
                continue
            source = self._source(status.source)
            if source.pending is not None and source.pending.level > 0 and source.is_ok:
                self._report(source, now)  # a fault that ends within one look still damps
                if source.pending is not None and status.level == 0:
                    continue  # the session took nothing: the fault stays to be reported
            source.pending, source.stamp = status, stamp(sample)
        for source in self._sources.values():
            if source.pending is None:
                continue
            is_news = source.pending.level != 0 and source.is_ok
            if is_news or now - source.reported >= _REPEAT:
                self._report(source, now)

    def _source(self, name: str) -> _Source:
        source = self._sources.get(name)
        if source is None:
            source = self._sources[name] = _Source()
            if len(self._sources) > _MOST_SOURCES:
                self._sources.popitem(last=False)
        self._sources.move_to_end(name)
        return source

    def _report(self, source: _Source, now: float) -> None:
        status = source.pending
        assert status is not None
        try:
            self._intake.post_safety(
                status.source or "unnamed", status.level, status.message, flags=status.flags, stamp=source.stamp
            )
        except SessionError:  # it takes nothing at present: again with the next look
            return
        source.pending, source.is_ok, source.reported = None, status.level == 0, now


_WAIT = 0.005
"""s between two looks at most: by so much a sample may be younger than it is said to be."""
_STOOD_STILL = 0.05
"""s between two looks beyond which the process was suspended."""
_SETTLE = 0.1
"""s for which old samples may come in after that: sockets are emptied, and what got lost is sent again."""
_REPORT_PERIOD = 1.0
"""s between two reports of what was refused."""
_MOST_WRITERS = 16
"""Writers that are told apart; of more the one that was silent longest is forgotten."""
DEPTH = 1024
"""Samples that may come between two looks, of all writers together: a flood pushes nobody else's command out."""
_MOST_READ = 64
"""Samples of one writer that a look reads, the newest ones."""


class ArrivalClock:
    """Arrival times of samples, ns of CLOCK_MONOTONIC: that of the poll before the one that found them."""

    def __init__(self, now: int) -> None:
        """Start; `now` in ns, as all here."""
        self._newest = self._before = now

    def look(self, now: int) -> None:
        """Begin a poll."""
        self._before, self._newest = self._newest, now

    def stamp(self) -> int:
        """Return when a sample that this poll has found arrived, the latest that is certain."""
        return self._before


def read_command(message: bytes, joints: tuple[str, ...]) -> MITCommand:
    """Return the command in a message, shape (n,), one value per joint in each field.

    Raises `FieldError` if it is none, or not one for this robot; one line.
    """
    with blaming("remote command", CdrError, FieldError):
        names, command = decode_mit_command(message)
    problem = remote_problem(names, command, joints)
    if problem:
        raise FieldError(problem)
    return command


class CommandReader:
    """Reads until it is closed, or the session has ended."""

    def __init__(
        self,
        session: SessionInfo,
        joints: tuple[str, ...],
        participant: Participant,
        commands: Reader,
        statuses: Sequence[Reader],
        wanted: Mapping[str, Wanted],
    ) -> None:
        """Prepare to read `/remote_policy_controller/command`, and the `statuses` by which other programs may damp.

        Those are latched, and of any quality of service. `wanted` are the live inputs to take.
        """
        self._wanted = wanted
        self._session, self._joints = session, joints
        self._participant, self._commands, self._statuses = participant, commands, statuses
        self._stack = ExitStack()
        self._intakes: OrderedDict[int, Intake] = OrderedDict()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="DDS commands", daemon=True)
        self._refused = self._reported = 0
        self._reported_at, self._reason = -math.inf, ""
        self.error: Exception | None = None
        """Error that ended reading; None while all is well."""

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def close(self) -> None:
        """Stop. May be called twice."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        for intake in self._intakes.values():
            intake.close()
        self._stack.close()

    def _run(self) -> None:
        clock = ArrivalClock(monotonic_ns())

        def stamp(one: Received) -> int:
            return clock.stamp(one.writer, one.source_ns)

        try:
            own = self._stack.enter_context(Intake(self._session, "dds"))
            safety = StatusForwarder(own, lambda problem: self._refuse(SAFETY_TOPIC, problem))
            live = LiveForwarder(self._participant, own, self._refuse, self._wanted)
            while not self._stop.is_set():
                self._commands.wait(_WAIT)
                clock.look(monotonic_ns())
                taken = [sample for statuses in self._statuses for sample in statuses.take()]
                safety.take(taken, stamp, time.monotonic())
                self._take_commands(clock)
                live.take(stamp)
                self._report(own)
        except SessionError:  # it has ended, as the feed says too
            return
        except Exception as error:  # told by the main thread
            self.error = error

    def _take_commands(self, clock: ArrivalClock) -> None:
        """Hand on the newest command of each writer; the session checks it again, and who may command."""
        newest: dict[int, tuple[MITCommand, int]] = {}
        read: Counter[int] = Counter()
        for sample in reversed(self._commands.take()):
            read[sample.writer] += 1
            if read[sample.writer] > _MOST_READ:
                continue
            try:
                command = read_command(sample.data, self._joints)
            except FieldError as error:
                self._refuse(COMMAND_TOPIC, str(error))
                continue
            if sample.writer not in newest:
                newest[sample.writer] = command, clock.stamp()
        for writer, (command, stamp) in reversed(newest.items()):
            fields = (command.position, command.velocity, command.effort, command.stiffness, command.damping)
            self._intake(writer).remote(self._joints, *map(list, fields), stamp=stamp)

    def _refuse(self, topic: str, problem: str) -> None:
        self._refused += 1
        self._reason = f"{topic}: {problem}"

    def _report(self, own: Intake) -> None:
        """Record what was refused here: at once, and then once a second."""
        now = time.monotonic()
        if self._refused > self._reported and now - self._reported_at >= _REPORT_PERIOD:
            own.post(f"mark {self._refused - self._reported} samples refused, the last: {self._reason}"[:200])
            self._reported, self._reported_at = self._refused, now

    def _intake(self, writer: int) -> Intake:
        """Return a writer's intake: whoever commands REMOTE is one of them, whichever bridge its commands come by."""
        if writer in self._intakes:
            self._intakes.move_to_end(writer)
        else:
            if len(self._intakes) >= _MOST_WRITERS:
                self._intakes.popitem(last=False)[1].close()
            self._intakes[writer] = Intake(self._session, f"dds {self._commands.name_of(writer)}", process=0)
        return self._intakes[writer]
