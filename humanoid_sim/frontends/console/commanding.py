"""Commands from pages, other than intents: one joint by sliders in REMOTE, and a velocity. One page at a time has each.

They are sent on a thread of their own, so that the page's server cannot delay them, and only while messages from the
commanding page arrive: an open socket is not enough.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from time import monotonic, sleep
from typing import Any

import numpy as np

from humanoid_sim.client import Intake, Sample, SessionError, monotonic_ns
from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.attach import Attachment
from humanoid_sim.frontends.console.turn import Due, SliderTurn, Steering
from humanoid_sim.frontends.console.wishes import Beat, LetGo, Press, Snap, Steer, Take, Wish
from humanoid_sim.frontends.gamepad.layout import policy_speeds
from humanoid_sim.messages import Mode, TickRecord
from humanoid_sim.mit import COMMAND_FIELDS, VELOCITY_COMMAND, FloatArray, MITCommand
from humanoid_sim.session.intent_socket import MARK
from humanoid_sim.session.sources import VELOCITY_KEYS, velocity_key_help

_PERIOD = 0.02
"""s between two commands, where the session's timeout is at least four times that."""
_STANDS_STILL = 0.5
"""s that the session's newest tick may be old."""
_GRACE = 0.5
"""s after the first command in which the session may not have said yet whose REMOTE, or the velocity, is."""
_EARLIEST = -1e9
"""s"""


