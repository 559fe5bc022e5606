"""Attach to a running session: read its feed, write to its intake. For any Python from 3.9 on that has NumPy.

This file works on its own: copy it into a ROS environment, or anywhere, and import it. It imports nothing of the
package, and everything it must know about a session (message definitions, the robot, its model) comes with the feed.

    session = find_session()                    # the only one that runs; or find_session(4711)
    with Feed(session) as feed, Intake(session, "my program") as intake:
        tick = feed.decode(feed.latest())
        print(tick["time"], tick["joint_position"])
        print(intake.ask("damp").text)

The feed is memory that only the session can write to. Nothing that a reader does is noticed there: a reader maps it
read-only, takes copies, and tells by number and checksum whether a copy is whole. It is not a segment of
`multiprocessing.shared_memory`, whose resource tracker would remove it when the first reader exits.
"""

from __future__ import annotations

import ctypes
import fcntl
import json
import math
import mmap
import os
import queue
import re
import socket
import stat
import struct
import sys
import tempfile
import threading
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

__all__ = [
    "Answer",
    "Decoder",
    "Feed",
    "Intake",
    "Looks",
    "Sample",
    "SessionError",
    "SessionInfo",
    "ask_sessions",
    "find_session",
    "monotonic_ns",
    "network_on",
    "running_sessions",
    "session_folder",
]

SUFFIX = ".session"
"""Suffix of the file that a running session holds locked; its name is the process id."""
REPLY_SUFFIX = ".reply"
"""Suffix of the socket that a client gets its answers by; its name begins with the process id."""
_LONGEST_FOLDER = (107 if sys.platform == "linux" else 103) - len(f"/4194304-9999{REPLY_SUFFIX}")
"""Bytes; the paths of AF_UNIX sockets are that short (unix(7)), and the longest here is that of a client's answers."""
FEED_MAGIC = b"hsfeed01"
FEED_HEAD = struct.Struct("<8sQQI4xQ")
"""The feed's first bytes: magic; offset, length and CRC-32 of its description; 1 once the session has ended."""
ENDED_OFFSET = 32
RING_HEAD = struct.Struct("<Q")
"""A ring's first bytes: the number of its newest sample, counted from 1; 0 while there is none."""
SLOT_HEAD = struct.Struct("<QQII")
"""A slot's first bytes: its sample's number, stamp in CLOCK_MONOTONIC ns, length, and CRC-32 of all that and the bytes.

Sample `n` of a ring is in slot `n` modulo the number of its slots, until the ring has gone round.
"""
SLOT_SUM = struct.Struct("<QQI")
"""The first bytes that the checksum covers."""

DATA_MAGIC = b"hsdat1"
DATA_HEAD = struct.Struct("<6sBBHHIQ")
"""A datagram of the data socket begins with: magic, kind, 0, bytes of the producer's name, bytes of the topic, the
producer's process id, its stamp in CLOCK_MONOTONIC ns. Name, topic and float64 values follow."""
REMOTE, VELOCITY, LIVE, HEARTBEAT, REFUSED = range(5)
"""Kinds, and their topics and values. REMOTE: joint names, one a line, and the five MIT fields one after the other.
VELOCITY: none; vx, vy, wz, and 1 if it is deliberate. LIVE: the input's name; its timeout in s, and its value. REFUSED:
why; how many samples in all."""

VELOCITY_TIMEOUT = 0.25
"""s after which a velocity command that is not repeated is zero."""
LIVE_TIMEOUT = 0.5
"""s after which a live input that is not repeated is zero, unless its producer says otherwise."""
_LONGEST_WORD = 200
"""Characters of what is asked for."""
_LONGEST_REASON = 1000
"""Characters that say why something was refused."""
STOOD_STILL, _SETTLE = 0.2, 0.5
"""s between two looks beyond which a program was suspended; s for which what came before that may still turn up."""
_SEND_TIMEOUT, _POST_TIMEOUT = 0.05, 2.0
"""s that a full socket is waited for: for data, and for intents."""
_NAMES = count()
_SO_ATTACH_FILTER = 26
_NOT_LOOPED = b"".join(
    struct.pack("@HBBI", *step)
    for step in ((0x30, 0, 0, 0xFFFFF004), (0x15, 0, 1, 5), (0x06, 0, 0, 0), (0x06, 0, 0, 0xFFFFFFFF))
)
"""Packet filter of Linux (BPF): load the packet's type; PACKET_LOOPBACK is dropped, all else is taken whole."""


