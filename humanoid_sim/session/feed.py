"""Feed of a session for other programs on the machine: ticks, events and a status in shared memory.

Written without a lock and without a system call. The memory has no name in any folder, and it is sealed: nobody else
can write to it, shorten it or remove it, not even a program of the same user, and it is gone with its last process. So
whoever reads (`humanoid_sim.client.Feed`) can neither hold the writer up nor harm it, and nothing is ever read back
from it. A sample carries its number and a checksum, so a reader that was overtaken knows.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import mmap
import os
import zlib
from collections import deque
from collections.abc import Mapping
from pathlib import Path

from humanoid_sim import client as wire
from humanoid_sim.errors import blaming
from humanoid_sim.messages import Event, SessionHeader, TickRecord
from humanoid_sim.recording.codec import TickEncoder, encode_event
from humanoid_sim.recording.header import header_metadata
from humanoid_sim.ros2.definitions import EVENT, TICK, schema_text
from humanoid_sim.session.sinks import Sink

MODEL_BLOB = "model.mjb"
"""The robot's compiled model; `qpos` of the ticks is its."""
_TICKS, _EVENTS, _STATUSES = 64, 256, 4
"""Samples that each ring holds: a reader that looks 10 times a second sees every tick of a loop at 200 Hz."""
_EVENT_SIZE, _STATUS_SIZE = 1024, 1 << 16
"""Bytes; a longer event is cut, a longer status is left out."""
_ROOM = 1 << 14
"""Bytes for what a tick holds beside its numbers: texts, live inputs."""
_PAGE = 4096
_MFD_NOEXEC_SEAL, _F_SEAL_FUTURE_WRITE = 0x8, 0x10
"""Constants of Linux 6.3 and 5.1 that Python does not name. The second forbids writing except by present mappings."""


class _Ring:
    """A ring in the feed, of one writer."""

    def __init__(self, memory: mmap.mmap, offset: int, slots: int, size: int) -> None:
        self._memory = memory
        self._offset = offset
        self._slots = slots
        self._size = size
        self._number = 0

    def put(self, data: bytes) -> bool:
        """Make these bytes the newest sample; whether they fit."""
        length = len(data)
        if length > self._size - wire.SLOT_HEAD.size:
            return False
        memory = self._memory
        self._number = number = self._number + 1
        stamp = wire.monotonic_ns()
        start = self._offset + 64 + (number % self._slots) * self._size
        wire.SLOT_HEAD.pack_into(
            memory,
            start,
            number,
            stamp,
            length,
            zlib.crc32(data, zlib.crc32(wire.SLOT_SUM.pack(number, stamp, length))),
        )
        start += wire.SLOT_HEAD.size
        memory[start : start + length] = data
        wire.RING_HEAD.pack_into(memory, self._offset, number)
        return True


class FeedWriter(Sink):
    """Sink that publishes a run."""

    def __init__(
        self,
        header: SessionHeader,
        blobs: Mapping[str, bytes] | None = None,
        live_inputs: Mapping[str, int] | None = None,
    ) -> None:
        """Make the memory, with what interprets the run. Raises `InputError` if it cannot be made.

        Args:
            blobs: files by name, beside the header's attachments.
            live_inputs: name and width of those that the session takes from outside.
        """
        self.left_out = 0
        """Ticks that did not fit."""
        self._latest: tuple[TickRecord, bytes] | None = None
        self._encoder = TickEncoder(len(header.joint_names))
        self._pending: deque[Event] = deque(maxlen=_EVENTS)
        files = {**header.attachments, **(blobs or {})}
        described = {
            "joint_names": header.joint_names,
            "control_period": header.control_period,
            **_described(header, live_inputs),
            "definitions": {"tick": schema_text(TICK), "event": schema_text(EVENT)},
        }
        places, offset = _placed(files)
        rings: dict[str, tuple[int, int, int]] = {}
        for name, slots, size in (
            ("tick", _TICKS, _tick_size(header)),
            ("event", _EVENTS, _EVENT_SIZE),
            ("status", _STATUSES, _STATUS_SIZE),
        ):
            rings[name] = (offset, slots, size)
            offset = _aligned(offset + 64 + slots * size)
        self._handle, self._memory = _filled({**described, "rings": rings}, files, places, offset)
        self.path = Path(f"/proc/{os.getpid()}/fd/{self._handle}")
        """By which this user's other programs open it for reading."""
        self._ticks, self._events, self._statuses = (_Ring(self._memory, *place) for place in rings.values())
        for place, slots, size in rings.values():  # every page is mapped before the loop begins
            for at in range(place, place + 64 + slots * size, _PAGE):
                self._memory[at] = 0

    def tick(self, record: TickRecord) -> None:
        """Publish a tick, and the events before it."""
        message = self._encoder.encode(record)
        self._latest = (record, message)
        self.left_out += not self._ticks.put(message)
        if self._pending:
            self._publish_events()

    def encoded(self, record: TickRecord) -> bytes | None:
        """Give the message of the latest tick, for a recorder that need not encode it again; None of any other one."""
        return self._latest[1] if self._latest is not None and self._latest[0] is record else None

    def event(self, event: Event) -> None:
        """Publish an event with the next tick; may be called from any thread."""
        self._pending.append(event)

    def status(self, told: Mapping[str, object]) -> None:
        """Publish what is told beside ticks; from one thread."""
        self._statuses.put(json.dumps(told).encode())

    def close(self) -> None:
        """Say that the session has ended, and let the memory go; readers keep what they have mapped."""
        if self._memory.closed:
            return
        self._publish_events()
        self._memory[wire.ENDED_OFFSET] = 1
        self._memory.close()
        os.close(self._handle)

    def _publish_events(self) -> None:
        while self._pending:
            event = self._pending.popleft()
            # A character takes four bytes at most.
            text = event.text if len(event.text) <= _EVENT_SIZE // 5 else f"{event.text[: _EVENT_SIZE // 5]} …"
            self._events.put(encode_event(Event(event.time, text, event.kind)))


