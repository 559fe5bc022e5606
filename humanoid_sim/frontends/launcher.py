"""Starts front ends as child processes of a session, shows what they say, and tells when one has ended."""

from __future__ import annotations

import contextlib
import math
import os
import selectors
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic

from humanoid_sim.errors import InputError
from humanoid_sim.frontends import Wanted
from humanoid_sim.messages import SessionHeader
from humanoid_sim.session.feed import FeedWriter
from humanoid_sim.session.sinks import Sink

_PERIOD = 0.1
"""s between two looks at the children."""
_STATUS_EVERY = 5
"""Looks between two statuses in the feed."""
_READY = 30.0
"""s that children get at the start to say that they work; the session begins without those that do not."""
_ERROR = "error: "
"""Beginning of the line with which a failed program ends."""
_GRACE = 2.0
"""s that a child gets to end after SIGTERM."""
_RESTART_AFTER = 1.0
"""s between the end of a child and its next start."""
_MOST_BYTES = 4096
"""Bytes taken from one child in one look: whatever it prints, this process spends no more on it."""


@dataclass(slots=True)
class _Child:
    wanted: Wanted
    process: subprocess.Popen[bytes]
    unfinished: bytes = b""
    last: str = ""
    """The latest line that it printed."""
    is_ready: bool = False
    """It said something other than an error."""
    has_ended: bool = False
    restarts: int = 0
    """Number of times that it was started again."""
    due: float = math.inf
    """s of the monotonic clock at which it is started again."""

    @property
    def name(self) -> str:
        """For people."""
        return self.wanted.label or self.wanted.name


