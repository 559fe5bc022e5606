"""From DDS to the intake: safety statuses of other programs, which can only damp."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from humanoid_sim.client import Intake, SessionError
from humanoid_sim.ros2.cdr import CdrError
from humanoid_sim.ros2.dds.endpoints import Received
from humanoid_sim.ros2.messages import SESSION_FRAME, ForeignStatus, decode_safety_status

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
