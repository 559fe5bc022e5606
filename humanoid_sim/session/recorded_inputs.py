"""Inputs of a recorded run, repeated at the same times: intents, remote commands, live inputs, safety statuses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from humanoid_sim.messages import EventKind, Intent, RemoteCommand, SafetyStatus, TickOutput, TickRecord
from humanoid_sim.mit import VELOCITY_COMMAND, Extern
from humanoid_sim.recording.reader import Entry
from humanoid_sim.session.sources import RemoteSource, VelocityCommand


class RecordedInputs:
    """Plays a recording's inputs, each tick's at its time on the robot's clock.

    It ends where the recorded run was about to end, where another policy was loaded, or where an operator had the robot
    reactivated: what followed was for that policy, or began afresh. The last values of data stay, and grow old as any
    that are not repeated.
    """

    def __init__(
        self,
        entries: Iterator[Entry],
        control_period: float,
        clock: Callable[[], float],
        *,
        measured: Sequence[str] = (),
        repeats_safety: bool = True,
    ) -> None:
        """Prepare.

        Args:
            entries: of the recording, from the tick on with which the run begins.
            measured: names of live inputs that the robot reports itself.
            repeats_safety: whether safety statuses of sources that the robot does not have are repeated too.
        """
        self._entries = entries
        self._tolerance = 0.5 * control_period
        self._clock = clock
        self._measured = frozenset(measured)
        self._repeats_safety = repeats_safety
        self._is_ending = False
        self._is_cancelled = False
        self._record: TickRecord | None = None
        self._next = self._take()
        self._is_asked = False
        self.velocity: VelocityCommand | None = None
        """Velocity that replaces the recorded one once somebody has changed it."""
        self.leaves_velocity = False
        """True if another velocity was set from the beginning."""

    def _take(self) -> TickRecord | None:
        for entry in self._entries:
            if isinstance(entry, TickRecord):
                return entry
            if entry.kind in (EventKind.FRESH_START, EventKind.POLICY):
                return None
            self._is_ending = self._is_ending or entry.kind is EventKind.ENDING
        return None

    def _now(self) -> TickRecord | None:
        """Return the recorded tick of this moment."""
        due = self._clock() + self._tolerance
        while self._next is not None and float(self._next.input.state.time) <= due:
            self._record, self._next = self._next, self._take()
            self._is_asked = False
        return self._record

    @property
    def finished(self) -> bool:
        """The recorded run was about to end, or nothing more is recorded."""
        return self._is_ending or self._next is None

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Return the recorded intents of this tick."""
        record = self._now()
        if record is None or self._is_asked or self._is_cancelled:
            return ()
        self._is_asked = True
        return record.input.intents

    def cancel(self) -> None:
        """Stop all further intents, for an operator has taken over. Data stays as recorded."""
        self._is_cancelled = True

    def note_safety(self, statuses: Sequence[SafetyStatus]) -> None:
        """Ignore the safety: the recorded intents come whatever happens, as they did."""

    def latest(self) -> Mapping[str, Extern]:
        """Return the recorded live inputs of this tick that the robot does not report itself."""
        record = self._now()
        if record is None:
            return {}
        is_changed = self.leaves_velocity or (self.velocity is not None and bool(self.velocity.owner))
        left_out = self._measured | ({VELOCITY_COMMAND} if is_changed else set())
        return {name: value for name, value in record.input.state.extern.items() if name not in left_out}

    def remote(self, inbox: RemoteSource) -> RemoteSource:
        """Return the recorded remote commands, until one arrives by `inbox`."""
        return _Either(inbox, self)

    @property
    def recorded_remote(self) -> RemoteCommand | None:
        """Return the recorded command of this tick."""
        record = self._now()
        return None if record is None else record.input.remote

    def safety(self, statuses: tuple[SafetyStatus, ...]) -> tuple[SafetyStatus, ...]:
        """Return the robot's statuses, and the recorded ones of other sources."""
        record = self._now() if self._repeats_safety else None
        if record is None or self._clock() > float(record.input.state.time) + self._tolerance:
            return statuses
        own = {status.source for status in statuses}
        return (*statuses, *(status for status in record.input.safety if status.source not in own))


class _Either(RemoteSource):
    def __init__(self, inbox: RemoteSource, inputs: RecordedInputs) -> None:
        self._inbox, self._inputs = inbox, inputs

    def latest(self) -> RemoteCommand | None:
        command = self._inbox.latest()
        return self._inputs.recorded_remote if command is None else command
