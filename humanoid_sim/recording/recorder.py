"""A sink that writes a run to one MCAP file, off the control thread.

The control thread only queues a reference. A thread of its own encodes and writes, and ends a chunk at least every
`FLUSH_PERIOD` of the robot's time or of the wall clock's, whichever is first, so that a killed process loses less than
half a second of either; a run that need not keep real time waits for a recorder that is behind. If the disk fails, the
recording stops and says so once; the run goes on.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from time import monotonic, sleep
from typing import IO, Any, cast

from mcap.writer import CompressionType, Writer

from humanoid_sim import __version__
from humanoid_sim.errors import InputError
from humanoid_sim.files import exclusive_file
from humanoid_sim.messages import Event, EventKind, SessionHeader, TickRecord
from humanoid_sim.recording.codec import encode_event, encode_tick
from humanoid_sim.recording.header import write_header
from humanoid_sim.recording.topics import TopicMessage, ViewerTopics
from humanoid_sim.ros2.definitions import EVENT, SCHEMA_ENCODING, TICK, schema_text
from humanoid_sim.ros2.topics import kind_of

TICK_TOPIC = "/humanoid_sim/tick"
EVENT_TOPIC = "/humanoid_sim/event"

FLUSH_PERIOD = 0.3  # s after which a chunk is written, full or not
QUEUE_LIMIT = 4096  # ticks that may wait for the writer (20 s at 200 Hz); further ones are left out, which is recorded
_LAG = 0.15  # s of robot time that may wait for the writer before a run that need not keep real time waits for it
_POLL_PERIOD = 0.02  # s between two polls of the queue: waking the writer for every tick would cost the control thread
_BATCH = 8  # ticks written in one go, 0.2 ms for which the control thread may be kept out of the interpreter
_CLOSE_TIMEOUT = 30.0  # s that `close` waits for a disk that does not answer

_QOS = """\
- history: 1
  depth: {depth}
  reliability: 1
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: 1
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""
"""QoS with which `ros2 bag play` offers a topic, in the numbers of rmw_qos_profile_t: keep last, reliable."""


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
        self._queue: SimpleQueue[tuple[TickRecord, bytes | None] | Event] = SimpleQueue()
        self._stop, self._wake = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None
        self._queued = self._written = 0
        self.backlog_limit = QUEUE_LIMIT
        self.error: str | None = None
        """Reason why the recording stopped early, in one line."""
        self.lost = 0
        """Ticks left out because the writer could not keep up."""

    @property
    def backlog(self) -> int:
        """Ticks queued but not yet written into a chunk."""
        return 0 if self.error else self._queued - self._written

    def start(self, header: SessionHeader) -> None:
        """Create the file and write the header.

        Raises `InputError` if the file cannot be written, or another session writes it.
        """
        file = _UnbufferedFile(self.path, overwrite=self._overwrite)
        try:
            run = _RunWriter(file, header)
        except OSError as error:
            file.close()
            self._remove()
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None
        self.backlog_limit = max(round(_LAG / header.control_period), 2)
        self._thread = threading.Thread(target=self._write, args=(run,), name="recorder", daemon=True)
        self._thread.start()

    def tick(self, record: TickRecord) -> None:
        """Queue a tick. Never waits."""
        if self.error is not None or self._thread is None:
            return
        if self._queued - self._written >= QUEUE_LIMIT:
            self.lost += 1
            return
        self._queued += 1
        self._queue.put((record, self._encoded(record)))
        if 2 * (self._queued - self._written) >= self.backlog_limit:
            self._wake.set()

    def event(self, event: Event) -> None:
        """Queue an event, also before the run begins. Never waits."""
        if self.error is None and not self._stop.is_set() and self._queue.qsize() < 2 * QUEUE_LIMIT:
            self._queue.put(event)

    def close(self) -> None:
        """Write what is queued, and the index; remove the file of a run without a tick. Never raises: see `error`."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self._stop.set()
        self._wake.set()
        thread.join(_CLOSE_TIMEOUT)
        if thread.is_alive():
            self._fail(f"the disk did not answer for {_CLOSE_TIMEOUT:g} s")
        elif not self._queued and self.error is None:
            self._remove()

    def _remove(self) -> None:
        with suppress(OSError):
            if self.path.is_file() and not self.path.is_symlink():
                self.path.unlink()

    def _write(self, run: _RunWriter) -> None:
        """Write, on a thread of its own. Contains every exception: it must not end the run, only the recording."""
        try:
            self._drain_until_stopped(run)
            run.finish(self.lost)
        except Exception as error:  # a full disk, or a bug in the encoder; the run is worth more than its recording
            reason = error.strerror if isinstance(error, OSError) else f"{type(error).__name__}: {error}"
            self._tell(self._fail(reason or str(error)))
        finally:
            run.file.close()

    def _drain_until_stopped(self, run: _RunWriter) -> None:
        next_flush, is_last = monotonic() + FLUSH_PERIOD, False
        while not is_last:
            self._wake.wait(_POLL_PERIOD)
            self._wake.clear()
            is_last = self._stop.is_set()
            while True:
                if run.is_due or monotonic() >= next_flush:
                    run.flush()
                    next_flush = monotonic() + FLUSH_PERIOD
                try:
                    item = self._queue.get_nowait()
                except Empty:
                    break
                if isinstance(item, Event):
                    run.event(item)
                else:
                    run.tick(*item)
                    self._written += 1
                if self._written % _BATCH == 0:
                    sleep(0)  # lets the control thread in

    def _fail(self, reason: str) -> str:
        self.error = error = f"{self.path}: recording stopped: {reason}"
        return error


class _RunWriter:
    """Encodes ticks and events into the file. Lives on the writer thread, after the header."""

    def __init__(self, file: _UnbufferedFile, header: SessionHeader) -> None:
        self.file = file
        self._writer = Writer(cast("IO[Any]", file), compression=CompressionType.LZ4)
        self._writer.start(profile="ros2", library=f"humanoid_sim {__version__}")
        write_header(self._writer, header)
        self._topics = ViewerTopics(header)
        self._start_time_ns = self._time_ns = header.start_time_ns
        self._time = self._flushed = 0.0
        self._index = 0
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def tick(self, record: TickRecord, message: bytes | None = None) -> None:
        """Write one tick, encoding it unless that was done, and the viewers' share of it."""
        if record.index != self._index:
            text = f"recording: {record.index - self._index} ticks left out before tick {record.index}"
            self.event(Event(self._time, text, EventKind.LOSS))
        self._index = record.index + 1
        self._time = float(record.input.state.time)
        time_ns = self._log_time(self._time)
        encoded = encode_tick(record) if message is None else message
        self._add(TopicMessage(TICK_TOPIC, TICK, encoded), time_ns, record.index)
        for shown in self._topics.messages(record, time_ns):
            self._add(shown, time_ns, record.index)

    def event(self, event: Event) -> None:
        self._add(TopicMessage(EVENT_TOPIC, EVENT, encode_event(event)), self._log_time(event.time), self._index)

    @property
    def is_due(self) -> bool:
        """True if what is not yet written is a whole period of the robot's time; also for NaN."""
        return not abs(self._time - self._flushed) < FLUSH_PERIOD

    def flush(self) -> None:
        """End the chunk and hand it to the operating system."""
        self._writer.flush()
        self._flushed = self._time

    def finish(self, lost: int) -> None:
        """Write the index. `lost` is the number of ticks left out."""
        if lost:
            self.event(Event(self._time, f"recording: {lost} ticks left out in all", EventKind.LOSS))
        self._writer.finish()

    def _log_time(self, time: float) -> int:
        """Nanoseconds of the file's clock, which unlike the robot's neither runs backwards nor is ever no number."""
        if math.isfinite(time) and abs(time) < 1e9:
            self._time_ns = max(self._time_ns, self._start_time_ns + round(time * 1e9))
        return self._time_ns

    def _add(self, message: TopicMessage, time_ns: int, index: int) -> None:
        channel = self._channels.get(message.topic)
        if channel is None:
            channel = self._channels[message.topic] = self._register(message.topic, message.schema)
        self._writer.add_message(channel, time_ns, message.data, time_ns, index & 0xFFFFFFFF)

    def _register(self, topic: str, schema: str) -> int:
        if schema not in self._schemas:
            text = schema_text(schema).encode()
            self._schemas[schema] = self._writer.register_schema(schema, SCHEMA_ENCODING, text)
        kind = kind_of(topic, schema)
        qos = _QOS.format(depth=kind.depth, durability=1 if kind.latched else 2)
        return self._writer.register_channel(topic, "cdr", self._schemas[schema], {"offered_qos_profiles": qos})


class _UnbufferedFile:
    """A file that holds nothing back: after a failed write there is no buffer left that closing would try again."""

    def __init__(self, path: Path, *, overwrite: bool) -> None:
        self._raw = exclusive_file(path, overwrite=overwrite)
        self.tell, self.flush, self.close = self._raw.tell, self._raw.flush, self._raw.close

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while view:
            view = view[self._raw.write(view) :]
        return len(data)
