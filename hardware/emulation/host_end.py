"""The computer's end of a channel with faults of its own: what a driver answers when frames cannot leave."""

from __future__ import annotations

import errno
from collections.abc import Callable

import can

__all__ = ["FaultyBus"]


class FaultyBus(can.BusABC):
    """Passes everything on to another bus, unless a fault says otherwise.

    The errors are those that SocketCAN raises: ENOBUFS where the queue is full, ENETDOWN after bus-off.
    """

    def __init__(self, bus: can.BusABC, channel: str, fault: Callable[[], str]) -> None:
        """Take over a bus.

        Args:
            bus: open; it is shut down with this one.
            channel: its name.
            fault: what is wrong now: `bus_off`, `enobufs`, or nothing (empty).
        """
        self._bus = bus
        self._fault = fault
        super().__init__(channel)
        self._can_protocol = bus.protocol
        self.channel_info = bus.channel_info

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send, or raise.

        Raises:
            can.CanOperationError: with the error number of the fault.
        """
        fault = self._fault()
        if fault == "enobufs":
            raise can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS)
        if fault == "bus_off":
            raise can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)
        self._bus.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self._bus._recv_internal(timeout)

    def fileno(self) -> int:
        """Of the other bus."""
        return self._bus.fileno()

    def shutdown(self) -> None:
        """Shut both down."""
        super().shutdown()
        self._bus.shutdown()
