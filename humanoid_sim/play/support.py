"""The support of a free-standing robot in a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from humanoid_sim.messages import Mode

__all__ = ["Supported", "support_listener"]


class Supported(Protocol):
    """A robot whose base hangs on a support."""

    @property
    def supported(self) -> bool:
        """Whether the support holds the base."""

    def set_support(self, held: bool) -> None:
        """Let the support take the base where it now is, or let the base go."""


def support_listener(robot: Supported) -> Callable[[Mode], str]:
    """Lets the robot go when a policy takes over, and holds it again when it no longer balances."""

    def listen(mode: Mode) -> str:
        held = mode not in (Mode.LOCOMOTION, Mode.REMOTE)
        if held == robot.supported:
            return ""
        robot.set_support(held)
        return "support holds the base where it is" if held else "support released"

    return listen
