"""A bus in front of another one: for whoever wants to see, or to refuse, what passes."""

from __future__ import annotations

import can


class PassingBus(can.BusABC):
    """Passes everything on to another bus, which is shut down with it."""

    def __init__(self, bus: can.BusABC, channel: str) -> None:
        """Take over an open bus; `channel` is its name."""
        self._bus = bus
        super().__init__(channel)
        self._can_protocol = bus.protocol
        self.channel_info = bus.channel_info

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send on the other bus."""
        self._bus.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self._bus._recv_internal(timeout)

    def fileno(self) -> int:
        """Return the file descriptor of the other bus."""
        return self._bus.fileno()

    def shutdown(self) -> None:
        """Shut both down."""
        super().shutdown()
        self._bus.shutdown()
