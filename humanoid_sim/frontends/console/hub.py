"""The hub between a session and its pages: states for the pages, and requests from them."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import time
from collections import deque
from collections.abc import Awaitable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from itertools import count
from typing import Any

from websockets.asyncio.server import ServerConnection

from humanoid_sim.client import (
    Answer,
    Intake,
    SessionError,
    monotonic_ns,
)
from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.attach import Attachment
from humanoid_sim.frontends.console.access import Access
from humanoid_sim.frontends.console.commanding import Commanding
from humanoid_sim.frontends.console.plots import Watch
from humanoid_sim.frontends.console.server import encoded
from humanoid_sim.frontends.console.showing import Showing
from humanoid_sim.frontends.console.state import LoopRate, Reasons, base_velocity, known_supervisor, state
from humanoid_sim.frontends.console.wishes import Beat, LetGo, Snap, Take, parse_wish
from humanoid_sim.messages import Intent, TickRecord
from humanoid_sim.session.intent_socket import MARK, PUSH
from humanoid_sim.session.reactivation import REACTIVATE, RESET

_PERIOD = 0.1
"""s between two states that are sent to a page."""
_EVENTS = 200
"""Largest number of events that a new page is shown."""
_ASKS_PER_SECOND, _ASKS_AT_ONCE = 5.0, 10
"""Rate limit of one page's requests, all but DAMP."""
_PATIENCE = 2.0
"""s that an answer may take."""
_NEXT_TICK = 0.002
"""s between two looks for the session's next tick, while a page measures its link."""
_REACTIVATING = 30.0
"""s that it may take to reactivate: every motor of a bus is asked for its identity. DAMP does not wait behind it."""
_STATUS_PERIOD = 0.25
"""s between two looks at the feed's status, which is written twice a second."""
_CHOICES_PER_SECOND, _CHOICES_AT_ONCE = 5.0, 20
"""Rate limit of one page's choices of what to show."""
_WISHES_PER_SECOND, _WISHES_AT_ONCE = 60.0, 60
"""Rate limit of one page's heartbeats, sliders and keys; taking a joint counts as a request, as intents do."""
_WATCHING = "this address is for watching only"
_WORDS = frozenset({*(intent.value for intent in Intent), MARK, REACTIVATE, PUSH, RESET})


class RateLimit:
    """So many a second, and so many at once."""

    def __init__(self, rate: float, burst: int) -> None:
        """Begin with the whole burst; `rate` in 1/s."""
        self._rate, self._burst = rate, burst
        self._left, self._time = float(burst), float("-inf")

    def admits(self, time: float) -> bool:
        """Return whether one more may pass now; `time` in s."""
        if time > self._time:
            self._left = min(self._left + self._rate * (time - self._time), float(self._burst))
        self._time = time
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


@dataclass
class _Page:
    """A page that is open."""

    connection: ServerConnection
    access: Access
    number: int
    watch: Watch
    answers: deque[Answer] = field(default_factory=lambda: deque(maxlen=_ASKS_AT_ONCE))
    asks: RateLimit = field(default_factory=lambda: RateLimit(_ASKS_PER_SECOND, _ASKS_AT_ONCE))
    choices: RateLimit = field(default_factory=lambda: RateLimit(_CHOICES_PER_SECOND, _CHOICES_AT_ONCE))
    wishes: RateLimit = field(default_factory=lambda: RateLimit(_WISHES_PER_SECOND, _WISHES_AT_ONCE))
    tasks: set[asyncio.Task[None]] = field(default_factory=set)

    def start(self, task: Coroutine[Any, Any, None]) -> None:
        """Run it beside the page's other tasks."""
        started = asyncio.create_task(task)
        self.tasks.add(started)
        started.add_done_callback(self.tasks.discard)