class FrontEnds(Sink):
    """A sink that takes no ticks: it lives from the start of a session to its end, on one thread for all children."""

    def __init__(
        self,
        wanted: Sequence[Wanted],
        feed: FeedWriter,
        *,
        show: Callable[[str], None],
        note: Callable[[str], None],
        status: Callable[[], Mapping[str, object]],
        is_ending: Callable[[], bool] = lambda: False,
        begin: Callable[[SessionHeader], SessionHeader] = lambda header: header,
    ) -> None:
        """Start nothing yet.

        Args:
            feed: gets the status twice a second.
            show: shows operators a line that a child printed. It is not recorded: addresses may hold secrets.
            status: what to tell in the feed beside ticks; JSON.
            begin: gives the header of a run that begins now; called when the children have been waited for.
        """
        self._wanted = tuple(wanted)
        self._feed = feed
        self._show, self._note, self._status, self._is_ending, self._begin = show, note, status, is_ending, begin
        self._children: list[_Child] = []
        self._selector = selectors.DefaultSelector()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="front ends", daemon=True)
        self.error: Exception | None = None
        """Error that ended the supervision of the children; None while all is well."""

    @property
    def running(self) -> Mapping[str, int]:
        """Names and process ids of those that run."""
        return {child.name: child.process.pid for child in self._children if child.process.poll() is None}

    def start(self, header: SessionHeader) -> SessionHeader:
        """Start them, and wait until they work: a run that asks for a producer does not begin without it.

        Raises `InputError` if one cannot be started, or has ended at once.
        """
        try:
            for wanted in self._wanted:
                self._children.append(_launched(wanted))
        except OSError as error:
            self._end_children()
            raise InputError(f"--{wanted.name}: cannot be started: {error.strerror}") from None
        self._feed.status(self._status())  # a child that works finds itself there
        for child in self._children:
            self._listen(child)
        self._wait_until_ready()
        header = self._begin(header)
        self._feed.status(self._status())
        self._thread.start()
        return header

    def _listen(self, child: _Child) -> None:
        assert child.process.stdout is not None
        os.set_blocking(child.process.stdout.fileno(), False)
        self._selector.register(child.process.stdout, selectors.EVENT_READ, child)

    def _wait_until_ready(self) -> None:
        deadline = monotonic() + _READY
        if self._children:
            self._show(f"waiting for {', '.join(child.name for child in self._children)} ...")
        while not all(child.is_ready for child in self._children) and not self._is_ending():
            for key, _ in self._selector.select(_PERIOD):
                self._read(key.data)
            self._feed.status(self._status())
            for child in self._children:
                if child.has_ended and not child.is_ready:
                    self._end_children()
                    reason = child.last.removeprefix(_ERROR) or f"status {child.process.returncode}"
                    raise InputError(f"front end {child.name}: ended before it was ready: {reason}")
            if monotonic() > deadline:
                silent = ", ".join(child.name for child in self._children if not child.is_ready)
                self._note(f"not ready after {_READY:g} s: {silent}")
                return

    def close(self) -> None:
        """End them: with SIGTERM, and after a while with SIGKILL."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        self._end_children()
        self._selector.close()

    def _watch(self) -> None:
        try:
            looks = 0
            while not self._stop.wait(_PERIOD):
                for key, _ in self._selector.select(0):
                    self._read(key.data)
                for place, child in enumerate(self._children):
                    if monotonic() >= child.due and not self._is_ending():
                        self._children[place] = self._restarted(child)
                if looks % _STATUS_EVERY == 0:
                    self._feed.status(self._status())
                looks += 1
        except Exception as error:  # the session goes on without; its report says so
            self.error = error

    def _read(self, child: _Child) -> None:
        stream = child.process.stdout
        assert stream is not None
        try:
            data = os.read(stream.fileno(), _MOST_BYTES)
        except BlockingIOError:
            return
        *lines, child.unfinished = (child.unfinished[-_MOST_BYTES:] + data).split(b"\n")
        if not data:
            lines = [child.unfinished] if child.unfinished else []
            self._selector.unregister(stream)
        for line in lines:
            text = "".join(c if c.isprintable() else " " for c in line.decode(errors="replace")).strip()
            if text:
                child.last = text
                child.is_ready = child.is_ready or not text.startswith(_ERROR)
                self._show(f"{child.name}: {text}")
        if not data:
            child.has_ended = True
            with contextlib.suppress(subprocess.TimeoutExpired):
                status = child.process.wait(_GRACE)
                self._note(f"front end {child.name} ended with status {status}")
                if status and child.restarts < child.wanted.restarts:
                    child.due = monotonic() + _RESTART_AFTER
                elif status and child.restarts:
                    self._note(f"front end {child.name} is not started again: it ended {child.restarts + 1} times")

    def _restarted(self, child: _Child) -> _Child:
        """Start a child again; gives the one that has ended where that cannot be."""
        child.due = math.inf
        try:
            again = _launched(child.wanted)
        except OSError as error:
            self._note(f"front end {child.name} cannot be started again: {error.strerror}")
            return child
        assert child.process.stdout is not None
        child.process.stdout.close()
        again.restarts = child.restarts + 1
        self._listen(again)
        self._note(f"front end {child.name} was started again, {again.restarts} of {child.wanted.restarts} times")
        return again

    def _end_children(self) -> None:
        for child in self._children:
            child.process.terminate()
        for child in self._children:
            try:
                child.process.wait(_GRACE)
            except subprocess.TimeoutExpired:
                child.process.kill()
                child.process.wait()
            if child.process.stdout is not None:
                child.process.stdout.close()


def _launched(wanted: Wanted) -> _Child:
    command = [sys.executable, "-m", f"humanoid_sim.{wanted.name}", "--session", str(os.getpid()), *wanted.options]
    with ordinary_scheduling():
        # A session of its own: Ctrl-C and Ctrl-Z at the terminal are for the robot's process alone.
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
    return _Child(wanted, process)


@contextlib.contextmanager
def ordinary_scheduling() -> Iterator[None]:
    """No SCHED_FIFO for what is started meanwhile: children inherit it, and must not compete with the loop."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    if before[0] != os.SCHED_OTHER:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    try:
        yield
    finally:
        if before[0] != os.SCHED_OTHER:
            os.sched_setscheduler(0, *before)
