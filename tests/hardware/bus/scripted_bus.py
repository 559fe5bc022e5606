"""A python-can bus whose every call does what the test says."""

import queue
import time
from collections.abc import Callable

import can


class ScriptedBus(can.BusABC):
    """Receives what is put into `incoming` (an exception is raised); `on_send` is given what is sent, and may raise."""

    def __init__(self) -> None:
        super().__init__(channel="scripted")
        self.incoming: queue.SimpleQueue[can.Message | Exception] = queue.SimpleQueue()
        self.sent: list[can.Message] = []
        self.on_send: Callable[[can.Message], None] = lambda _: None
        self.fails_always: Exception | None = None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self.fails_always is not None:
            raise self.fails_always
        try:
            item = self.incoming.get(timeout=timeout)
        except queue.Empty:
            return None, False
        if isinstance(item, Exception):
            raise item
        return item, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.on_send(msg)
        self.sent.append(msg)


def error_frame(error_class: int, data: bytes = bytes(8)) -> can.Message:
    """As SocketCAN delivers one."""
    return can.Message(
        arbitration_id=error_class, data=data, is_error_frame=True, is_extended_id=False, timestamp=time.time()
    )