class SessionError(Exception):
    """No such session, one that has ended, or one that cannot be reached; one line."""


def monotonic_ns() -> int:
    """Return the clock of all stamps, ns: take it where a sample arrives from outside."""
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


class Looks:
    """The greatest age of what comes to a program that looks again and again; all in ns of CLOCK_MONOTONIC.

    What a look finds came after the look before. But if the program was suspended, what is found afterwards may have
    come at any time meanwhile, and more may follow from its sockets: until it has settled, the last look before stands.
    """

    def __init__(self, stood_still: float = STOOD_STILL, settle: float = _SETTLE, now: int | None = None) -> None:
        """Begin with a look.

        Args:
            stood_still: s between two looks beyond which the program was suspended.
            settle: s after that in which what came before may still turn up.
            now: ns; None: the present, here and in `look`.
        """
        self._stood_still, self._settle = round(1e9 * stood_still), round(1e9 * settle)
        self.newest = monotonic_ns() if now is None else now
        self.stamp = self._settled = self.newest
        """Earliest time at which what the newest look has found can have come."""

    @property
    def is_settling(self) -> bool:
        """Return whether the program was suspended a moment ago."""
        return self.newest < self._settled

    def look(self, now: int | None = None) -> int:
        """Begin a look; gives `stamp`."""
        before, self.newest = self.newest, monotonic_ns() if now is None else now
        if self.newest - before > self._stood_still:
            if before >= self._settled:
                self.stamp = before
            self._settled = self.newest + self._settle
        elif not self.is_settling:
            self.stamp = before
        return self.stamp

    def called(self) -> int:
        """Return when a call that has just come, on any thread, can have been made first."""
        now = monotonic_ns()
        if now - self.newest > self._stood_still:
            return self.newest
        return self.stamp if self.is_settling else now


# Sessions.


@dataclass(frozen=True)
class SessionInfo:
    """A running session, as it describes itself."""

    process: int
    robot: str
    policy: str
    folder: str
    """Folder in which it was started."""
    hardware: str
    """CAN channels; empty in simulation."""
    feed: str
    intents: str
    data: str
    file: Path = field(compare=False)
    """Held locked by the session for as long as it lives."""

    def __str__(self) -> str:
        where = f" on {self.hardware}" if self.hardware else ""
        return f"session {self.process} ({self.robot}{where}, policy {self.policy}, started in {self.folder})"

    def is_running(self) -> bool:
        """Return whether its process still holds the lock: a process id can be reused, a lock cannot."""
        return _is_locked(self.file)


def session_folder() -> Path:
    """Return the folder of this user's sessions, which may not exist.

    Raises `SessionError` if it is not the user's alone, or its path leaves no room for a socket's name.
    """
    base = Path(os.environ.get("XDG_RUNTIME_DIR", ""))
    if not base.is_absolute() or not base.is_dir():  # left over from another user, as `su` does
        base = Path(tempfile.gettempdir())
    folder = base / f"humanoid_sim-{os.getuid()}"
    if (length := len(os.fsencode(folder))) > _LONGEST_FOLDER:  # a session that nobody can damp must not start
        raise SessionError(
            f"{folder}: {length} bytes are too long for a session's sockets, at most {_LONGEST_FOLDER}; "
            "set XDG_RUNTIME_DIR to a shorter folder"
        )
    try:
        status = folder.lstat()
    except FileNotFoundError:
        return folder
    except OSError as error:
        raise SessionError(f"{folder}: cannot be read: {error.strerror}") from None
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o077:
        raise SessionError(f"{folder}: is not a folder that only its user can enter; remove it")
    return folder


