"""Where the inputs of a tick come from beside the robot: intents, remote commands, live terms. None may block."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Protocol

from humanoid_sim.messages import Intent, RemoteCommand, TickOutput
from humanoid_sim.mit import Extern

__all__ = ["ExternSource", "IntentQueue", "IntentSource", "RemoteSource"]


class IntentSource(Protocol):
    """An operator, a script, a gamepad."""

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Intents since the last call.

        Args:
            time: s, robot's clock.
            output: of the previous tick; None in the first.
        """

    @property
    def finished(self) -> bool:
        """This source wants the session to end."""


class RemoteSource(Protocol):
    """The way in for commands from outside the loop."""

    def latest(self) -> RemoteCommand | None:
        """The latest accepted command, if there ever was one."""


class ExternSource(Protocol):
    """Named live observation terms: piano keys, a velocity command."""

    def latest(self) -> Mapping[str, Extern]:
        """The latest value of every term that was ever heard."""


class IntentQueue:
    """Intents from other threads (a service, a user interface), handed over at the next tick."""

    def __init__(self) -> None:
        self._pending: deque[Intent] = deque()

    def put(self, intent: Intent) -> None:
        """Queue an intent; may be called from any thread."""
        self._pending.append(intent)

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """All queued intents."""
        # Only this side removes, and a deque's ends are atomic: no intent is lost between the two threads.
        return [self._pending.popleft() for _ in range(len(self._pending))]

    @property
    def finished(self) -> bool:
        """A queue never ends a session."""
        return False
