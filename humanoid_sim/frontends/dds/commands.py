"""From DDS to the intake: commands for REMOTE, safety statuses and live inputs, on a thread of their own.

What lay in a socket while this process stood still is old when it goes on, although nobody saw it come: see
`ArrivalClock`.
"""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, OrderedDict
from collections.abc import Mapping, Sequence
from contextlib import ExitStack

from humanoid_sim.client import Intake, Looks, SessionError, SessionInfo, monotonic_ns
from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.dds.live import LiveForwarder, Wanted
from humanoid_sim.frontends.dds.safety import StatusForwarder
from humanoid_sim.mit import MITCommand
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.dds.domain import Participant
from humanoid_sim.ros2.dds.endpoints import Reader, Received
from humanoid_sim.ros2.messages import decode_mit_command
from humanoid_sim.ros2.topics import COMMAND_TOPIC, SAFETY_TOPIC
from humanoid_sim.session.sources import remote_problem

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
    """Arrival times of samples, in ns of CLOCK_MONOTONIC.

    A sample is stamped with the time of the look before the one that found it, as `Looks` says. One that is found after
    a suspension is as much later than its writer's last one before it as the writer's clock says, within that time:
    only differences of that clock count, not what it shows.
    """

    def __init__(self, now: int) -> None:
        """Start; `now` in ns, as all here."""
        self._looks = Looks(_STOOD_STILL, _SETTLE, now)
        self._last: OrderedDict[int, tuple[int, int]] = OrderedDict()

    def look(self, now: int) -> None:
        """Begin a look."""
        self._looks.look(now)

    def stamp(self, writer: int, source: int) -> int:
        """Return when a sample that this look has found arrived, the latest that is certain.

        `source` is when it was written, ns by its writer's own clock.
        """
        first = self._looks.stamp
        if self._looks.is_settling:
            last_source, last = self._last.get(writer, (source, first))
            return min(max(last + source - last_source, first), self._looks.newest)
        self._last[writer] = source, first
        self._last.move_to_end(writer)
        if len(self._last) > _MOST_WRITERS:
            self._last.popitem(last=False)
        return first


def read_command(message: bytes, joints: tuple[str, ...]) -> MITCommand:
    """Return the command in a message, shape (n,), one value per joint in each field.

    Raises:
        FieldError: it is none, or not one for this robot; one line.
    """
    try:
        names, command = decode_mit_command(message)
    except CdrError as error:
        raise FieldError(f"remote command: {error}") from None
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
        statuses: Sequence[Reader] = (),
    ) -> None:
        """Prepare to read `/remote_policy_controller/command`, and the `statuses` by which other programs may damp.

        Those are latched, and of any quality of service.
        """
        self._session, self._joints = session, joints
        self._participant, self._commands, self._statuses = participant, commands, statuses
        self.wanted: Mapping[str, Wanted] = {}
        """Live inputs to take; may be replaced from any thread."""
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
            live = LiveForwarder(self._participant, own, self._refuse)
            while not self._stop.is_set():
                self._commands.wait(_WAIT)
                clock.look(monotonic_ns())
                taken = [sample for statuses in self._statuses for sample in statuses.take()]
                safety.take(taken, stamp, time.monotonic())
                self._take_commands(clock)
                live.follow(self.wanted)
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
                newest[sample.writer] = command, clock.stamp(sample.writer, sample.source_ns)
        for writer, (command, stamp) in reversed(newest.items()):
            fields = (command.position, command.velocity, command.effort, command.stiffness, command.damping)
            self._intake(writer).remote(self._joints, *map(list, fields), stamp=stamp)

    def _refuse(self, topic: str, problem: str) -> None:
        self._refused += 1
        self._reason = f"{topic}: {problem}"

    def _report(self, own: Intake) -> None:
        """Tell the session what was refused here: at once, and then once a second."""
        now = time.monotonic()
        is_due = self._refused > self._reported and now - self._reported_at >= _REPORT_PERIOD
        if is_due and own.refused(self._reason, self._refused):
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
