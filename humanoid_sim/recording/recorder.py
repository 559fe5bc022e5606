"""A sink that writes a run to one MCAP file, off the control thread.

The control thread only queues a reference. A thread of its own encodes and writes, and ends a chunk at least every
`FLUSH_PERIOD` of the robot's time or of the wall clock's, whichever is first, so that a killed process loses less than
half a second of either; a run that need not keep real time waits for a recorder that is behind. If the disk fails, the
recording stops and says so once; the run goes on.

A finished file ends with an index of its chunks, which is kept in memory until then: 16 MB in an hour.
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

from humanoid_sim import __version__
from humanoid_sim.errors import InputError
from humanoid_sim.files import exclusive_file
from humanoid_sim.messages import Event, EventKind, SessionHeader, TickRecord
from humanoid_sim.recording.codec import TickEncoder, encode_event
from humanoid_sim.recording.header import write_header
from humanoid_sim.recording.topics import TopicMessage, ViewerTopics
from humanoid_sim.ros2.definitions import EVENT, SCHEMA_ENCODING, TICK, schema_text
from humanoid_sim.ros2.mcap_writer import ChunkedWriter
from humanoid_sim.ros2.topics import kind_of

TICK_TOPIC = "/humanoid_sim/tick"
EVENT_TOPIC = "/humanoid_sim/event"

FLUSH_PERIOD = 0.3
"""s after which a chunk is written, full or not."""
_LAG = 0.15
"""s of robot time that may wait for the writer before a run that need not keep real time waits for it."""
QUEUE_LIMIT = 4096
"""Ticks that may wait for the writer (20 s at 200 Hz). Beyond that they are left out, and the recording says so."""
_POLL_PERIOD = 0.02
"""s between two looks at the queue: waking the writer for every tick would cost the control thread more."""
_BATCH = 8
"""Ticks that are written in one go: 0.2 ms for which the control thread may be kept out. One by one, handing the
interpreter over costs twice as much as the writing."""
_CLOSE_TIMEOUT = 30.0
"""s that `close` waits for a disk that does not answer."""
_MAX_TIME_NS = 2**63 - 1
"""ROS 2 counts nanoseconds in 63 bits."""

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
            encoded: gives the message of a tick, if somebody has made it already: no tick is encoded twice.
            tell: is told, on the writer's thread, why the recording stopped while the run goes on.
        """
        self.path = Path(path)
        self._overwrite = overwrite
        self._encoded, self._tell = encoded, tell
        self._queue: SimpleQueue[tuple[TickRecord, bytes | None] | Event] = SimpleQueue()
        self._stop = threading.Event()
        self._wake = threading.Event()
        self.backlog_limit = QUEUE_LIMIT
        """See `Sink`."""
        self._thread: threading.Thread | None = None
        self.error: str | None = None
        """Reason why the recording stopped early, in one line; None while all is well."""
        self.lost = 0
        """Ticks left out because the writer could not keep up."""
        self._is_created = False
        self._taken = self._done = 0

    @property
    def backlog(self) -> int:
        """Ticks taken but not yet written into a chunk."""
        return 0 if self.error else self._taken - self._done

    def start(self, header: SessionHeader) -> None:
        """Create the file and write the header.

        Raises `InputError` if the file cannot be written, or another session writes it.
        """
        file = _UnbufferedFile(self.path, overwrite=self._overwrite)
        try:
            run = _RunWriter(file, header)
        except OSError as error:
            file.close()
            if self.path.is_file():
                self.path.unlink()
            raise InputError(f"{self.path}: cannot be written: {error.strerror}") from None
        self._is_created = True
        self.backlog_limit = max(round(_LAG / header.control_period), 2)
        self._thread = threading.Thread(target=self._write, args=(run,), name="recorder", daemon=True)
        self._thread.start()

    def tick(self, record: TickRecord) -> None:
        """Queue a tick. Never waits."""
        if self.error is not None or self._thread is None:
            return
        if self._taken - self._done >= QUEUE_LIMIT:
            self.lost += 1
            return
        self._taken += 1
        self._queue.put((record, self._encoded(record)))
        if 2 * (self._taken - self._done) >= self.backlog_limit:
            self._wake.set()

    def event(self, event: Event) -> None:
        """Queue an event. Never waits."""
        is_open = self._thread is not None or not self._is_created  # events from before the run begins are kept as well
        if self.error is None and is_open and self._queue.qsize() < 2 * QUEUE_LIMIT:
            self._queue.put(event)

    def close(self) -> None:
        """Write what is queued, and the index. Never raises; `error` says whether it worked."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self._stop.set()
        self._wake.set()
        thread.join(_CLOSE_TIMEOUT)
        if thread.is_alive():
            self._fail(f"the disk did not answer for {_CLOSE_TIMEOUT:g} s")

    def discard_if_empty(self) -> bool:
        """After `close`: remove the file if the run had no tick; whether it did. Never raises.

        The next start with the same file is not refused then because of a run that was none.
        """
        if self._thread is not None or not self._is_created or self._taken or self.lost or self.error:
            return False
        with suppress(OSError):
            if self.path.is_file() and not self.path.is_symlink():
                self.path.unlink()
                return True
        return False

    def _write(self, run: _RunWriter) -> None:
        """Write, on a thread of its own. Contains every exception: it must not end the run, only the recording."""
        try:
            self._drain_until_stopped(run)
            run.finish(self.lost)
        except OSError as error:
            self._tell(self._fail(error.strerror or str(error)))
        except Exception as error:  # a bug in the encoder; the run is worth more than its recording
            self._tell(self._fail(f"{type(error).__name__}: {error}"))
        finally:
            run.file.close()

    def _drain_until_stopped(self, run: _RunWriter) -> None:
        next_flush = monotonic() + FLUSH_PERIOD
        while True:
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
                    self._done += 1
                if self._done % _BATCH == 0:
                    sleep(0)  # lets the control thread in instead of keeping it out for the whole queue
            if is_last and self._queue.empty():
                return

    def _fail(self, reason: str) -> str:
        self.error = error = f"{self.path}: recording stopped: {reason}"
        while not self._queue.empty():
            try:
                self._queue.get_nowait()
            except Empty:
                break
        return error


class _RunWriter:
    """Encodes ticks and events into the file. Lives on the writer thread, after the header."""

    def __init__(self, file: _UnbufferedFile, header: SessionHeader) -> None:
        self.file = file
        self._writer = ChunkedWriter(file)
        self._writer.start(profile="ros2", library=f"humanoid_sim {__version__}")
        write_header(self._writer, header)
        self._encoder = TickEncoder(len(header.joint_names))
        self._topics = ViewerTopics(header)
        self._start_time_ns = header.start_time_ns
        self._time_ns = header.start_time_ns
        self._time = 0.0
        self._flushed = 0.0
        self._index = 0
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def tick(self, record: TickRecord, message: bytes | None = None) -> None:
        """Write one tick, encoding it unless that was done, and the viewers' share of it."""
        if record.index != self._index:
            self._report_loss(f"{record.index - self._index} ticks left out before tick {record.index}")
        self._index = record.index + 1
        self._time = float(record.input.state.time)
        time_ns = self._log_time(self._time)
        encoded = self._encoder.encode(record) if message is None else message
        self._add(TopicMessage(TICK_TOPIC, TICK, encoded), time_ns, record.index)
        for shown in self._topics.messages(record, time_ns):
            self._add(shown, time_ns, record.index)

    def event(self, event: Event) -> None:
        """Encode one event."""
        self._add(TopicMessage(EVENT_TOPIC, EVENT, encode_event(event)), self._log_time(event.time), self._index)

    @property
    def is_due(self) -> bool:
        """Return whether the ticks that are not yet written are those of a whole period of the robot's time."""
        return not abs(self._time - self._flushed) < FLUSH_PERIOD

    def flush(self) -> None:
        """End the chunk and hand it to the operating system."""
        self._writer.flush()
        self._flushed = self._time

    def finish(self, lost: int) -> None:
        """Write the index. `lost` is how many ticks were left out in all."""
        if lost:
            self._report_loss(f"{lost} ticks left out in all")
        self._writer.finish()

    def _report_loss(self, text: str) -> None:
        self.event(Event(self._time, f"recording: {text}", EventKind.LOSS))

    def _log_time(self, time: float) -> int:
        """Nanoseconds of the file's clock, which unlike the robot's neither runs backwards nor is ever no number."""
        if math.isfinite(time) and abs(time) < 1e9:
            now = self._start_time_ns + round(time * 1e9)
            self._time_ns = min(max(self._time_ns, now, 0), _MAX_TIME_NS)
        return self._time_ns

    def _add(self, message: TopicMessage, time_ns: int, index: int) -> None:
        channel = self._channels.get(message.topic)
        if channel is None:
            channel = self._channels[message.topic] = self._register(message.topic, message.schema)
        self._writer.add_message(channel, time_ns, message.data, time_ns, index & 0xFFFFFFFF)

    def _register(self, topic: str, schema: str) -> int:
        schema_id = self._schemas.get(schema)
        if schema_id is None:
            text = schema_text(schema).encode()
            schema_id = self._schemas[schema] = self._writer.register_schema(schema, SCHEMA_ENCODING, text)
        kind = kind_of(topic, schema)
        qos = _QOS.format(depth=kind.depth, durability=1 if kind.latched else 2)
        return self._writer.register_channel(topic, "cdr", schema_id, {"offered_qos_profiles": qos})


class _UnbufferedFile:
    """A file that holds nothing back: after a failed write there is no buffer left that closing would try again."""

    def __init__(self, path: Path, *, overwrite: bool = True) -> None:
        self._raw = exclusive_file(path, overwrite=overwrite)

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while view:
            view = view[self._raw.write(view) :]
        return len(data)

    def tell(self) -> int:
        return self._raw.tell()

    def flush(self) -> None:
        """Nothing to do: every write has already gone out."""

    def close(self) -> None:
        self._raw.close()
