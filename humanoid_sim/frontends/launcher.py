"""Starts front ends as child processes of a session, shows what they print, and ends them with it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import monotonic

from humanoid_sim.errors import InputError
from humanoid_sim.frontends import Wanted
from humanoid_sim.messages import SessionHeader
from humanoid_sim.session.feed import FeedWriter
from humanoid_sim.session.sinks import Sink

_STATUS_PERIOD = 0.5  # s
_READY = 30.0  # s that children get to print their first line; the session begins without those that do not
_GRACE = 2.0  # s that a child gets to end after SIGTERM


@dataclass(slots=True)
class _Child:
    name: str
    process: subprocess.Popen[str]
    last: str = ""
    """The latest line that it printed."""
    is_ready: threading.Event = field(default_factory=threading.Event)
    """It printed something other than an error, or has ended."""


class FrontEnds(Sink):
    """A sink that ignores ticks: it starts the front ends with the session and ends them with it."""

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
            note: records a line.
            begin: returns the header of a run that begins now; called when the children are ready.
        """
        self._wanted, self._feed = tuple(wanted), feed
        self._show, self._note, self._status, self._is_ending, self._begin = show, note, status, is_ending, begin
        self._children: list[_Child] = []
        self._threads: list[threading.Thread] = []
        self._stop = threading.Event()

    @property
    def running(self) -> Mapping[str, int]:
        """Names and process ids of those that run."""
        return {child.name: child.process.pid for child in self._children if child.process.poll() is None}

    def start(self, header: SessionHeader) -> SessionHeader:
        """Start them, and wait until they are ready: a run that needs a producer does not begin without it.

        Raises `InputError` if one ends at once.
        """
        self._children = [_Child(wanted.label or wanted.name, _launched(wanted)) for wanted in self._wanted]
        self._run(self._send_status)  # a child reads there that it runs
        for child in self._children:
            self._run(self._read_output, child)
        self._wait_until_ready()
        header = self._begin(header)
        self._feed.status(self._status())
        return header

    def close(self) -> None:
        """End them: with SIGTERM, and after a while with SIGKILL."""
        self._stop.set()
        for child in self._children:
            child.process.terminate()
        for child in self._children:
            try:
                child.process.wait(_GRACE)
            except subprocess.TimeoutExpired:
                child.process.kill()
                child.process.wait()
        for thread in self._threads:
            thread.join(_GRACE)

    def _run(self, target: Callable[..., None], *arguments: object) -> None:
        self._threads.append(threading.Thread(target=target, args=arguments, name="front ends", daemon=True))
        self._threads[-1].start()

    def _send_status(self) -> None:
        while True:
            self._feed.status(self._status())
            if self._stop.wait(_STATUS_PERIOD):
                return

    def _read_output(self, child: _Child) -> None:
        assert child.process.stdout is not None
        with child.process.stdout as output:
            for line in output:
                text = "".join(c if c.isprintable() else " " for c in line).strip()
                if text:
                    child.last = text
                    self._show(f"{child.name}: {text}")
                    if not text.startswith("error: "):  # the line with which a failed program ends
                        child.is_ready.set()
        status = child.process.wait()
        child.is_ready.set()
        if not self._stop.is_set():
            self._note(f"front end {child.name} ended with status {status}")

    def _wait_until_ready(self) -> None:
        deadline = monotonic() + _READY
        if self._children:
            self._show(f"waiting for {', '.join(child.name for child in self._children)} ...")
        for child in self._children:
            while not child.is_ready.wait(0.02) and not self._is_ending() and monotonic() < deadline:
                pass
            if child.process.poll() is not None:
                self.close()
                reason = child.last or f"status {child.process.returncode}"
                raise InputError(f"front end {child.name}: ended before the session began: {reason}")
            if not child.is_ready.is_set():
                self._note(f"front end {child.name} is not ready")


def _launched(wanted: Wanted) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", f"humanoid_sim.{wanted.name}", "--session", str(os.getpid()), *wanted.options]
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # a child must not compete with the loop
    try:
        # A session of its own: Ctrl-C and Ctrl-Z at the terminal are for the robot's process alone.
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
    finally:
        os.sched_setscheduler(0, policy, parameters)
