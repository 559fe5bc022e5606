"""Starts front ends as child processes of a session, shows what they print, and ends them with it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from time import monotonic

from humanoid_sim.errors import InputError
from humanoid_sim.messages import SessionHeader
from humanoid_sim.recording.sink import Sink
from humanoid_sim.session.feed import FeedWriter

_STATUS_PERIOD = 0.5  # s
_READY = 30.0  # s that children get to print their first line; the session begins without those that do not
_GRACE = 2.0  # s that a child gets to end after SIGTERM


class _Child:
    """A front end's process."""

    def __init__(self, program: str, *options: str) -> None:
        self.name = " ".join((program, *options))
        self.last = ""  # line that it printed
        self.is_ready = threading.Event()  # it printed something other than an error, or has ended
        # A session of its own: Ctrl-C and Ctrl-Z at the terminal are for the robot's process alone.
        self.process = subprocess.Popen(
            [sys.executable, "-m", f"humanoid_sim.{program}", "--session", str(os.getpid()), *options],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )


class FrontEnds(Sink):
    """Child processes from here on until `close`, and the session's status; a sink that ignores ticks."""

    def __init__(
        self,
        commands: Sequence[Sequence[str]],
        feed: FeedWriter,
        *,
        show: Callable[[str], None],
        note: Callable[[str], None],
        status: Callable[[], Mapping[str, object]],
        is_ending: Callable[[], bool],
    ) -> None:
        """Launch them, with ordinary priority: not within a loop that has another.

        Args:
            commands: a program, such as `dds`, and the options of its command line; `--session` is added.
            feed: gets the status twice a second.
            show: shows operators a line that a child printed. It is not recorded: addresses may hold secrets.
            note: records a line.
        """
        self._feed, self._show, self._note, self._status = feed, show, note, status
        self._is_ending = is_ending
        self._threads: list[threading.Thread] = []
        self._stop = threading.Event()
        self._children = [_Child(*command) for command in commands]

    @property
    def running(self) -> Mapping[str, int]:
        """Names and process ids of those that run."""
        return {child.name: child.process.pid for child in self._children if child.process.poll() is None}

    def start(self, header: SessionHeader) -> None:
        """Wait until they are ready. Raises `InputError` if one has ended."""
        self._run(self._send_status)  # a child reads there that the session runs
        for child in self._children:
            self._run(self._read_output, child)
        self._wait_until_ready()

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
        while not self._stop.is_set():
            self._feed.status({**self._status(), "front_ends": self.running})
            self._stop.wait(_STATUS_PERIOD)

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
