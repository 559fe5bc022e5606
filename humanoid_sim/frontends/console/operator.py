"""What the operator's page commands of a session: intents, a velocity, and one joint by sliders in REMOTE.

GUI callbacks only leave actions here; `step` takes them in the console's own loop and sends what is due. A velocity and
a joint are commanded only while the page is heard and shows the present.
"""

from __future__ import annotations

import os
import queue
from collections.abc import Callable
from functools import partial

import numpy as np

from humanoid_sim.client import Intake, SessionError, monotonic_ns
from humanoid_sim.errors import FieldError
from humanoid_sim.frontends.attach import Attachment, Tick
from humanoid_sim.frontends.console.gate import Gate
from humanoid_sim.frontends.console.sliders import JointSliders
from humanoid_sim.frontends.joy import policy_speeds
from humanoid_sim.messages import Mode
from humanoid_sim.mit import VELOCITY_COMMAND, FloatArray
from humanoid_sim.session.intent_socket import MARK

_OLD = 0.5  # s, largest age of the tick that a joint is moved by, and largest gap between two commands
_GRACE = 1.5  # s from the first command until the session's status says whose REMOTE, or the velocity, is
_DELIBERATE = 0.1  # s for which a changed velocity claims the command from another producer
_DAMP_FOR, _DAMP_PERIOD = 1.0, 0.1  # s for which DAMP is repeated until DAMPING is seen, and between two
_ANSWER_WITHIN = 30.0  # s: every motor of a bus is asked for its identity when reactivated
_POLL = 0.001  # s


def _seconds_since(stamp: int) -> float:
    return 1e-9 * (monotonic_ns() - stamp)