def running_sessions() -> list[SessionInfo]:
    """Return this user's running sessions, by process id. Files that a killed session left are ignored."""
    found = []
    for path in session_folder().glob(f"*{SUFFIX}"):
        info = _read_info(path) if _is_locked(path) else None
        if info is not None:
            found.append(info)
    return sorted(found, key=lambda info: info.process)


def find_session(process: int | None = None) -> SessionInfo:
    """Return a running session: the one with a process id, or the only one there is.

    Raises `SessionError` if there is none, or several and no process id.
    """
    sessions = running_sessions()
    listed = "; ".join(map(str, sessions)) or "none"
    if process is not None:
        for info in sessions:
            if info.process == process:
                return info
        raise SessionError(f"--session: {process} is not a running session; running: {listed}")
    if not sessions:
        raise SessionError("no session is running; start one with play")
    if len(sessions) > 1:
        raise SessionError(f"--session: is needed where several sessions run; running: {listed}")
    return sessions[0]


def _is_locked(path: Path) -> bool:
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(handle)
    return False


def _read_info(path: Path) -> SessionInfo | None:
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        texts = {name: str(told[name]) for name in ("robot", "policy", "folder", "hardware", "feed", "intents", "data")}
        return SessionInfo(process=int(told["process"]), file=path, **texts)
    except (OSError, ValueError, KeyError, TypeError):  # of another version
        return None


# The feed.


@dataclass(frozen=True)
class Sample:
    """One entry of a ring: a whole copy."""

    number: int
    """Counts from 1 without gaps."""
    stamp: int
    """CLOCK_MONOTONIC ns when the session wrote it."""
    data: bytes

    def age(self) -> float:
        """S since it was written."""
        return 1e-9 * (monotonic_ns() - self.stamp)


