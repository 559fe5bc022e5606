"""Another policy for a session that runs: prepared on a thread of its own, put in place between two ticks."""

from __future__ import annotations

import contextlib
import gc
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from humanoid_sim.client import Answer
from humanoid_sim.controllers.base import Controller
from humanoid_sim.errors import InputError
from humanoid_sim.messages import Mode, SessionHeader
from humanoid_sim.session.sinks import Sink

LOADABLE = (Mode.ZERO_TORQUE, Mode.DAMPING, Mode.STANDBY)
"""Modes in which a policy is replaced: in the others it, or a remote producer, drives the robot."""
_SWITCH_INTERVAL = 0.0005
"""s between two hand-overs of the interpreter while a policy is prepared, so that no tick waits longer."""
_LEAVING = 5.0
"""s that the thread gets to end."""


@dataclass(frozen=True, slots=True, eq=False)
class PreparedPolicy:
    """A policy that was checked and can be put in place."""

    controller: Controller
    header: SessionHeader
    """Header of the run, from the replacement on."""
    text: str
    """Line for operators: the policy, and its warnings."""
    follow: Callable[[], None]
    """Quick function that has the session's other parts follow; called on the control thread."""
    announce: Callable[[], None]
    """Function that tells the rest of the machine; called afterwards, on the thread of `Loading`."""
    discard: Callable[[], None]
    """Function called instead of the two, if the mode no longer allows the replacement."""


class Loading(Sink):
    """Prepares one policy at a time while the loop goes on, and hands it to the session. Replaces nothing itself.

    It is a sink for its thread to live as long as the session.
    """

    def __init__(self, prepare: Callable[[str], PreparedPolicy], cancel: Callable[[], None] = lambda: None) -> None:
        """Start with nothing requested.

        `prepare` takes the request's options, JSON; it may take long, and raises `InputError` to refuse it. `cancel`
        makes one that is under way raise.
        """
        self._prepare, self._cancel = prepare, cancel
        self._options: str | None = None
        self._prepared: PreparedPolicy | None = None
        self._served: str | None = None
        self._lock = threading.Lock()
        self._wake, self._done, self._stop = threading.Event(), threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, name="loading", daemon=True)
        self.answer: Answer | None = None
        """Answer to the latest request; None until it is served."""

    def start(self, header: SessionHeader) -> None:
        """Begin to take requests."""
        self._thread.start()

    def request(self, options: str, mode: Mode) -> str:
        """Ask for a policy, with options as JSON; gives the reason for a refusal, or '' if it is being prepared."""
        if refusal := load_refusal(mode):
            return refusal
        with self._lock:
            if self._options is not None:
                return "load refused: another policy is being loaded"
            self._options, self.answer = options, None
        self._wake.set()
        return ""

    @property
    def is_ready(self) -> bool:
        """True while a policy waits to be put in place."""
        return self._prepared is not None

    def take(self, mode: Mode) -> PreparedPolicy | None:
        """Hand out the policy to put in place now; None if the mode does not allow it any more."""
        prepared, self._prepared = self._prepared, None
        self._served = load_refusal(mode)
        self._done.set()
        return None if self._served else prepared

    def close(self) -> None:
        """Leave a policy that is being prepared, and end."""
        self._stop.set()
        self._cancel()
        self._wake.set()
        self._done.set()
        if self._thread.ident is not None:
            self._thread.join(_LEAVING)

    def _work(self) -> None:
        while True:
            self._wake.wait()
            self._wake.clear()
            if self._stop.is_set():
                return
            if self._options is not None:
                answer = self._load(self._options)
                with self._lock:
                    self._options, self.answer = None, answer

    def _load(self, options: str) -> Answer:
        try:
            prepared = self._prepare(options)
        except InputError as error:
            return Answer(False, f"load refused: {error}")
        except Exception as error:  # a bug; the session goes on with the policy that it has
            return Answer(False, f"load failed: {type(error).__name__}: {error}")
        self._done.clear()
        self._served, self._prepared = None, prepared
        while self._served is None and not self._stop.is_set():
            self._done.wait()
        if self._served:
            prepared.discard()
            return Answer(False, self._served)
        if self._served is None:
            prepared.discard()
            return Answer(False, "load refused: the session ends")
        prepared.announce()
        return Answer(True, prepared.text)


def load_refusal(mode: Mode) -> str:
    """Explain why a mode does not allow a replacement; empty where it does."""
    if mode in LOADABLE:
        return ""
    *others, last = (mode.name for mode in LOADABLE)
    return f"load refused: requires {', '.join(others)} or {last}, mode is {mode.name}"


@contextlib.contextmanager
def considerate() -> Iterator[None]:
    """Let the control thread in often: hand the interpreter over early, and collect no garbage meanwhile."""
    before, collects = sys.getswitchinterval(), gc.isenabled()
    sys.setswitchinterval(min(before, _SWITCH_INTERVAL))
    gc.disable()
    try:
        yield
    finally:
        sys.setswitchinterval(before)
        if collects:
            gc.enable()
