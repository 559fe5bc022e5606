"""From DDS to a session: commands for REMOTE, safety statuses and live inputs."""

from __future__ import annotations

import math
import time
from collections import OrderedDict
from collections.abc import Sequence

from humanoid_sim.client import Intake, SessionError, monotonic_ns
from humanoid_sim.controllers.contract import live_topic
from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.attach import Attachment
from humanoid_sim.mit import COMMAND_FIELDS, MITCommand
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
from humanoid_sim.ros2.topics import COMMAND_TOPIC, LIVE_INPUT, SAFETY_TOPIC, TOPICS
from humanoid_sim.session.sources import remote_problem

_SUSPENDED = 0.05  # s between two polls beyond which the process was suspended
_SETTLE = 0.1  # s for which old samples may come in after that: sockets are emptied, and what got lost is sent again
_REPEAT = 0.05  # s between two reports of a source, unless it has just ceased to be OK: a flood costs no more
_MOST_WRITERS = 16  # that are told apart; of more the one that was silent longest is forgotten
_DEPTH = 1024  # samples that may come between two polls: a flood pushes nobody else's command out


class ArrivalClock:
    """Arrival time of what a poll finds, ns of CLOCK_MONOTONIC: that of the poll before, the earliest possible one.

    What lay in a socket while this process was suspended is old when it goes on: until the sockets are empty, the last
    poll before the suspension stands.
    """

    def __init__(self, now: int) -> None:
        self.stamp = self._newest = self._settled = now

    def poll(self, now: int) -> None:
        """Begin a poll."""
        before, self._newest = self._newest, now
        if now - before > 1e9 * _SUSPENDED:
            if before >= self._settled:
                self.stamp = before
            self._settled = now + round(1e9 * _SETTLE)
        elif now >= self._settled:
            self.stamp = before


def read_command(message: bytes, joints: tuple[str, ...]) -> MITCommand:
    """Return the command in a message, shape (n,). Raises `FieldError` or `CdrError` if it is none for this robot."""
    names, command = decode_mit_command(message)
    problem = remote_problem(names, command, joints)
    if problem:
        raise FieldError(problem)
    return command


class StatusForwarder:
    """Hands safety statuses on: a fault at once, everything else at most twenty times a second."""

    def __init__(self, intake: Intake) -> None:
        self._intake = intake
        self._pending: dict[str, tuple[ForeignStatus, int]] = {}
        self._reported: dict[str, tuple[int, float]] = {}
        """By source: the level that the session has, and when it was reported, s."""

    def take(self, status: ForeignStatus, stamp: int, now: float) -> None:
        """Take a status that arrived at `stamp`, ns; `now` is in s."""
        if status.frame == SESSION_FRAME:  # published by a session, this one or another robot's
            return
        name = status.source or "unnamed"
        held = self._pending.get(name)
        if held is not None and held[0].level > 0 and status.level == 0:
            self.flush(now)  # a fault that ends within one poll still damps
            if name in self._pending:
                return  # the session took nothing: the fault stays to be reported
        self._pending[name] = status, stamp

    def flush(self, now: float) -> None:
        """Report what is due."""
        for name, (status, stamp) in list(self._pending.items()):
            level, since = self._reported.get(name, (0, -math.inf))
            if not (status.level and not level) and now - since < _REPEAT:
                continue
            try:
                self._intake.post_safety(name, status.level, status.message, flags=status.flags, stamp=stamp)
            except SessionError:  # it takes nothing at present: again with the next poll
                continue
            del self._pending[name]
            self._reported[name] = status.level, now


class CommandReader:
    """Hands on what programs on a network send. For one thread."""

    def __init__(self, attachment: Attachment, participant: Participant, *, is_local: bool, safety: bool) -> None:
        """Subscribe.

        Args:
            is_local: live inputs are taken too.
            safety: safety statuses are taken: latched ones, and those of writers that do not latch.
        """
        self._session, self._intake = attachment.session, attachment.intake
        self._joints = attachment.header.joint_names
        self._commands = Reader(participant, COMMAND_TOPIC, TOPICS[COMMAND_TOPIC], depth=_DEPTH)
        self._statuses = [
            Reader(participant, SAFETY_TOPIC, TOPICS[SAFETY_TOPIC], depth=_DEPTH, any_writer=any_writer)
            for any_writer in (False, True)
            if safety
        ]
        self._live: list[tuple[str, int, Reader]] = []
        self.topics: set[str] = set()
        """Topics of live inputs."""
        for name, width in attachment.live_inputs.items() if is_local else ():
            topic = live_topic(attachment.contract, name)
            if topic is not None:
                self.topics.add(topic.name)
                kind = LIVE_INPUT._replace(latched=topic.timeout == math.inf)  # one from before the bridge counts too
                for any_writer in (True, False):
                    self._live.append((name, width, Reader(participant, topic.name, kind, any_writer=any_writer)))
        self._safety = StatusForwarder(self._intake)
        self._intakes: OrderedDict[int, Intake] = OrderedDict()
        self._clock = ArrivalClock(monotonic_ns())
        self._refused, self._told = 0, 0.0

    def close(self) -> None:
        """Close what was opened for the writers."""
        for intake in self._intakes.values():
            intake.close()

    def poll(self, timeout: float) -> None:
        """Hand on what has come; waits up to `timeout` s for a command. Raises `SessionError` if the session ended."""
        self._commands.wait(timeout)
        self._clock.poll(monotonic_ns())
        now = time.monotonic()
        for sample in [sample for reader in self._statuses for sample in reader.take()]:
            try:
                self._safety.take(decode_safety_status(sample.data), self._clock.stamp, now)
            except CdrError as error:
                self._refuse(SAFETY_TOPIC, error)
        self._safety.flush(now)
        self._take_commands(self._commands.take())
        for name, width, reader in self._live:
            for sample in reader.take()[-1:]:
                self._take_live(name, width, sample)

    def _take_commands(self, samples: Sequence[Received]) -> None:
        """Hand on the newest command of each writer; the session checks it again, and who may command."""
        newest = {sample.writer: sample for sample in samples}
        for writer, sample in newest.items():
            try:
                command = read_command(sample.data, self._joints)
            except (CdrError, FieldError) as error:
                self._refuse(COMMAND_TOPIC, error)
                continue
            fields = (getattr(command, name).tolist() for name in COMMAND_FIELDS)
            self._intake_of(writer).remote(self._joints, *fields, stamp=self._clock.stamp)

    def _take_live(self, name: str, width: int, sample: Received) -> None:
        try:
            values = decode_float32_array(sample.data)
            if len(values) != width:
                raise FieldError(f"has {len(values)} values, expected {width}")
        except (CdrError, FieldError) as error:
            self._refuse(f"live input '{name}'", error)
            return
        self._intake.live(name, values.tolist(), stamp=self._clock.stamp)

    def _intake_of(self, writer: int) -> Intake:
        """Return a writer's intake: REMOTE belongs to one writer, whichever bridge its commands come by."""
        if writer not in self._intakes:
            if len(self._intakes) >= _MOST_WRITERS:
                self._intakes.popitem(last=False)[1].close()
            self._intakes[writer] = Intake(self._session, f"dds {self._commands.name_of(writer)}", process=0)
        self._intakes.move_to_end(writer)
        return self._intakes[writer]

    def _refuse(self, topic: str, problem: Exception) -> None:
        """Count a sample that is not accepted, and say so once a second."""
        self._refused += 1
        if time.monotonic() - self._told > 1.0:
            print(f"refused: {topic}: {problem}; {self._refused} samples so far", flush=True)
            self._told = time.monotonic()