class Feed:
    """A session's ticks, events and status, and what it takes to interpret them. A context manager."""

    def __init__(self, session: SessionInfo) -> None:
        """Map the feed of a session, read-only.

        Raises `SessionError` if it has ended, or its feed is of another version.
        """
        self.session = session
        self._map, told = self._mapped(session.feed)
        self.joint_names: tuple[str, ...] = tuple(told["joint_names"])
        self.control_period: float = told["control_period"]
        """s"""
        self.header: Mapping[str, Any] = told["header"]
        """The recording's: fields (`session`) and documents by name, JSON texts: robot, contract, settings."""
        self.live_inputs: Mapping[str, int] = told["live_inputs"]
        """Name and width of those that the session takes from outside."""
        self._definitions: Mapping[str, str] = told["definitions"]
        self._blobs: dict[str, tuple[mmap.mmap, int, int]] = {}
        self._place_blobs(self._map, told["blobs"])
        self._rings: Mapping[str, Sequence[int]] = told["rings"]
        self._decoders: dict[str, Decoder] = {}

    def _mapped(self, path: str) -> tuple[mmap.mmap, dict[str, Any]]:
        """Memory of the session, and what it says of itself."""
        session = self.session
        try:
            handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise SessionError(f"{session}: its feed cannot be opened: {error.strerror}") from None
        try:
            if os.fstat(handle).st_uid != os.getuid():
                raise SessionError(f"{session}: its feed {path} belongs to another user")
            memory = mmap.mmap(handle, 0, prot=mmap.PROT_READ)
        except (OSError, ValueError):  # a session that has just ended: its files have other numbers now
            raise SessionError(f"{session}: its feed cannot be opened: it is no memory") from None
        finally:
            os.close(handle)
        if len(memory) >= FEED_HEAD.size:
            magic, offset, length, checksum, _ = FEED_HEAD.unpack_from(memory)
            text = memory[offset : offset + length]
            if magic == FEED_MAGIC and zlib.crc32(text) == checksum:
                return memory, json.loads(text)
        memory.close()
        raise SessionError(f"{session}: its feed is of another version of this program")

    def _place_blobs(self, memory: mmap.mmap, places: Mapping[str, Sequence[int]]) -> None:
        self._blobs.update({name: (memory, offset, length) for name, (offset, length) in places.items()})

    def __enter__(self) -> Feed:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let the memory go."""
        self._map.close()

    def is_running(self) -> bool:
        """Return whether the session goes on; a killed one does not, although nobody could write that down."""
        return not FEED_HEAD.unpack_from(self._map)[4] and self.session.is_running()

    def document(self, name: str) -> str:
        """Return a document of the header: `robot`, `contract`, `settings`, `controllers`; empty if there is none."""
        return str(self.header["documents"].get(name, ""))

    def blob(self, name: str) -> bytes:
        """Return a file by name: `model.mjb`, the robot's compiled MuJoCo model; the motion, as in the recording.

        Raises `KeyError` if there is none of that name.
        """
        memory, offset, length = self._blobs[name]
        return memory[offset : offset + length]

    @property
    def blobs(self) -> tuple[str, ...]:
        """The names of all files."""
        return tuple(self._blobs)

    def newest(self, ring: str = "tick") -> int:
        """Return number of the newest sample; 0 while there is none."""
        return int(RING_HEAD.unpack_from(self._map, self._rings[ring][0])[0])

    def latest(self, ring: str = "tick") -> Sample | None:
        """Return the newest whole sample; None while there is none."""
        for _ in range(100):
            newest = self.newest(ring)
            if not newest:
                return None
            sample = self.sample(newest, ring)
            if sample is not None:
                return sample
        return None

    def sample(self, number: int, ring: str = "tick") -> Sample | None:
        """Copy the sample with that number; None if it is overwritten, not there yet, or being written."""
        offset, slots, size = self._rings[ring]
        start = offset + 64 + (number % slots) * size
        found, stamp, length, checksum = SLOT_HEAD.unpack_from(self._map, start)
        if found != number or length > size - SLOT_HEAD.size:
            return None
        start += SLOT_HEAD.size
        data = self._map[start : start + length]
        if zlib.crc32(data, zlib.crc32(SLOT_SUM.pack(found, stamp, length))) != checksum:
            return None
        return Sample(number, stamp, data)

    def since(self, number: int, ring: str = "tick") -> Iterator[Sample]:
        """Yield the samples after that number which are still there, oldest first."""
        newest, slots = self.newest(ring), self._rings[ring][1]
        for wanted in range(max(number + 1, newest - slots + 2, 1), newest + 1):
            sample = self.sample(wanted, ring)
            if sample is not None:
                yield sample

    def wait(self, number: int, timeout: float, ring: str = "tick") -> Sample | None:
        """Wait for a sample with a number above `number`; None after `timeout` s, or when the session has ended.

        It looks several times a tick: the session wakes nobody, because that would cost its loop a system call.
        """
        deadline = time.monotonic() + timeout
        pause = min(max(0.1 * self.control_period, 0.0005), 0.005)
        while self.newest(ring) <= number:
            if time.monotonic() >= deadline:
                return None
            time.sleep(pause)
            if FEED_HEAD.unpack_from(self._map)[4]:
                return None
        return self.latest(ring)

    def decode(self, sample: Sample, ring: str = "tick") -> dict[str, Any]:
        """Give a sample of `tick` or `event` as a dict with the names of its message definition, arrays as NumPy's."""
        decoder = self._decoders.get(ring)
        if decoder is None:
            decoder = self._decoders[ring] = Decoder(self._definitions[ring])
        return decoder(sample.data)

    def status(self) -> dict[str, Any]:
        """Return what is said beside ticks, twice a second: who owns REMOTE and the velocity, refusals, buses."""
        sample = self.latest("status")
        return {} if sample is None else dict(json.loads(sample.data))