class Commanding:
    """All that pages command of one session. Pages are heard on one thread, commands leave on another."""

    def __init__(self, attachment: Attachment, clock: Callable[[], int] = monotonic_ns) -> None:
        """Command nothing; `clock` gives CLOCK_MONOTONIC in ns. Raises `SessionError` if the session has ended."""
        self._attachment, self._clock = attachment, clock
        self._joint_names = attachment.description.joint_names
        self._turn = SliderTurn(attachment.description)
        self._speeds = policy_speeds(attachment.walking_contract)
        self._steering = None if self._speeds is None else Steering(self._speeds)
        self._timeout = 1e-3 * attachment.description.remote_policy_controller.stale_command_timeout_ms
        self._intake = Intake(attachment.session, "console")
        self._name = f"{self._intake.producer} ({os.getpid()})"
        self._let_go_text = ""
        self._notes: list[str] = []
        self._is_leaving = self._is_closing = False
        self._error: Exception | None = None
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._run, name="commanding", daemon=True)

    def start(self) -> None:
        """Send from here on."""
        self._thread.start()

    def close(self) -> None:
        """Let go, and end."""
        with self._lock:
            self._let_go("the console ends")
            self._is_closing = True
        self._wake.set()
        if self._thread.ident is not None:
            self._thread.join()
        self._intake.close()

    # What pages ask for.

    def hear(self, page: int, wish: Wish) -> None:
        """Do what a page wants. Raises `FieldError` if it is refused."""
        with self._lock:
            if isinstance(wish, Beat):
                self._beat(page, wish)
            elif isinstance(wish, LetGo):
                self._leave(page, f"page {page} let go")
            elif isinstance(wish, Take):
                self._take(page, wish.joint)
            elif isinstance(wish, Snap):
                self._turn.snap(page, self._measured())
            else:
                self._steer(page, wish)
        self._wake.set()

    def leave(self, page: int) -> None:
        """Let go of all that a page held, which has closed."""
        with self._lock:
            self._leave(page, f"page {page} has closed")
        self._wake.set()

    def look(self, record: TickRecord) -> None:
        """Follow the mode: the other joints will be held with the gains with which the robot stood."""
        if self._error is not None:
            raise self._error
        if record.output.control_mode.mode is Mode.STANDBY:
            self._let_go_text = ""
            self._turn.standby = record.output.control_mode.controller_name[-1]

    def _beat(self, page: int, beat: Beat) -> None:
        now = self._clock()
        seen = int(1e9 * min(max(beat.seen, _EARLIEST), 1e-9 * now))
        self._turn.beat(page, beat.number, beat.goals, now, seen)
        if self._steering is not None:
            self._steering.beat(page, now, seen)

    def _take(self, page: int, name: str) -> None:
        owner = self._owners().get("REMOTE", "")
        if owner not in ("", self._name):
            raise FieldError(f"sliders: REMOTE belongs to {owner}")
        self._turn.take(page, name, self._measured(), self._clock())
        self._is_leaving, self._let_go_text = False, ""
        self._notes.append(f"page {page} moves {name} by sliders")

    def _steer(self, page: int, wish: Steer | Press) -> None:
        steering, found = self._steering, self._attachment.latest()
        if steering is None or found is None:
            raise FieldError("velocity: the policy takes no command, or the session has not begun")
        mode, present, now = found[1].output.control_mode.mode, _velocity(found[1]), self._clock()
        if isinstance(wish, Press):
            steering.press(page, wish.key, present, mode, now)
        else:
            steering.steer(page, wish.axis, wish.value, present, mode, now)
        self._let_go_text = ""

    def _measured(self) -> FloatArray:
        """Shape (n,), rad. Raises `FieldError` where the robot is not in REMOTE, or a joint is not known."""
        found = self._attachment.latest()
        problem = "the session has not begun" if found is None else self._session_problem(*found)
        if found is None or problem:
            raise FieldError(f"sliders: require REMOTE; {problem}")
        return found[1].input.state.joint_position

    def _leave(self, page: int, why: str) -> None:
        if self._turn.page == page:
            self._let_go(why)
        if self._steering is not None and self._steering.page == page:
            self._steering.let_go()

    def _let_go(self, why: str) -> None:
        """End the turn; REMOTE becomes passive at once, whatever it does with commands that are stale."""
        if self._turn.page is not None:
            self._turn.let_go()
            self._is_leaving = True
            self._let_go_text = f"sliders let go: {why}"
            self._notes.append(self._let_go_text)

    # What is sent.

    def _run(self) -> None:
        try:
            self._send_on()
        except Exception as error:  # nothing is sent any more, so REMOTE is passive; `look` ends the console
            self._error = error

    def _send_on(self) -> None:
        period = min(_PERIOD, 0.25 * self._timeout)
        due = monotonic()
        while True:
            with self._lock:
                steers = self._steering is not None and self._steering.page is not None
                is_busy = self._turn.page is not None or steers or self._is_leaving or bool(self._notes)
                if self._is_closing and not is_busy:
                    return
            if is_busy:
                self.step()
                due = max(due + period, monotonic())
                sleep(max(due - monotonic(), 0.0))
            else:
                self._wake.wait()
                self._wake.clear()
                due = monotonic()

    def step(self) -> None:
        """Look at the session, and send what is due."""
        try:
            found = self._attachment.latest()
            with self._lock:
                now = self._clock()
                command = None if found is None else self._command(*found, now)
                velocity = None if found is None else self._velocity(found[1], now)
                notes, self._notes = self._notes, []
            if command is not None and found is not None and self._send(command, found[0].stamp):
                self._turn.sent(found[0].stamp)
            if velocity is not None:
                self._intake.velocity(*velocity.velocity, deliberate=velocity.deliberate, stamp=velocity.heard)
            for note in notes:
                self._intake.post(f"{MARK} {note}")
        except SessionError as error:
            with self._lock:
                self._let_go(str(error))
                if self._steering is not None:
                    self._steering.let_go()
                self._is_leaving, self._notes = False, []

    def _command(self, sample: Sample, record: TickRecord, now: int) -> MITCommand | None:
        state = record.input.state
        if self._turn.page is not None:
            was_passive = self._turn.gap(now) > self._timeout
            problem = self._session_problem(sample, record) or self._turn.problem(now)
            if not problem and not was_passive:  # after a gap nobody may own REMOTE
                problem = self._ownership_problem(self._turn.since)
            if not problem:
                return self._turn.step(state.joint_position, state.joint_velocity, now, was_passive=was_passive)
            self._let_go(problem)
        is_leaving, self._is_leaving = self._is_leaving, False
        is_remote = record.output.control_mode.mode is Mode.REMOTE
        return self._turn.passive(state.joint_position) if is_leaving and is_remote else None

    def _velocity(self, record: TickRecord, now: int) -> Due | None:
        steering = self._steering
        if steering is None or steering.page is None:
            return None
        owner = self._other_owner("velocity", steering.changed)
        problem = steering.problem(record.output.control_mode.mode, owner, now)
        if problem:
            self._let_go_text = f"velocity let go: {problem}"
            self._notes.append(self._let_go_text)
            steering.let_go()
            return Due((0.0, 0.0, 0.0), deliberate=False, heard=now)  # at once, and only if it is still this console's
        return steering.due(now)

    def _send(self, command: MITCommand, stamp: int) -> bool:
        fields = (getattr(command, name).tolist() for name in COMMAND_FIELDS)
        return self._intake.remote(self._joint_names, *fields, stamp=stamp)

    def _session_problem(self, sample: Sample, record: TickRecord) -> str:
        mode = record.output.control_mode.mode
        if mode is not Mode.REMOTE:
            return f"mode is {mode.name}"
        if 1e-9 * (self._clock() - sample.stamp) > _STANDS_STILL:
            return "the session stands still"
        unknown = np.flatnonzero(~np.isfinite(record.input.state.joint_position))
        return f"the position of {self._joint_names[unknown[0]]} is not known" if unknown.size else ""

    def _ownership_problem(self, since: int) -> str:
        owner = self._other_owner("REMOTE", since)
        if owner is None:
            return ""
        mine = [line for line in self._attachment.feed.status().get("refused", ()) if str(line).startswith(self._name)]
        why = mine[-1] if mine else "nobody owns REMOTE"
        return f"REMOTE belongs to {owner}" if owner else f"the commands are refused: {why}"

    def _owners(self) -> dict[str, str]:
        return dict(self._attachment.feed.status().get("owners", {}))

    def _other_owner(self, what: str, since: int) -> str | None:
        """Return who has it, if the session says so after `since` (ns) and some grace; None if this console has it."""
        if self._attachment.feed.status().get("stamp", 0) < since + int(1e9 * _GRACE):
            return None
        owner = self._owners().get(what, "")
        return None if owner == self._name else owner

    # What pages are told.

    def known(self, page: int) -> dict[str, Any]:
        """Return what a page is told once."""
        velocity = None
        if self._speeds is not None:
            velocity = {"ranges": self._speeds.tolist(), "keys": list(VELOCITY_KEYS), "help": velocity_key_help()}
        return {"page": page, "no_sliders": self._turn.why_none, "velocity": velocity}

    def told(self, record: TickRecord) -> dict[str, Any]:
        """Return what pages are told again and again."""
        with self._lock:
            steering = self._steering
            return {
                "sent": 1e-9 * self._clock(),
                "sliders": self._turn.told(record.input.state.joint_position),
                "steering": None
                if steering is None
                else {
                    "page": steering.page,
                    "wanted": steering.velocity.tolist(),
                    "present": _velocity(record).tolist(),
                },
                "let_go": self._let_go_text,
            }


def _velocity(record: TickRecord) -> FloatArray:
    """Shape (3,): the velocity command that counts, m/s, m/s, rad/s."""
    extern = record.input.state.extern.get(VELOCITY_COMMAND)
    value: FloatArray = np.zeros(3) if extern is None else extern.at(record.input.state.time)
    return value