class Hub:
    """All pages of one session. Everything but waiting for answers happens on the event loop's thread."""

    def __init__(self, attachment: Attachment, showing: Showing) -> None:
        self._attachment = attachment
        self._showing = showing
        self._status: dict[str, Any] = {}
        self._status_due = 0.0
        self._supervisor = known_supervisor(attachment.header)
        self._reasons = Reasons(attachment.base)
        self._rate = LoopRate()
        self._damping = Intake(attachment.session, "console")
        """For DAMP alone, which so waits for no answer to anything else."""
        self._asking = ThreadPoolExecutor(1, "asking")
        self._posting = threading.Lock()
        self._damps = 0
        self._record: TickRecord | None = None
        self._stamp = monotonic_ns()
        self._number = self._event_number = 0
        self._mode: tuple[str, str] | None = None
        self._events: deque[tuple[int, float, str]] = deque(maxlen=_EVENTS)
        self._told = 0
        self._marks = 0
        self._pages: set[ServerConnection] = set()
        self._page_numbers = count(1)
        self._commanding = Commanding(attachment)
        self._commanding.start()

    def close(self) -> None:
        """Let go of the session."""
        self._commanding.close()
        self._asking.shutdown()
        self._damping.close()

    def look(self) -> TickRecord | None:
        """Take what is new in the feed; gives the newest tick, or None where none is new."""
        feed, newest = self._attachment.feed, None
        if time.monotonic() >= self._status_due:
            self._status_due = time.monotonic() + _STATUS_PERIOD
            self._status = feed.status()
            self._showing.hear(self._status)
        for number, event in self._attachment.events(self._event_number):
            self._event_number = number
            self._tell(event.time, event.text)
        for sample in feed.since(self._number):
            self._number, self._stamp = sample.number, sample.stamp
            newest = self._attachment.record(sample)
            self._commanding.look(newest)
            self._showing.look(newest)
            self._reasons.look(newest)
            output, now = newest.output, float(newest.input.state.time)
            control = output.control_mode
            mode = control.mode.name, control.controller_name
            if mode != self._mode:
                self._tell(now, f"{control.mode.name} ({control.controller_name}): {control.status_message}")
            self._mode = mode
            for text in (*output.refusals, *(fault.message for fault in output.faults)):
                self._tell(now, text)
        self._rate.look(self._number, self._stamp)
        self._record = newest or self._record
        return newest

    def _tell(self, now: float, text: str) -> None:
        self._told += 1
        self._events.append((self._told, now, text))

    async def page(self, connection: ServerConnection, access: Access) -> None:
        """Look after a page until it closes. Reading never waits for sending, nor for an answer: a DAMP may come."""
        self._pages.add(connection)
        page = _Page(connection, access, next(self._page_numbers), Watch(self._showing.plots))
        page.tasks.add(asyncio.create_task(self._tell_page(page)))
        try:
            async for message in connection:
                asked = _asked(message)
                if "plot" in asked or "show" in asked:
                    refusal = self._choose(page, asked)
                elif "ping" in asked:
                    refusal = ""
                    if isinstance(asked["ping"], int) and page.choices.admits(time.monotonic()):
                        page.start(self._pong(connection, asked["ping"]))
                elif "do" in asked:
                    refusal = self._wish(page, message)
                else:
                    refusal = self._request(page, asked)
                if refusal:
                    page.answers.append(Answer(False, refusal))
        finally:
            self._commanding.leave(page.number)
            self._pages.discard(connection)
            tasks = list(page.tasks)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def say_goodbye(self) -> None:
        """Tell all pages that the session has ended."""
        for page in list(self._pages):
            with contextlib.suppress(Exception):  # a page that is gone, too
                await asyncio.wait_for(page.send(encoded({"ended": True})), 0.2)

    async def _tell_page(self, page: _Page) -> None:
        """Tell a page how things are, ten times a second; one that is slow is told less often, never what is past."""
        session, connection = self._attachment.session, page.connection
        hello = {"session": str(session), "access": page.access.value, "joint_names": self._attachment.feed.joint_names}
        await connection.send(encoded(hello | self._showing.hello() | self._commanding.known(page.number)))
        shown = 0
        while True:
            told: dict[str, Any] = {}
            if self._record is not None:
                told = state(self._record, self._supervisor, is_simulated=not session.hardware)
                told["age"] = 1e-9 * (monotonic_ns() - self._stamp)
                told["stamp"] = 1e-9 * self._stamp
                told |= self._reasons.told(self._record)
                told["vitals"] = self._vitals(self._record)
                told["owners"], told["lost"] = self._status.get("owners", {}), {}
                if (simulation := self._status.get("simulation")) is not None:
                    told["simulation"] = simulation
                told |= self._showing.told(self._record) | self._commanding.told(self._record)
                told["events"] = [event for event in self._events if event[0] > shown]
                told["answers"] = [asdict(page.answers.popleft()) for _ in range(len(page.answers))]
                shown = self._told
            await connection.send(encoded(told))
            for data in page.watch.due():
                await connection.send(data)
            await asyncio.sleep(_PERIOD)

    def _vitals(self, record: TickRecord) -> dict[str, Any]:
        """Return figures of the session: its loop's rate, its recording, and how a floating base moves."""
        is_floating = self._attachment.description.is_floating
        return {
            "rate": [self._rate.value, 1.0 / self._attachment.header.control_period],
            "recording": self._status.get("recording", {}),
            "base": base_velocity(record, self._attachment.base).tolist() if is_floating else None,
        }

    async def _pong(self, connection: ServerConnection, ping: int) -> None:
        """Answer a page after the next tick, in which a request of that moment would count; not if none comes."""
        feed = self._attachment.feed
        before, deadline = feed.latest(), time.monotonic() + _PATIENCE
        while feed.latest() == before and time.monotonic() < deadline:
            await asyncio.sleep(_NEXT_TICK)
        if feed.latest() != before:
            with contextlib.suppress(Exception):  # a page that is gone
                await connection.send(encoded({"pong": ping}))

    def _wish(self, page: _Page, message: str | bytes) -> str:
        """Do what a page wants that commands; why not, if it is refused. One that lets go is always heard."""
        if page.access is not Access.CONTROL:
            return _WATCHING
        try:
            wish = parse_wish(message)
            admitting = page.asks if isinstance(wish, Take | Snap) else page.wishes
            if isinstance(wish, LetGo) or admitting.admits(time.monotonic()):
                self._commanding.hear(page.number, wish)
                return ""
        except FieldError as error:
            return str(error)
        return "" if isinstance(wish, Beat) else "left out: more requests than are taken in a second"

    def _choose(self, page: _Page, asked: dict[str, Any]) -> str:
        """Take what a page wants to be shown; say why not, if refused. All pages share the view's figures."""
        if not page.choices.admits(time.monotonic()):
            return f"left out: more than {_CHOICES_PER_SECOND:g} choices a second"
        if "plot" in asked:
            return page.watch.choose(asked["plot"])
        if page.access is not Access.CONTROL:
            return _WATCHING
        return self._showing.switch(asked["show"], on=asked.get("on"))

    def _request(self, page: _Page, asked: dict[str, Any]) -> str:
        """Ask the session for an intent, a mark and the like; why not, if it is refused here."""
        word = str(asked.get("ask", ""))
        if page.access is not Access.CONTROL:
            return _WATCHING
        if word == Intent.DAMP.value:
            return self._damp(page)
        if word.partition(" ")[0] not in _WORDS:
            return f"not understood, expected one of {', '.join(sorted(_WORDS))}"
        if not page.asks.admits(time.monotonic()):
            return f"{word} left out: more than {_ASKS_PER_SECOND:g} requests a second"
        seen = _seen(asked)
        if word == MARK:
            self._marks += 1
            word = f"{MARK} moment {self._marks}"
        elif seen is None:
            return _blind(word)
        loop = asyncio.get_running_loop()
        page.start(self._answer(page, loop.run_in_executor(self._asking, self._wait, word, self._damps, seen)))
        return ""

    def _damp(self, page: _Page) -> str:
        """Post DAMP at once, whatever else is asked for; what became of it is seen in the state."""
        try:
            with self._posting:
                self._damps += 1
                self._damping.post(Intent.DAMP.value)
        except SessionError as error:
            return str(error)
        page.answers.append(Answer(True, "DAMP requested"))
        return ""

    @staticmethod
    async def _answer(page: _Page, asking: Awaitable[Answer]) -> None:
        """Give a page the answer to what was asked, or say why there is none."""
        try:
            page.answers.append(await asking)
        except SessionError as error:
            page.answers.append(Answer(False, str(error)))

    def _wait(self, word: str, damps: int, seen: int | None) -> Answer:
        """Ask, on a thread of its own. What waited for its turn while a DAMP came would move the robot after it."""
        intake = self._attachment.intake
        with self._posting:
            if self._damps != damps:
                return Answer(False, f"{word} left out: DAMP was requested after it")
            token = intake.post(word, seen=seen)
        return intake.answer(token, _REACTIVATING if word == REACTIVATE else _PATIENCE)


def _asked(message: object) -> dict[str, Any]:
    """Return a page's message; empty if it is not understood."""
    try:
        asked = json.loads(message) if isinstance(message, str) else None
    except (ValueError, RecursionError):
        return {}
    return asked if isinstance(asked, dict) else {}


def _seen(asked: dict[str, Any]) -> int | None:
    """Return the stamp of the newest tick that a page had shown when it asked, ns; None if it does not say."""
    seen = asked.get("seen")
    if not isinstance(seen, int | float) or isinstance(seen, bool):
        return None
    return round(1e9 * seen) if 0.0 <= seen < 1e9 else None


def _blind(word: str) -> str:
    return f"{word} refused: the page does not say what it had seen; reload it"
