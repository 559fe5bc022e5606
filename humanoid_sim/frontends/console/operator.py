"""What the operator's page commands of a session: intents, a velocity, and the joints by sliders in REMOTE.

GUI callbacks only leave actions here; `step` does them in the console's own loop and sends what is due. A velocity and
joints are commanded only while the page sends heartbeats and shows the present.
"""

from __future__ import annotations

import contextlib
import os
import queue
from collections.abc import Callable
from functools import partial

import numpy as np

from humanoid_sim.client import Intake, SessionError, monotonic_ns
from humanoid_sim.frontends.attach import Attachment, Tick
from humanoid_sim.frontends.console.gate import Gate
from humanoid_sim.frontends.console.sliders import JointSliders
from humanoid_sim.frontends.joy import policy_speeds
from humanoid_sim.messages import Mode
from humanoid_sim.mit import FloatArray

_OLD = 0.5  # s, largest age of the tick that a joint is moved by, and largest gap between two commands
_DAMP_FOR, _DAMP_PERIOD = 1.0, 0.1  # s for which DAMP is repeated until DAMPING is seen, and between two
_POLL = 0.001  # s that an answer is waited for


def _seconds_since(stamp: int) -> float:
    return 1e-9 * (monotonic_ns() - stamp)


class Operator:
    """Commands of one session. `damp`, `do` and `request` may be called on any thread, all else on the console's."""

    def __init__(self, attachment: Attachment, gate: Gate) -> None:
        self._attachment, self._gate, self._intake = attachment, gate, attachment.intake
        self._damping = Intake(attachment.session, "console")
        gate.damp = self.damp
        self._damp_since = self._damped = 0
        self._actions: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._token = ""
        self.answer = ""  # of the session, to the latest request; or why something is refused or has ended
        self.speeds = policy_speeds(attachment.header)
        self.velocity: FloatArray = np.zeros(3)  # that this console commands, m/s, m/s, rad/s
        self._is_steered = False  # by hand, since the velocity was sent
        self.sliders: JointSliders | None = None  # while they move the joints
        self._stepped = self._sent = 0

    def close(self) -> None:
        with contextlib.suppress(SessionError):  # it has ended
            self.leave("the console ends")
        self._damping.close()

    def damp(self) -> None:
        """Post DAMP at once, and again until DAMPING is seen."""
        self._damp_since = self._damped = monotonic_ns()
        try:
            self._damping.post("damp")
        except SessionError as error:
            self.answer = str(error)

    def do(self, action: Callable[..., None], *arguments: object) -> None:
        """Have `step` call this."""
        self._actions.put(partial(action, *arguments))

    def request(self, word: str) -> None:
        """Have `step` request something, of the robot as the page shows it now."""
        self.do(self._request, word, self._gate.seen())

    def step(self) -> None:
        """Do what was requested, and send what is due."""
        tick = self._attachment.latest
        if tick is None:
            return
        try:
            while not self._actions.empty():
                self._actions.get()()
            self._repeat_damp(tick)
            if self._token:
                with contextlib.suppress(SessionError):  # not yet
                    self.answer, self._token = self._intake.answer(self._token, _POLL).text, ""
            self._steer_on(tick)
            self._move_on(tick)
        except SessionError as error:
            self.answer, self.sliders, self.velocity = str(error), None, np.zeros(3)

    def _request(self, word: str, seen: int) -> None:
        if seen:
            self._token, self.answer = self._intake.post(word, seen=seen), f"{word} …"
        else:
            self.answer = f"{word} left out: no heartbeat of its page"

    def _repeat_damp(self, tick: Tick) -> None:
        is_damped = tick.stamp > self._damp_since and tick.record.output.control_mode.mode is Mode.DAMPING
        if is_damped or _seconds_since(self._damp_since) > _DAMP_FOR:
            self._damp_since = 0
        if self._damp_since and _seconds_since(self._damped) > _DAMP_PERIOD:
            self._damped = monotonic_ns()
            self._damping.post("damp")

    def steer(self, axis: int, value: float) -> None:
        """Change one component of the velocity, m/s, m/s, rad/s."""
        assert self.speeds is not None
        self.velocity[axis], self._is_steered = np.clip(value, *self.speeds[axis]), True

    def stop(self) -> None:
        self.velocity, self._is_steered = np.zeros(3), True

    def _steer_on(self, tick: Tick) -> None:
        if not self._is_steered and not self.velocity.any():
            return
        mode = tick.record.output.control_mode.mode
        problem = self._gate.silence() or ("" if mode is Mode.LOCOMOTION else f"mode is {mode.name}")
        if problem and self.velocity.any():
            self.answer, self.velocity = f"velocity let go: {problem}", np.zeros(3)
        # As old as the page's heartbeat: a page that falls silent stops the robot by itself.
        deliberate = self._is_steered and not problem
        self._intake.velocity(*self.velocity.tolist(), deliberate=deliberate, stamp=self._gate.heartbeat())
        self._is_steered = False

    def take(self) -> None:
        """Move the joints by sliders from here on."""
        tick = self._attachment.latest
        assert tick is not None
        problem = self._joint_problem(tick)
        if problem:
            self.answer = f"sliders refused: {problem}"
        elif self.sliders is None:
            self.sliders = JointSliders(self._attachment.description, tick.record.input.state.joint_position)
            self._stepped = self._sent = monotonic_ns()

    def set_goal(self, joint: int, value: float) -> None:
        """Set a joint's slider, rad."""
        if self.sliders is not None:
            self.sliders.goals[joint] = value

    def leave(self, why: str = "the operator let go") -> None:
        """Move no joint any more; REMOTE becomes passive at once, whatever it does with commands that are stale."""
        tick = self._attachment.latest
        if self.sliders is None or tick is None:
            return
        if tick.record.output.control_mode.mode is Mode.REMOTE:
            self._attachment.send(self.sliders.passive(tick.record.input.state.joint_position), tick.stamp)
        self.sliders, self.answer = None, f"sliders let go: {why}"

    def _move_on(self, tick: Tick) -> None:
        if self.sliders is None:
            return
        now, gap, position = monotonic_ns(), _seconds_since(self._sent), tick.record.input.state.joint_position
        problem = self._joint_problem(tick) or self._gate.silence()
        if problem or gap > _OLD:
            self.leave(problem or f"the console was held up for {gap:.1f} s")
            return
        if 1e3 * gap > self._attachment.description.remote_policy_controller.stale_command_timeout_ms:
            self.sliders.restart(position)  # the joints were damped meanwhile
        command = self.sliders.step(position, 1e-9 * (now - self._stepped))
        self._stepped = now
        if self._attachment.send(command, tick.stamp):
            self._sent = tick.stamp

    def _joint_problem(self, tick: Tick) -> str:
        mode = tick.record.output.control_mode.mode
        owner = self._attachment.status().get("owners", {}).get("REMOTE", "")
        if mode is not Mode.REMOTE:
            return f"requires REMOTE, mode is {mode.name}"
        if owner not in ("", f"console ({os.getpid()})"):
            return f"REMOTE belongs to {owner}"
        if tick.age > _OLD:
            return "the session stands still"
        unknown = np.flatnonzero(~np.isfinite(tick.record.input.state.joint_position))
        return f"the position of {self._attachment.header.joint_names[unknown[0]]} is not known" if unknown.size else ""
