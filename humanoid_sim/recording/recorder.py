"""A sink that writes a run to one MCAP file, off the control thread.

In a run with deadlines the control thread only queues a reference, and a thread of its own encodes and writes. A chunk
ends at least every `FLUSH_PERIOD` of the robot's time and of the wall clock's, so that a killed process loses less than
half a second. If the disk fails, the recording stops and says so once; the run goes on.
"""

from __future__ import annotations

import fcntl
import io
import math
import os
from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import IO, Any, cast

from mcap.writer import CompressionType, Writer

from humanoid_sim import __version__
from humanoid_sim.errors import InputError, blaming, reason_of
from humanoid_sim.messages import Event, EventKind, SessionHeader, TickRecord
from humanoid_sim.recording.codec import encode_event, encode_tick
from humanoid_sim.recording.header import write_header
from humanoid_sim.recording.sink import WorkerSink
from humanoid_sim.recording.topics import ViewerTopics
from humanoid_sim.ros2.definitions import SCHEMA_ENCODING, schema_text
from humanoid_sim.ros2.topics import EVENT_TOPIC, TICK_TOPIC, topic_kind

FLUSH_PERIOD = 0.3  # s after which a chunk is written, full or not
_POLL_PERIOD = 0.02  # s between two polls of the queue: waking the writer for every tick would cost the control thread


class McapRecorder(WorkerSink):
    """Sink that records a run. One instance records one run."""

    stuck_after = 30.0  # s: a disk may be slow

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        overwrite: bool = True,
        inline: bool = False,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Name the file; `start` creates it, or replaces it if it may.

        Args:
            inline: write on the control thread, in a run without deadlines.
            tell: called with the reason why the recording stopped while the run goes on.
        """
        super().__init__("recorder", _POLL_PERIOD, inline=inline)
        self.path = Path(path)
        self._overwrite, self._tell = overwrite, tell
        self._has_ticks = False

    def start(self, header: SessionHeader) -> None:
        """Create the file and write the header. Raises `InputError` if that fails."""
        file = _UnbufferedFile(self.path, overwrite=self._overwrite)
        try:
            self._run = _RunWriter(file, header)
        except OSError as error:
            file.close()
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None
        super().start(header)

    def handle_tick(self, record: TickRecord) -> None:
        self._has_ticks = True
        self._run.tick(record)

    def handle_event(self, event: Event) -> None:
        self._run.event(event)

    def handle_pause(self) -> None:
        self._run.flush_if_due()

    def handle_close(self) -> None:
        """Write the index; remove the file of a run without a tick."""
        self._run.writer.finish()
        self._run.file.close()
        if not self._has_ticks and self.path.is_file():
            self.path.unlink()

    def handle_failure(self, error: BaseException) -> str:  # a full disk, or a bug in the encoder
        self._run.file.close()
        reason = getattr(error, "strerror", None) or reason_of(error)
        text = f"{self.path}: recording stopped: {reason}"
        self._tell(text)
        return text


class _RunWriter:
    """Encodes ticks and events into the file, after the header."""

    def __init__(self, file: _UnbufferedFile, header: SessionHeader) -> None:
        self.file = file
        self.writer = Writer(cast("IO[Any]", file), compression=CompressionType.LZ4)
        self.writer.start(profile="ros2", library=f"humanoid_sim {__version__}")
        write_header(self.writer, header)
        self._topics = ViewerTopics(header)
        self._start_time_ns = self._time_ns = header.start_time_ns
        self._time = self._flushed = 0.0
        self._due = monotonic() + FLUSH_PERIOD
        self._index = 0
        self._channels: dict[str, int] = {}

    def event(self, event: Event) -> None:
        self._add(EVENT_TOPIC, encode_event(event), self._log_time(event.time))

    def tick(self, record: TickRecord) -> None:
        if record.index != self._index:
            text = f"recording: {record.index - self._index} ticks left out before tick {record.index}"
            self.event(Event(self._time, text, EventKind.LOSS))
        self._index = record.index
        self._time = float(record.input.state.time)
        time_ns = self._log_time(self._time)
        self._add(TICK_TOPIC, encode_tick(record), time_ns)
        for topic, data, _ in self._topics.messages(record, time_ns):
            self._add(topic, data, time_ns)
        self._index += 1
        self.flush_if_due()

    def flush_if_due(self) -> None:
        """End the chunk and hand it to the operating system after a period of either clock."""
        if abs(self._time - self._flushed) < FLUSH_PERIOD and monotonic() < self._due:
            return
        self.writer.flush()
        self._flushed, self._due = self._time, monotonic() + FLUSH_PERIOD

    def _log_time(self, time: float) -> int:
        """Nanoseconds of the file's clock, which unlike the robot's neither runs backwards nor is ever no number."""
        if math.isfinite(time) and abs(time) < 1e9:
            self._time_ns = max(self._time_ns, self._start_time_ns + round(time * 1e9))
        return self._time_ns

    def _add(self, topic: str, data: bytes, time_ns: int) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            schema = topic_kind(topic).schema
            schema_id = self.writer.register_schema(schema, SCHEMA_ENCODING, schema_text(schema).encode())
            channel = self._channels[topic] = self.writer.register_channel(topic, "cdr", schema_id)
        self.writer.add_message(channel, time_ns, data, time_ns, self._index & 0xFFFFFFFF)


class _UnbufferedFile:
    """A file of this session alone, without a buffer: after a failed write closing has nothing to try again."""

    def __init__(self, path: Path, *, overwrite: bool) -> None:
        flags = os.O_WRONLY | os.O_CREAT | (0 if overwrite else os.O_EXCL)
        with blaming(f"{path}: cannot be written", OSError):
            self._raw = io.FileIO(os.open(path, flags, 0o666), "w")  # not emptied yet: another session may write it
        try:
            fcntl.flock(self._raw, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._raw.close()
            raise InputError(f"{path}: is being written by another session, choose another name") from None
        if path.is_file():
            self._raw.truncate()
        self.tell, self.flush, self.close = self._raw.tell, self._raw.flush, self._raw.close

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while view:
            view = view[self._raw.write(view) :]
        return len(data)