class Operator:
    """Commands of one session. `damp` and `do` may be called on any thread, all else on the console's."""

    gate: Gate

    def __init__(self, attachment: Attachment) -> None:
        self._attachment, self._intake = attachment, attachment.intake
        self._damping = Intake(attachment.session, "console")
        self._damp_since = self._damped = 0
        self._name = f"console ({os.getpid()})"
        self._actions: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._pending: tuple[str, int] | None = None
        self.answer = ""
        """The latest answer of the session, or why something is refused."""
        self.let_go = ""
        """Why the velocity or the joint is not commanded any more."""
        self.speeds = policy_speeds(attachment.walking_contract)
        """Shape (3, 2): lowest and highest velocity, m/s, m/s, rad/s; None where no policy takes one."""
        self.velocity: FloatArray = np.zeros(3)
        """Shape (3,), m/s, m/s, rad/s: what this console commands."""
        self._steers, self._changed = False, 0
        self.sliders: JointSliders | None = None
        """Joint that is moved; None for none."""
        self._pose = "a"
        self._since = self._stepped = self._sent = 0
        self._timeout = 1e-3 * attachment.description.remote_policy_controller.stale_command_timeout_ms

    def close(self) -> None:
        """Let go."""
        tick = self._attachment.latest
        try:
            if self.sliders is not None and tick is not None:
                self._leave(tick, "the console ends")
        except SessionError:  # it has ended
            pass
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

    def step(self) -> None:
        """Do what was asked for, and send what is due."""
        tick = self._attachment.latest
        if tick is None:
            return
        try:
            while not self._actions.empty():
                self._actions.get()()
            self._repeat_damp(tick)
            self._take_answer()
            if tick.record.output.control_mode.mode is Mode.STANDBY:
                self._pose, self.let_go = tick.record.output.control_mode.controller_name[-1], ""
            self._steer_on(tick)
            self._move_on(tick)
        except SessionError as error:
            self.answer, self.sliders, self._steers = str(error), None, False

    # Intents.

    def ask(self, word: str, seen: int) -> None:
        """Ask the session for something; `seen` is the stamp of the newest tick that the page showed, ns."""
        if not seen:
            self.answer = f"{word} left out: its page was not heard"
            return
        self._pending = self._intake.post(word, seen=seen), monotonic_ns()
        self.answer = f"{word} …"

    def _take_answer(self) -> None:
        if self._pending is None:
            return
        token, since = self._pending
        try:
            self.answer, self._pending = self._intake.answer(token, _POLL).text, None
        except SessionError as error:
            if _seconds_since(since) > _ANSWER_WITHIN:
                self.answer, self._pending = str(error), None

    def _repeat_damp(self, tick: Tick) -> None:
        is_damped = tick.stamp > self._damp_since and tick.record.output.control_mode.mode is Mode.DAMPING
        if is_damped or _seconds_since(self._damp_since) > _DAMP_FOR:
            self._damp_since = 0
        if self._damp_since and _seconds_since(self._damped) > _DAMP_PERIOD:
            self._damped = monotonic_ns()
            self._damping.post("damp")

    # The velocity.

    def steer(self, axis: int, value: float) -> None:
        """Change one component of the velocity, m/s, m/s, rad/s, beginning with the one in force."""
        assert self._attachment.latest is not None
        present = self._attachment.latest.record.input.state.extern.get(VELOCITY_COMMAND)
        velocity = self.velocity if self._steers or present is None else present.value
        self._command(np.where(np.arange(3) == axis, value, velocity))

    def stop(self) -> None:
        """Command a velocity of zero."""
        self._command(np.zeros(3))

    def _command(self, velocity: FloatArray) -> None:
        assert self.speeds is not None
        assert self._attachment.latest is not None
        mode = self._attachment.latest.record.output.control_mode.mode
        bounded = np.clip(velocity, self.speeds[:, 0], self.speeds[:, 1])
        if bounded.any() and mode is not Mode.LOCOMOTION:
            self.answer = f"velocity refused: requires LOCOMOTION, mode is {mode.name}"
            return
        self.velocity, self._steers, self._changed, self.let_go = bounded, True, monotonic_ns(), ""

    def _steer_on(self, tick: Tick) -> None:
        if not self._steers:
            return
        mode, age = tick.record.output.control_mode.mode, _seconds_since(self._changed)
        problem = self.gate.silence() or self._owner_problem("velocity", age)
        if mode is not Mode.LOCOMOTION and self.velocity.any():
            problem = f"mode is {mode.name}"
        if problem:
            self._let_go(f"velocity let go: {problem}")
            self._intake.velocity(0.0, 0.0, 0.0, deliberate=False)
        if problem or (age > _DELIBERATE and not self.velocity.any()):
            self._steers, self.velocity = False, np.zeros(3)
            return
        # As old as the page's heartbeat: a page that falls silent stops the robot by itself.
        self._intake.velocity(*self.velocity.tolist(), deliberate=age <= _DELIBERATE, stamp=self.gate.heard())

    # One joint.

    def take(self, name: str) -> None:
        """Move this joint by sliders from here on."""
        tick = self._attachment.latest
        assert tick is not None
        owner = self._attachment.status().get("owners", {}).get("REMOTE", "")
        problem = self._joint_problem(tick)
        if not problem and owner not in ("", self._name):
            problem = f"REMOTE belongs to {owner}"
        try:
            sliders = self.sliders or JointSliders(self._attachment.description, self._pose)
        except FieldError as error:
            problem = str(error)
        if problem:
            self.answer = f"sliders refused: {problem}"
            return
        sliders.choose(self._attachment.header.joint_names.index(name), tick.record.input.state.joint_position)
        if self.sliders is None:
            self._since = self._stepped = self._sent = monotonic_ns()
        self.sliders, self.let_go = sliders, ""
        self._intake.post(f"{MARK} the page moves {name} by sliders")

    def set_goal(self, row: int, value: float) -> None:
        """Take the value of a slider; `row` as in `JointSliders.goals`."""
        if self.sliders is not None:
            self.sliders.goals[row] = value

    def leave(self) -> None:
        """Move no joint any more."""
        if self.sliders is not None and self._attachment.latest is not None:
            self._leave(self._attachment.latest, "the operator let go")

    def _leave(self, tick: Tick, why: str) -> None:
        """Let go; REMOTE becomes passive at once, whatever it does with commands that are stale."""
        assert self.sliders is not None
        if tick.record.output.control_mode.mode is Mode.REMOTE:
            self._attachment.send(self.sliders.passive(tick.record.input.state.joint_position), tick.stamp)
        self.sliders = None
        self._let_go(f"sliders let go: {why}")

    def _move_on(self, tick: Tick) -> None:
        if self.sliders is None:
            return
        gap, position = _seconds_since(self._sent), tick.record.input.state.joint_position
        problem = self._joint_problem(tick) or self.gate.silence()
        if not problem and gap > _OLD:
            problem = f"the console was held up for {gap:.1f} s"
        problem = problem or self._owner_problem("REMOTE", _seconds_since(self._since))
        if problem:
            self._leave(tick, problem)
            return
        now = monotonic_ns()
        if gap > self._timeout:  # the joints were damped meanwhile
            self.sliders.restart(position)
            self._since = now
        command = self.sliders.step(position, 1e-9 * (now - self._stepped))
        self._stepped = now
        if self._attachment.send(command, tick.stamp):
            self._sent = tick.stamp

    def _joint_problem(self, tick: Tick) -> str:
        mode = tick.record.output.control_mode.mode
        if mode is not Mode.REMOTE:
            return f"requires REMOTE, mode is {mode.name}"
        if tick.age > _OLD:
            return "the session stands still"
        unknown = np.flatnonzero(~np.isfinite(tick.record.input.state.joint_position))
        return f"the position of {self._attachment.header.joint_names[unknown[0]]} is not known" if unknown.size else ""

    def _owner_problem(self, what: str, age: float) -> str:
        owner = self._attachment.status().get("owners", {}).get(what, "") if age > _GRACE else self._name
        if owner == self._name:
            return ""
        return f"{owner} controls it now" if owner else "the session refuses the commands"

    def _let_go(self, why: str) -> None:
        self.let_go = why
        self._intake.post(f"{MARK} {why}")