_PRIMITIVES = {
    "bool": "?",
    "uint8": "B",
    "int8": "b",
    "uint16": "H",
    "int16": "h",
    "uint32": "I",
    "int32": "i",
    "uint64": "Q",
    "int64": "q",
    "float32": "f",
    "float64": "d",
}
_FIELD = re.compile(r"^([A-Za-z0-9_/]+)(\[(\d*)\])?\s+([a-z][a-z0-9_]*)\s*(?:#.*)?$")


class Decoder:
    """Little-endian CDR by a `ros2msg` definition."""

    def __init__(self, definition: str) -> None:
        first, *others = re.split(r"^=+\nMSG: ", definition, flags=re.MULTILINE)
        self._types = {"": self._fields(first)}
        for text in others:
            name, _, body = text.partition("\n")
            self._types[name.strip()] = self._fields(body)

    @staticmethod
    def _fields(text: str) -> list[tuple[str, str, str | None]]:
        matches = (_FIELD.match(line) for line in text.splitlines())
        return [(match[4], match[1], match[3] if match[2] else None) for match in matches if match]

    def __call__(self, message: bytes) -> dict[str, Any]:
        """Decode a message into a dict with the definition's names. Raises `SessionError` if it is not one."""
        try:
            return _Cursor(message).struct("", self._types)
        except (struct.error, ValueError, KeyError) as error:
            raise SessionError(f"a message that does not fit its definition: {error}") from None


class _Cursor:
    def __init__(self, message: bytes) -> None:
        self._data, self._offset = message[4:], 0

    def struct(self, name: str, types: Mapping[str, Sequence[tuple[str, str, str | None]]]) -> dict[str, Any]:
        return {label: self._value(kind, length, types) for label, kind, length in types[name]}

    def _value(self, kind: str, length: str | None, types: Mapping[str, Any]) -> Any:
        if length is None:
            return self._one(kind, types)
        number = int(length) if length else self._number("I")
        if kind in _PRIMITIVES:
            return self._array(_PRIMITIVES[kind], number)
        return [self._one(kind, types) for _ in range(number)]

    def _one(self, kind: str, types: Mapping[str, Any]) -> Any:
        if kind in _PRIMITIVES:
            return self._number(_PRIMITIVES[kind])
        if kind != "string":
            return self.struct(kind, types)
        size = self._number("I")
        start, self._offset = self._offset, self._offset + size
        return self._data[start : self._offset - 1].decode("utf-8", "surrogatepass")

    def _number(self, code: str) -> Any:
        size = struct.calcsize(f"<{code}")
        self._offset += -self._offset % size
        (value,) = struct.unpack_from(f"<{code}", self._data, self._offset)
        self._offset += size
        return value

    def _array(self, code: str, number: int) -> np.ndarray[Any, Any]:
        import numpy as np  # noqa: PLC0415 - sending an intent needs none, and must be quick

        size = struct.calcsize(f"<{code}")
        if not number:
            return np.zeros(0, np.dtype(f"<{code}"))
        start = self._offset + -self._offset % size
        self._offset = start + number * size
        return np.frombuffer(self._data, np.dtype(f"<{code}"), number, start)


# The intake.


@dataclass(frozen=True)
class Answer:
    """A session's answer to what was asked for."""

    granted: bool
    """Neither refused nor failed."""
    text: str
    """One line."""


