"""Attach to a running session: receive its ticks, send it intents and data.

This file works on its own in any Python from 3.9 on with NumPy: copy it anywhere; docs/front-ends.md has an example.
A session is a folder that only its user can enter, with three datagram sockets: `intents`, `data`, and `ticks`, by
which a program subscribes.
"""

from __future__ import annotations

import ctypes
import fcntl
import json
import os
import queue
import re
import socket
import stat
import struct
import tempfile
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing import Self


LOCK = "lock"  # held locked by a session for as long as it lives
FEED_HEAD = struct.Struct("<BQQ")  # a datagram of the feed begins with its kind, number, and CLOCK_MONOTONIC ns
TICK, STATUS = range(2)  # kinds of the feed: a tick by the message definition; JSON

VELOCITY_TIMEOUT = 0.25  # s after which a velocity command that is not repeated is zero
LIVE_TIMEOUT = 0.5  # s after which a live input that is not repeated is stale, unless its contract says otherwise
_KEPT = 256  # ticks that a feed keeps
_SEND_TIMEOUT, _POST_TIMEOUT = 0.05, 2  # s that a full socket is waited for: for data, and for intents
_NAMES = count()


class SessionError(Exception):
    """No such session, one that has ended, or one that cannot be reached; one line."""


def monotonic_ns() -> int:
    """Return the clock of all stamps, ns."""
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


@dataclass(frozen=True)
class SessionInfo:
    """A running session, as it describes itself."""

    process: int
    robot: str
    policy: str
    folder: str  # in which it was started
    hardware: str  # CAN channels; empty in simulation
    path: Path  # folder of its sockets

    def __str__(self) -> str:
        where = f" on {self.hardware}" if self.hardware else ""
        return f"session {self.process} ({self.robot}{where}, policy {self.policy}, started in {self.folder})"


def session_folder() -> Path:
    """Return the folder of this user's sessions, which may not exist. Raises `SessionError` if others may enter it."""
    base = Path(os.environ.get("XDG_RUNTIME_DIR", ""))
    if not base.is_absolute() or not base.is_dir():  # left over from another user, as `su` does
        base = Path(tempfile.gettempdir())
    folder = base / f"humanoid_sim-{os.getuid()}"
    if len(os.fsencode(folder)) > 80:  # a socket's path has 107 bytes: a session that nobody can damp must not start
        raise SessionError(f"{folder}: is too long for a session's sockets; set XDG_RUNTIME_DIR to a shorter folder")
    try:
        status = folder.lstat()
    except FileNotFoundError:
        return folder
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid() or status.st_mode & 0o077:
        raise SessionError(f"{folder}: is not a folder that only its user can enter; remove it")
    return folder


def running_sessions() -> list[SessionInfo]:
    """Return this user's running sessions, by process id. Folders that a killed session left are ignored."""
    found = []
    for path in session_folder().glob("*/"):
        if is_locked(path):
            with suppress(OSError, ValueError, TypeError):  # not registered yet, or of another version
                fields = json.loads((path / "session.json").read_text(encoding="utf-8"))
                found.append(SessionInfo(path=path, **fields))
    return sorted(found, key=lambda info: info.process)


def find_session(process: int | None = None) -> SessionInfo:
    """Return the running session of a process id, or the only one. Raises `SessionError` if there is none such."""
    sessions = running_sessions()
    matching = [info for info in sessions if process in (None, info.process)]
    if len(matching) == 1:
        return matching[0]
    if not sessions:
        raise SessionError("no session is running; start one with play")
    problem = "is needed where several sessions run" if process is None else f"{process} is not a running session"
    raise SessionError(f"--session: {problem}; running: {'; '.join(map(str, sessions))}")


