"""Sends a run to other programs: each tick as a datagram to every subscriber, without waiting for any.

`humanoid_sim.client.Feed` is the other end. A subscriber that is slow loses ticks; one that has gone is forgotten.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Mapping
from pathlib import Path

from humanoid_sim.client import FEED_HEAD, STATUS, TICK, monotonic_ns
from humanoid_sim.errors import blaming
from humanoid_sim.messages import SessionHeader, TickRecord
from humanoid_sim.recording.codec import encode_tick
from humanoid_sim.recording.header import header_fields
from humanoid_sim.recording.sink import Sink
from humanoid_sim.ros2.definitions import TICK as TICK_MESSAGE
from humanoid_sim.ros2.definitions import schema_text
from humanoid_sim.session.datagrams import Mailbox

MODEL_BLOB = "model.mjb"
"""The robot's compiled model; `qpos` of the ticks is its."""
_ACCEPT_EVERY = 8  # ticks, while there are subscribers: 7 µs each time


class FeedWriter(Sink):
    """Sink that sends a run to its subscribers."""

    def __init__(
        self,
        folder: Path,
        header: SessionHeader,
        blobs: Mapping[str, bytes] | None = None,
        live_inputs: Mapping[str, int] | None = None,
    ) -> None:
        """Write what interprets the run into the session's folder, and open its socket there.

        Args:
            blobs: files by name, beside the header's attachments.
            live_inputs: name and width of those that the session takes from outside.
        """
        described = {
            "live_inputs": dict(live_inputs or {}),
            "header": {"session": header_fields(header), "documents": dict(header.documents)},
            "definition": schema_text(TICK_MESSAGE),
        }
        with blaming(folder, OSError):
            (folder / "files").mkdir()
            for name, data in {**header.attachments, **(blobs or {})}.items():
                (folder / "files" / name).write_bytes(data)
            (folder / "header.json").write_text(json.dumps(described), encoding="utf-8")
        self._mailbox = Mailbox(folder / "ticks")
        self._subscribers: dict[str, socket.socket] = {}
        self._number = 0
        self._status = b"{}"

    def tick(self, record: TickRecord) -> None:
        self._number += 1
        if not self._subscribers or self._number % _ACCEPT_EVERY == 0:
            self._accept()
        if self._subscribers:
            self._send(TICK, self._number, encode_tick(record))

    def status(self, fields: Mapping[str, object]) -> None:
        """Send what is not in ticks; from one thread."""
        self._status = json.dumps(fields).encode()
        self._send(STATUS, 0, self._status)

    def close(self) -> None:
        self._mailbox.close()
        while self._subscribers:
            self._subscribers.popitem()[1].close()

    def _accept(self) -> None:
        for _, path in self._mailbox.take():
            if not isinstance(path, str):
                continue
            subscriber = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
            try:
                subscriber.connect(path)
                subscriber.send(FEED_HEAD.pack(STATUS, 0, monotonic_ns()) + self._status)
            except OSError:  # it has gone already
                subscriber.close()
            else:
                self._subscribers[path] = subscriber

    def _send(self, kind: int, number: int, message: bytes) -> None:
        datagram = FEED_HEAD.pack(kind, number, monotonic_ns()) + message
        for path, subscriber in tuple(self._subscribers.items()):
            try:
                subscriber.send(datagram)
            except BlockingIOError:  # it is slow
                continue
            except OSError:  # it has gone
                subscriber.close()
                self._subscribers.pop(path, None)