def _described(header: SessionHeader, live_inputs: Mapping[str, int] | None) -> dict[str, object]:
    """Describe what changes with the policy."""
    session, documents = header_metadata(header)
    return {"live_inputs": dict(live_inputs or {}), "header": {"session": session, "documents": documents}}


def _placed(files: Mapping[str, bytes]) -> tuple[dict[str, tuple[int, int]], int]:
    """Place files behind the first page: offset and length of each, and the offset behind them all."""
    offset, places = _PAGE, {}
    for name, data in files.items():
        places[name] = (offset, len(data))
        offset = _aligned(offset + len(data))
    return places, offset


def _filled(
    described: Mapping[str, object], files: Mapping[str, bytes], places: Mapping[str, tuple[int, int]], offset: int
) -> tuple[int, mmap.mmap]:
    """Make memory with files at their places and, at `offset`, the description of it all.

    Raises `InputError` if it cannot be had.
    """
    text = json.dumps({**described, "blobs": places}).encode()
    with blaming(f"the feed: {offset + len(text)} bytes cannot be had", OSError):
        handle, memory = _sealed_memory(offset + len(text))
    for name, (place, length) in places.items():
        memory[place : place + length] = files[name]
    memory[offset : offset + len(text)] = text
    wire.FEED_HEAD.pack_into(memory, 0, wire.FEED_MAGIC, offset, len(text), zlib.crc32(text), 0)
    return handle, memory


def _sealed_memory(size: int) -> tuple[int, mmap.mmap]:
    """Memory that only this process writes to, and nobody can resize: its file, and what is mapped of it."""
    name, flags = "humanoid_sim feed", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING
    try:
        handle = os.memfd_create(name, flags | _MFD_NOEXEC_SEAL)
    except OSError:  # an older kernel
        handle = os.memfd_create(name, flags)
    try:
        os.fchmod(handle, 0o600)
        # Taken now, whole: memory that is not there when it is written to would be a signal, not an exception.
        os.posix_fallocate(handle, 0, size)
        memory = mmap.mmap(handle, size)
        fcntl.fcntl(handle, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW)
        with contextlib.suppress(OSError):  # an older kernel
            fcntl.fcntl(handle, fcntl.F_ADD_SEALS, _F_SEAL_FUTURE_WRITE)
        fcntl.fcntl(handle, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SEAL)
    except OSError:
        os.close(handle)
        raise
    return handle, memory


def _tick_size(header: SessionHeader) -> int:
    """Bytes of a slot: all numbers of a tick of this robot, and room for what is beside them."""
    joints = len(header.joint_names)
    policies = json.loads(header.documents.get("policies", "{}")).values()
    widths = [sum(width for _, width in header.observation_terms), *(one["observation_width"] for one in policies)]
    observation = max(widths)
    numbers = 4 * joints + 5 * joints + (joints + 64) + 5 * joints + observation + joints
    return _aligned(8 * numbers + _ROOM)


def _aligned(offset: int) -> int:
    return -(-offset // _PAGE) * _PAGE