def is_locked(path: Path) -> bool:
    """Return whether the session of a folder lives: a process id can be reused, a lock cannot."""
    try:
        with open(path / LOCK, "rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return isinstance(error, BlockingIOError)
    return False


@dataclass(frozen=True)
class Sample:
    """A tick, encoded."""

    number: int  # counts the session's ticks from 1
    stamp: int  # CLOCK_MONOTONIC ns when the session sent it
    data: bytes

    def age(self) -> float:  # s
        return 1e-9 * (monotonic_ns() - self.stamp)


class _Connection:
    """A datagram socket of this process in a session's folder."""

    def __init__(self, session: SessionInfo) -> None:
        self.session = session
        self._path = session.path / f"{os.getpid()}-{next(_NAMES)}"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._path.unlink(missing_ok=True)  # of a process that had this id before
            self._socket.bind(str(self._path))
        except OSError as error:
            self._socket.close()
            raise self._unreachable(error) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._socket.close()
        self._path.unlink(missing_ok=True)

    def _unreachable(self, error: Exception) -> SessionError:
        return SessionError(f"{self.session}: cannot be reached: {getattr(error, 'strerror', None) or error}")


class Feed(_Connection):
    """A session's ticks and status, received on a thread; raises `SessionError` if the session has ended."""

    def __init__(self, session: SessionInfo) -> None:
        super().__init__(session)
        self._ticks: deque[Sample] = deque(maxlen=_KEPT)
        self._status: dict[str, Any] = {}
        self._arrived = threading.Condition()
        self._thread = threading.Thread(target=self._receive, name="feed", daemon=True)
        try:
            described = json.loads((session.path / "header.json").read_text(encoding="utf-8"))
            self.header: Mapping[str, Any] = described["header"]  # the recording's: `session`, and `documents` by name
            self.joint_names: tuple[str, ...] = tuple(json.loads(self.header["session"]["joint_names"]))
            self.control_period = float(self.header["session"]["control_period"])  # s
            self.live_inputs: Mapping[str, int] = described["live_inputs"]  # name and width of those from outside
            self._decoder = Decoder(described["definition"])
            self._socket.sendto(b"", socket.MSG_DONTWAIT, str(session.path / "ticks"))
        except (OSError, ValueError, KeyError) as error:
            super().close()
            raise self._unreachable(error) from None
        self._thread.start()

    def close(self) -> None:
        self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        super().close()

    def _receive(self) -> None:
        buffer = memoryview(bytearray(1 << 18))
        while (size := self._socket.recv_into(buffer)) >= FEED_HEAD.size:  # until it is closed
            kind, number, stamp = FEED_HEAD.unpack_from(buffer)
            data = bytes(buffer[FEED_HEAD.size : size])
            with self._arrived:
                if kind == STATUS:
                    self._status = json.loads(data)
                else:
                    self._ticks.append(Sample(number, stamp, data))
                self._arrived.notify_all()

    def is_running(self) -> bool:
        return is_locked(self.session.path)

    def document(self, name: str) -> str:
        """Return a document of the header: `robot`, `contract`, `settings`, `controllers`; empty if there is none."""
        return str(self.header["documents"].get(name, ""))

    def blob(self, name: str) -> bytes:
        """Return a file: `model.mjb`, the compiled MuJoCo model, or the motion. Raises `KeyError` if there is none."""
        try:
            return (self.session.path / "files" / name).read_bytes()
        except OSError:
            raise KeyError(name) from None

    def latest(self) -> Sample | None:
        with self._arrived:
            return self._ticks[-1] if self._ticks else None

    def since(self, number: int) -> list[Sample]:
        """Return the ticks after that number that are still kept, oldest first."""
        with self._arrived:
            return [sample for sample in self._ticks if sample.number > number]

    def wait(self, number: int, timeout: float) -> Sample | None:
        """Wait for a tick after that number; the newest, or None after `timeout` s."""
        with self._arrived:
            has_come = self._arrived.wait_for(lambda: self._ticks and self._ticks[-1].number > number, timeout)
            return self._ticks[-1] if has_come else None

    def decode(self, sample: Sample) -> dict[str, Any]:
        return self._decoder(sample.data)

    def status(self) -> dict[str, Any]:
        with self._arrived:
            return self._status


_CODES = {
    "bool": "?", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q",
    "uint64": "Q", "float32": "f", "float64": "d"
}  # fmt: skip
_TYPE = re.compile(r"^MSG: (\S*)\n(.*?)(?=^=+\nMSG: |\Z)", re.MULTILINE | re.DOTALL)
_FIELD = re.compile(r"^([A-Za-z0-9_/]+)(\[\d*\])? +([a-z][a-z0-9_]*) *(?:#.*)?$", re.MULTILINE)


class Decoder:
    """Little-endian CDR by a `ros2msg` definition; for one thread at a time."""

    def __init__(self, definition: str) -> None:
        self._types = {name: _FIELD.findall(text) for name, text in _TYPE.findall(f"MSG: \n{definition}")}
        self._data, self._offset = b"", 0

    def __call__(self, message: bytes) -> dict[str, Any]:
        """Decode a message into a dict with the definition's names. Raises `SessionError` if it is not one."""
        self._data, self._offset = message[4:], 0
        try:
            return self._struct("")
        except (struct.error, ValueError, KeyError) as error:
            raise SessionError(f"a message that does not fit its definition: {error}") from None

    def _struct(self, name: str) -> dict[str, Any]:
        return {
            label: self._values(kind, brackets[1:-1]) if brackets else self._value(kind)
            for kind, brackets, label in self._types[name]
        }

    def _value(self, kind: str) -> Any:
        if kind in _CODES:
            size = struct.calcsize(f"<{_CODES[kind]}")
            return struct.unpack(f"<{_CODES[kind]}", self._next(size, size))[0]
        if kind == "string":
            return self._next(self._value("uint32"), 1)[:-1].decode("utf-8", "surrogatepass")
        return self._struct(kind)

    def _values(self, kind: str, length: str) -> Any:
        count = int(length or self._value("uint32"))
        if kind not in _CODES:
            return [self._value(kind) for _ in range(count)]
        import numpy as np  # noqa: PLC0415 - sending an intent needs none, and must be quick

        dtype = np.dtype(f"<{_CODES[kind]}")
        return np.frombuffer(self._next(count * dtype.itemsize, dtype.itemsize if count else 1), dtype, count)

    def _next(self, size: int, alignment: int) -> bytes:
        start = self._offset + -self._offset % alignment
        self._offset = start + size
        return self._data[start : self._offset]


@dataclass(frozen=True)
class Answer:
    """A session's answer to a request."""

    granted: bool
    text: str


class Intake(_Connection):
    """The sockets by which a program joins a session, for one thread; `SessionError` if it cannot be reached.

    Of the data (`remote`, `velocity`, `live`, `heartbeat`) only the newest of each producer counts.
    """

    def __init__(self, session: SessionInfo, producer: str) -> None:
        super().__init__(session)
        self._producer = f"{' '.join(producer.split())[:40] or '?'} ({os.getpid()})"
        # The kernel lets senders that wait in by turns, which those that poll are not.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("@ll", _POST_TIMEOUT, 0))
        self._data = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._data.connect(str(session.path / "data"))
        except OSError as error:
            self.close()
            raise self._unreachable(error) from None
        self._data.settimeout(_SEND_TIMEOUT)

    def close(self) -> None:
        self._data.close()
        super().close()

    def ask(self, word: str, timeout: float = 2.0, *, seen: int | None = None) -> Answer:
        """Request something, and wait `timeout` s for what became of it in the session's next tick.

        `word` is an intent, `reactivate` (which takes longer) or `policy NAME`; in simulation alone
        `push VX,VY [BODY]` or `reset`. `seen` is the stamp of the tick that was shown, ns; None: now. Raises
        `SessionError` if the session has ended or does not answer.
        """
        return self.answer(self.post(word, seen=seen), timeout)

    def safety(self, source: str, level: int, message: str = "", *, timeout: float = 2.0) -> Answer:
        """Report 0 OK, 1 WARNING, 2 FAULT or 3 CRITICAL; any but OK damps the robot until its source reports OK."""
        return self.answer(self.post_safety(source, level, message), timeout)

    def post_safety(
        self, source: str, level: int, message: str = "", *, flags: int = 0, stamp: int | None = None
    ) -> str:
        """Report as `safety` does without waiting; `flags` are bits of the source's own."""
        status = {
            "source": " ".join(source.split())[:80],
            "level": level,
            "flags": flags,
            "stamp": monotonic_ns() if stamp is None else stamp,
            "message": " ".join(message.split())[:300],
        }
        return self.post(f"safety {json.dumps(status)}")

    def post(self, word: str, *, seen: int | None = None) -> str:
        """Request as `ask` does without waiting; returns what `answer` takes."""
        token = str(next(_NAMES))
        try:
            self._socket.settimeout(None)
            # Not connected: it takes answers from whatever socket the session sends them by.
            message = self._message(" ".join(word.splitlines()), seen, token)
            self._socket.sendto(message, str(self.session.path / "intents"))
        except OSError as error:
            raise self._unreachable(error) from None
        return token

    def answer(self, token: str, timeout: float) -> Answer:
        """Return the answer to the latest post, which is waited for `timeout` s."""
        deadline = time.monotonic() + timeout
        try:
            while True:
                self._socket.settimeout(max(deadline - time.monotonic(), 1e-6))
                verdict, _, text = self._socket.recv(4096).decode(errors="replace").partition("\n")
                if verdict[1:] == token:  # not one that came too late for its question
                    return Answer(verdict[0] == "1", text)
        except socket.timeout:  # noqa: UP041 - another type before Python 3.10
            raise SessionError(f"{self.session}: did not answer within {timeout:g} s") from None
        except OSError as error:
            raise self._unreachable(error) from None

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
        """Send a command for REMOTE, all joints in the order of `Feed.joint_names`; False if the socket is full.

        `stamp` is when what it is made of arrived from outside, ns of `monotonic_ns`; None: now.
        """
        fields = (position, velocity, effort, stiffness, damping)
        if any(len(values) != len(joint_names) for values in fields):
            raise ValueError(f"expected {len(joint_names)} values in each field, one for each joint")
        return self._send("remote " + "\t".join(joint_names), [x for values in fields for x in values], stamp)

    def velocity(self, vx: float, vy: float, wz: float, *, deliberate: bool, stamp: int | None = None) -> bool:
        """Send a velocity command, m/s forward and to the left, and rad/s; `deliberate` takes the velocity over."""
        return self._send("velocity", (vx, vy, wz, float(deliberate)), stamp)

    def live(self, name: str, values: Sequence[float], *, stamp: int | None = None) -> bool:
        """Send a live input that the policy observes."""
        return self._send(f"live {name}", values, stamp)

    def heartbeat(self, *, stamp: int | None = None) -> bool:
        """Report that this producer and its device are there."""
        return self._send("heartbeat", (), stamp)

    def _send(self, line: str, values: Sequence[float], stamp: int | None) -> bool:
        try:
            self._data.send(self._message(line, stamp, values=values))
        except (socket.timeout, BlockingIOError):  # noqa: UP041 - another type before Python 3.10
            return False
        except OSError as error:
            raise SessionError(f"{self.session}: has ended ({error.strerror or error})") from None
        return True

    def _message(self, line: str, stamp: int | None, token: str = "", values: Sequence[float] = ()) -> bytes:
        """Return four lines and float64 values; see `humanoid_sim.session.datagrams.Message`."""
        stamp = monotonic_ns() if stamp is None else stamp
        lines = f"{line}\n{self._producer}\n{token}\n{stamp}\n"
        return lines.encode() + struct.pack(f"<{len(values)}d", *values)


def ask_sessions(
    word: str, process: int | None, *, producer: str, timeout: float = 2.0, seen: int | None = None
) -> Iterator[tuple[SessionInfo, Answer | SessionError]]:
    """Ask a session as `Intake.ask` does; for `damp` and no process id all that run, none waiting for another.

    Yields each session with its answer or error as they arrive. Raises `SessionError` if no such session runs.
    """
    sessions = running_sessions() if word == "damp" and process is None else []
    sessions = sessions or [find_session(process)]
    answers: queue.SimpleQueue[tuple[SessionInfo, Answer | SessionError]] = queue.SimpleQueue()

    def ask(session: SessionInfo) -> None:
        answer: Answer | SessionError
        try:
            with Intake(session, producer) as intake:
                answer = intake.ask(word, timeout, seen=seen)
        except SessionError as error:
            answer = error
        answers.put((session, answer))

    for session in sessions:
        threading.Thread(target=ask, args=(session,)).start()
    for _ in sessions:
        yield answers.get()


_SO_ATTACH_FILTER = 26
_NOT_LOOPED = b"".join(
    struct.pack("@HBBI", *step)
    for step in ((0x30, 0, 0, 0xFFFFF004), (0x15, 0, 1, 5), (0x06, 0, 0, 0), (0x06, 0, 0, 0xFFFFFFFF))
)
"""Packet filter of Linux (BPF): load the packet's type; PACKET_LOOPBACK is dropped, all else is taken whole."""


@contextmanager
def network_on(device: str, *, from_here: bool = True) -> Iterator[None]:
    """Bind the network sockets that a library opens within to a device, such as `lo`: nothing comes or goes by another.

    Without `from_here` they do not receive this machine's own multicast. Binding to an address would not do: DDS
    libraries bind some sockets to all addresses. Before Linux 5.7 root alone may do this.
    """
    before = _open_sockets()
    yield
    for number, _ in _open_sockets() - before:
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


def _open_sockets() -> set[tuple[int, str]]:
    """Return descriptor and name of every socket of this process."""
    files = set()
    for name in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # the descriptor of this very listing
            files.add((int(name), os.readlink(f"/proc/self/fd/{name}")))
    return {(number, target) for number, target in files if target.startswith("socket:")}