class Intake:
    """The way by which a program tells a session something. A context manager; use one from one thread.

    Of the data (`remote`, `velocity`, `live`, `heartbeat`) only the newest of each producer counts, and at most a few
    reach the session in one tick: send once per tick of the feed, or at a fixed rate that is not far above.
    """

    def __init__(self, session: SessionInfo, producer: str, process: int | None = None) -> None:
        """Connect. Raises `SessionError` if it cannot be reached.

        Args:
            session: that is told.
            producer: a name for operators to read, such as `gravity`.
            process: id that tells producers of that name apart; None for this process, 0 for a producer elsewhere,
                which is the same one whichever program hands its samples on.
        """
        self.session = session
        self.producer = " ".join(producer.split())[:40] or "?"
        self._reply = str(Path(session.intents).parent / f"{os.getpid()}-{next(_NAMES)}{REPLY_SUFFIX}")
        self._intents: socket.socket | None = None
        self._data: socket.socket | None = None
        try:
            self._intents = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._data = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            Path(self._reply).unlink(missing_ok=True)  # of a process that had this id before and was killed
            self._intents.bind(self._reply)
            os.chmod(self._reply, 0o600)
            seconds, rest = divmod(_POST_TIMEOUT, 1.0)
            timeout = struct.pack("@ll", int(seconds), int(1e6 * rest))
            self._intents.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, timeout)
            self._data.connect(session.data)
        except OSError as error:
            self.close()
            raise SessionError(f"{session}: cannot be reached: {error.strerror or error}") from None
        self._data.settimeout(_SEND_TIMEOUT)
        self._name = self.producer.encode()
        self._process = os.getpid() if process is None else process

    def __enter__(self) -> Intake:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Disconnect."""
        for end in (self._intents, self._data):
            if end is not None:
                end.close()
        Path(self._reply).unlink(missing_ok=True)

    def ask(self, word: str, timeout: float = 2.0, *, seen: int | None = None) -> Answer:
        """Ask for something, and wait for what became of it in the session's next tick.

        All but `damp`, `pause`, `mark` and `safety` are refused if the robot has changed since they were meant: if what
        was seen is more than 0.5 s old, or from before the robot last went to DAMPING or ZERO_TORQUE. Raises
        `SessionError` if the session has ended or does not answer.

        Args:
            word: `damp`, `load_a`, `load_b`, `start_locomotion`, `start_remote`, `quit`, `reactivate`, or
                `mark TEXT`, which puts a text into the recording; of a simulation alone
                `push VX,VY` with or without a body, and `reset`.
            timeout: s; `reactivate` asks every motor for its identity and takes longer.
            seen: ns, the stamp of the newest tick that whoever asks had seen (`Sample.stamp`), or the time of the
                press (`Looks`); None: that of this call, for what a program decides by itself.
        """
        return self.answer(self.post(word, seen=seen), timeout)

    def select_policy(self, name: str, timeout: float = 2.0, *, seen: int | None = None) -> Answer:
        """Select one of several loaded policies, in ZERO_TORQUE or DAMPING; arguments and errors as for `ask`."""
        return self.ask(f"policy {name}", timeout, seen=seen)

    def safety(
        self,
        source: str,
        level: int,
        message: str = "",
        *,
        flags: int = 0,
        stamp: int | None = None,
        timeout: float = 2.0,
    ) -> Answer:
        """Report how a program or a device is; any level but 0 damps the robot in the session's next tick.

        It stands until the same source reports another one. The session recovers nothing by itself. Raises
        `SessionError` as `ask`.

        Args:
            source: the name under which the status stands, 1 to 80 characters.
            level: 0 OK, 1 WARNING, 2 FAULT, 3 CRITICAL.
            message: for operators.
            flags: bits of the source's own.
            stamp: see `remote`.
            timeout: s
        """
        return self.answer(self.post_safety(source, level, message, flags=flags, stamp=stamp), timeout)

    def post_safety(
        self, source: str, level: int, message: str = "", *, flags: int = 0, stamp: int | None = None
    ) -> str:
        """Report as `safety` does without waiting; gives what `answer` takes. Raises `SessionError` as `ask` does."""
        status = {
            "source": " ".join(str(source).split())[:80],
            "level": int(level),
            "flags": int(flags),
            "stamp": monotonic_ns() if stamp is None else int(stamp),
            "message": " ".join(str(message).split())[:300],
        }
        return self._post(f"safety {json.dumps(status, ensure_ascii=False)}")

    def post(self, word: str, *, seen: int | None = None) -> str:
        """Ask for something without waiting; gives what `answer` takes. Arguments and errors as for `ask`."""
        return self._post(" ".join(word.splitlines())[:_LONGEST_WORD], seen)  # a mark's text is a line

    def _post(self, word: str, seen: int | None = None) -> str:
        assert self._intents is not None
        token = f"{next(_NAMES)}"
        try:
            self._intents.settimeout(None)  # the socket's own: the kernel lets those who wait in by turns
            seen = monotonic_ns() if seen is None else int(seen)
            message = "\n".join((word, f"{self.producer} ({self._process})", token, str(seen))).encode()
            # Not connected: it takes answers from whatever socket the session sends them by.
            self._intents.sendto(message, self.session.intents)
        except OSError as error:
            raise SessionError(f"{self.session}: cannot be reached: {error.strerror or error}") from None
        return token

    def answer(self, token: str, timeout: float) -> Answer:
        """Return the answer to what was posted last; `timeout` in s. Raises `SessionError` as `ask` does."""
        assert self._intents is not None
        deadline = time.monotonic() + timeout
        try:
            while True:
                self._intents.settimeout(max(deadline - time.monotonic(), 1e-6))
                verdict, _, text = self._intents.recv(4096).decode(errors="replace").partition("\n")
                if verdict[1:] == token:  # an answer that came too late for its question is passed over
                    return Answer(verdict[0] == "1", text)
        except (TimeoutError, socket.timeout):  # noqa: UP041 - two types before Python 3.10
            raise SessionError(f"{self.session}: did not answer within {timeout:g} s") from None
        except OSError as error:
            raise SessionError(f"{self.session}: cannot be reached: {error.strerror or error}") from None

    def remote(
        self,
        joint_names: Sequence[str],
        position: Sequence[float],
        velocity: Sequence[float],
        effort: Sequence[float],
        stiffness: Sequence[float],
        damping: Sequence[float],
        *,
        stamp: int | None = None,
    ) -> bool:
        """Send a command for REMOTE. Raises `SessionError` if the session has ended.

        Args:
            joint_names: the robot's, in its order (`Feed.joint_names`).
            position: rad, one for each joint, as all five.
            velocity: rad/s
            effort: N·m
            stiffness: N·m/rad
            damping: N·m·s/rad
            stamp: ns, when what it is made of arrived from outside (`monotonic_ns`); None: now.

        Returns:
            Whether it left; False where the session takes nothing at present.
        """
        fields = (position, velocity, effort, stiffness, damping)
        if any(len(values) != len(joint_names) for values in fields):
            raise ValueError(f"expected {len(joint_names)} values in each field, one for each joint")
        return self._send(REMOTE, "\n".join(joint_names), [x for values in fields for x in values], stamp)

    def velocity(self, vx: float, vy: float, wz: float, *, deliberate: bool, stamp: int | None = None) -> bool:
        """Send a velocity command, again and again while it is meant: after `VELOCITY_TIMEOUT` it is zero.

        Args:
            vx: m/s, forward, as `vy` in the heading frame.
            vy: m/s, to the left.
            wz: rad/s
            deliberate: somebody changed it just now, and wants it to count in place of whoever else's. A stick at rest
                is not deliberate: it claims nothing, and counts only while this producer owns the velocity.
            stamp: see `remote`, as for returns and raises.
        """
        return self._send(VELOCITY, "", (vx, vy, wz, float(deliberate)), stamp)

    def live(
        self, name: str, values: Sequence[float], *, timeout: float | None = None, stamp: int | None = None
    ) -> bool:
        """Send a live input that the policy observes, such as `key_pressed`.

        Args:
            name: of the input.
            values: as many as the contract says.
            timeout: s after which it is stale, at most the contract's; None: the contract's, or `LIVE_TIMEOUT`.
            stamp: see `remote`, as for returns and raises.
        """
        return self._send(LIVE, name, (math.nan if timeout is None else timeout, *values), stamp)

    def heartbeat(self, *, stamp: int | None = None) -> bool:
        """Say that this producer and its device are there; a session that watches it damps 200 ms after the last."""
        return self._send(HEARTBEAT, "", (), stamp)

    def refused(self, reason: str, total: int) -> bool:
        """Say what this producer has refused itself of what came from outside, so that the session counts and tells it.

        Args:
            reason: of the latest.
            total: samples since this producer began.
        """
        return self._send(REFUSED, " ".join(reason.split())[:_LONGEST_REASON], (float(total),), None)

    def _send(self, kind: int, topic: str, values: Sequence[float], stamp: int | None) -> bool:
        assert self._data is not None
        name, label = self._name, topic.encode()
        stamp = monotonic_ns() if stamp is None else int(stamp)
        head = DATA_HEAD.pack(DATA_MAGIC, kind, 0, len(name), len(label), self._process, stamp)
        try:
            self._data.send(head + name + label + struct.pack(f"<{len(values)}d", *values))
        except (TimeoutError, socket.timeout, BlockingIOError):  # noqa: UP041 - two types before Python 3.10
            return False
        except OSError as error:
            raise SessionError(f"{self.session}: has ended ({error.strerror or error})") from None
        return True


def ask_sessions(
    word: str, process: int | None, *, producer: str, timeout: float = 2.0, seen: int | None = None
) -> Iterator[tuple[SessionInfo, Answer | SessionError]]:
    """Ask a session for something; for `damp` and no process id all that run, at once: none waits for another.

    Raises `SessionError` if there is no such session.

    Args:
        word: see `Intake.ask`, as for `timeout` and `seen`.
        process: id of the session; None for the only one that runs.
        producer: a name for operators to read.

    Returns:
        Each session and its answer, or why there is none, as they come.
    """
    sessions = running_sessions() if word == "damp" and process is None else []
    sessions = sessions or [find_session(process)]

    def ask(session: SessionInfo) -> tuple[SessionInfo, Answer | SessionError]:
        try:
            with Intake(session, producer) as intake:
                return session, intake.ask(word, timeout, seen=seen)
        except SessionError as error:
            return session, error

    return map(ask, sessions) if len(sessions) == 1 else _at_once(ask, sessions)


def _at_once(
    ask: Callable[[SessionInfo], tuple[SessionInfo, Answer | SessionError]], sessions: Sequence[SessionInfo]
) -> Iterator[tuple[SessionInfo, Answer | SessionError]]:
    answers: queue.SimpleQueue[tuple[SessionInfo, Answer | SessionError]] = queue.SimpleQueue()
    threads = [threading.Thread(target=lambda session=session: answers.put(ask(session))) for session in sessions]
    for thread in threads:
        thread.start()
    for _ in threads:
        yield answers.get()
    for thread in threads:
        thread.join()


# The network.


@contextmanager
def network_on(device: str, *, from_here: bool = True) -> Iterator[None]:
    """Bind the network sockets opened within to a device, such as `lo`: nothing comes or goes by another one.

    Without `from_here` they receive nothing that this machine itself sends to others there (multicast).

    The address that a socket is bound to is no such limit. DDS libraries bind some to all addresses, and then a packet
    from any network gets in, whatever interface they were configured for. For a library that opens its own sockets;
    they are bound at the end. Raises `OSError` if there is no such device, or the kernel (before Linux 5.7) allows this
    to root alone.
    """
    before = _open_sockets()
    yield
    for number, target in _open_sockets().items():
        if before.get(number) == target:
            continue
        try:
            handle = os.dup(number)
        except OSError:  # closed meanwhile
            continue
        with socket.socket(fileno=handle) as end:
            if end.family in (socket.AF_INET, socket.AF_INET6):
                end.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, device.encode() + b"\0")
                if not from_here:
                    code = ctypes.create_string_buffer(_NOT_LOOPED)
                    program = struct.pack("@HP", len(_NOT_LOOPED) // 8, ctypes.addressof(code))
                    end.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, program)


def _open_sockets() -> dict[int, str]:
    """Descriptor and name of every socket of this process."""
    found = {}
    for name in os.listdir("/proc/self/fd"):
        try:
            target = os.readlink(f"/proc/self/fd/{name}")
        except OSError:  # the descriptor of this very listing
            continue
        if target.startswith("socket:"):
            found[int(name)] = target
    return found
