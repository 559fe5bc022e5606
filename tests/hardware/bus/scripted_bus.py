"""A python-can bus whose every call does what the test says."""

import queue
from collections.abc import Callable

import can


class ScriptedBus(can.BusABC):
    """Receives what is put into `incoming` (an exception is raised); `on_send` is given what is sent, and may raise."""

    def __init__(self) -> None:
        super().__init__(channel="scripted")
        self.incoming: queue.SimpleQueue[can.Message | Exception] = queue.SimpleQueue()
        self.sent: list[can.Message] = []
        self.on_send: Callable[[can.Message], None] = lambda _: None

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
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
