"""A sink that writes a run to one MCAP file, off the control thread.

The control thread only queues a reference. A thread of its own encodes and writes, and ends a chunk at least every
`FLUSH_PERIOD` of the robot's time and of the wall clock's, so that a killed process loses less than half a second; a
run that need not keep real time waits for a recorder that is behind. If the disk fails, the recording stops and says so
once; the run goes on.
"""

from __future__ import annotations

import fcntl
import io
import math
import os
import threading
from collections import deque
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
from humanoid_sim.recording.topics import ViewerTopics
from humanoid_sim.ros2.definitions import SCHEMA_ENCODING, schema_text
from humanoid_sim.ros2.topics import EVENT_TOPIC, TICK_TOPIC, topic_kind

FLUSH_PERIOD = 0.3  # s after which a chunk is written, full or not
QUEUE_LIMIT = 4096  # ticks that may wait for the writer (20 s at 200 Hz); further ones are left out, which is recorded
_LAG = 0.15  # s of robot time that may wait for the writer before a run that need not keep real time waits for it
_POLL_PERIOD = 0.02  # s between two polls of the queue: waking the writer for every tick would cost the control thread
_CLOSE_TIMEOUT = 30.0  # s that `close` waits for a disk that does not answer


class McapRecorder:
    """Sink that records a run. One instance records one run."""

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        overwrite: bool = True,
        encoded: Callable[[TickRecord], bytes | None] = lambda _: None,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Name the file; `start` creates it, or replaces it if it may.

        Args:
            encoded: returns the message of a tick that was encoded before; None for one that was not.
            tell: called on the writer's thread with the reason why the recording stopped while the run goes on.
        """
        self.path = Path(path)
        self._overwrite, self._encoded, self._tell = overwrite, encoded, tell
        self._queue: deque[tuple[TickRecord, bytes | None] | Event] = deque()
        self._wake, self._is_closing = threading.Event(), False
        self._thread: threading.Thread | None = None
        self._has_ticks = False
        self.backlog_limit = QUEUE_LIMIT
        self.error: str | None = None  # reason why the recording stopped early, in one line
        self.lost = 0  # ticks left out because the writer could not keep up

    @property
    def backlog(self) -> int:
        return 0 if self.error else len(self._queue)

    def start(self, header: SessionHeader) -> None:
        """Create the file and write the header. Raises `InputError` if that fails."""
        file = _UnbufferedFile(self.path, overwrite=self._overwrite)
        try:
            run = _RunWriter(file, header)
        except OSError as error:
            file.close()
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None
        self.backlog_limit = max(round(_LAG / header.control_period), 2)
        self._thread = threading.Thread(target=self._write, args=(run,), name="recorder", daemon=True)
        self._thread.start()

    def tick(self, record: TickRecord) -> None:
        """Queue a tick. Never waits."""
        if self.error is not None or self._thread is None:
            return
        if len(self._queue) >= QUEUE_LIMIT:
            self.lost += 1
            return
        self._has_ticks = True
        self._queue.append((record, self._encoded(record)))
        if 2 * len(self._queue) >= self.backlog_limit:
            self._wake.set()

    def event(self, event: Event) -> None:
        """Queue an event, also before the run begins. Never waits."""
        if self.error is None and not self._is_closing:
            self._queue.append(event)

    def close(self) -> None:
        """Write what is queued, and the index; remove the file of a run without a tick. Never raises: see `error`."""
        self._is_closing = True
        self._wake.set()
        thread, self._thread = self._thread, None
        if thread is None:
            return
        thread.join(_CLOSE_TIMEOUT)
        if thread.is_alive():
            self._fail(f"the disk did not answer for {_CLOSE_TIMEOUT:g} s")
        elif not self._has_ticks and self.path.is_file():
            self.path.unlink()

    def _write(self, run: _RunWriter) -> None:
        """Write, on a thread of its own. Contains every exception: it must not end the run, only the recording."""
        try:
            is_last = False
            while not is_last:
                self._wake.wait(_POLL_PERIOD)
                self._wake.clear()
                is_last = self._is_closing
                while self._queue:
                    run.write(self._queue[0])
                    self._queue.popleft()
                run.flush_if_due()
            run.writer.finish()
        except Exception as error:  # a full disk, or a bug in the encoder; the run is worth more than its recording
            self._tell(self._fail(getattr(error, "strerror", None) or reason_of(error)))
        finally:
            run.file.close()

    def _fail(self, reason: str) -> str:
        self.error = error = f"{self.path}: recording stopped: {reason}"
        return error


class _RunWriter:
    """Encodes ticks and events into the file. Lives on the writer thread, after the header."""

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

    def write(self, item: tuple[TickRecord, bytes | None] | Event) -> None:
        """Write an event; or a tick, encoding it unless that was done, and the viewers' share of it."""
        if isinstance(item, Event):
            self._add(EVENT_TOPIC, encode_event(item), self._log_time(item.time))
            return
        record, message = item
        if record.index != self._index:
            text = f"recording: {record.index - self._index} ticks left out before tick {record.index}"
            self.write(Event(self._time, text, EventKind.LOSS))
        self._index = record.index
        self._time = float(record.input.state.time)
        time_ns = self._log_time(self._time)
        self._add(TICK_TOPIC, encode_tick(record) if message is None else message, time_ns)
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
