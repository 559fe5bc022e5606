"""The sliders' turn: which page has them, for how long, and what they make of its goals. No clock, no socket."""

from __future__ import annotations

from typing import Any

import msgspec

from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.frontends.console.sliders import Goals, Sliders, SliderState
from humanoid_sim.frontends.console.wishes import SEEN_WITHIN
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITCommand
from humanoid_sim.robots.schema import RobotDescription

_HEARD_WITHIN = 0.5
"""s without a beat of the page after which its turn is over."""


class SliderTurn:
    """At most one page moves a joint. A turn that is over does not go on by itself."""

    _sliders: Sliders
    """Arithmetic of the turn, with the gains of the STANDBY that it began in."""

    def __init__(self, robot: RobotDescription) -> None:
        self.why_none = ""
        """Reason why this robot has no sliders; empty if it has them."""
        self._joint_names = robot.joint_names
        self._all: dict[str, Sliders] = {}
        try:
            self._all = {name: Sliders(robot, name) for name in "ab"}
        except FieldError as error:
            self.why_none = str(error)
        self.standby = "a"
        """The standby controller by which the robot came to stand: the other joints are held with its gains."""
        self.page: int | None = None
        self.since = 0
        """ns: commands have gone out without a pause since."""
        self._state: SliderState | None = None
        self._number = 0
        self._heard = self._seen = self._stepped = self._newest = 0

    @property
    def joint(self) -> str:
        """Name of the joint that is moved; empty for none."""
        return "" if self._state is None else self._joint_names[self._state.joint]

    def take(self, page: int, name: str, position: FloatArray, now: int) -> None:
        """Begin a turn, or choose another joint in one's own.

        Args:
            position: shape (n,), rad, measured, finite.

        Raises:
            FieldError: no such joint, or another page has the turn.
        """
        if not self._all:
            raise FieldError(self.why_none)
        if self.page is not None and self.page != page:
            raise FieldError(f"sliders: page {self.page} moves {self.joint}")
        if name not in self._joint_names:
            raise FieldError(f"sliders: {known_names('joint', name[:40], self._joint_names)}")
        joint = self._joint_names.index(name)
        if self._state is not None:
            self._state = self._sliders.choose(self._state, joint, position)
        else:
            self._sliders = self._all[self.standby]
            self._state = self._sliders.begin(joint, position)
            self.page, self.since = page, now
            self._heard = self._seen = self._stepped = self._newest = now
        self._number += 1

    def snap(self, page: int, position: FloatArray) -> None:
        """Move the sliders to where the joint is, with gains 0. Raises `FieldError` for a page without the turn."""
        if self._state is None or self.page != page:
            raise FieldError("sliders: this page does not move a joint")
        self._state = self._sliders.snap(self._state, position)
        self._number += 1

    def beat(self, page: int, number: int, goals: Goals | None, now: int, seen: int) -> None:
        """Note that the page was heard.

        Args:
            number: what `told` told it with the goals that its sliders began from; older goals do not count.
            goals: where its sliders stand; None: unchanged.
            seen: ns, when what it shows left the console.

        Raises:
            FieldError: a goal is not a finite number.
        """
        if self._state is None or page != self.page:
            return
        self._heard, self._seen = now, max(self._seen, min(seen, now))
        if goals is not None and number == self._number:
            self._state = self._sliders.wish(self._state, goals)

    def let_go(self) -> None:
        """End the turn."""
        self.page = self._state = None

    def problem(self, now: int) -> str:
        """Return why the turn must end; empty while it may go on. `now` in ns."""
        if 1e-9 * (now - self._heard) > _HEARD_WITHIN:
            return f"page {self.page} was not heard for {_HEARD_WITHIN:g} s"
        if 1e-9 * (now - self._seen) > SEEN_WITHIN:
            return f"page {self.page} shows what is older than {SEEN_WITHIN:g} s"
        if 1e-9 * (now - self._newest) > _HEARD_WITHIN:
            return f"the console was held up for {_HEARD_WITHIN:g} s"
        return ""

    def gap(self, now: int) -> float:
        """Return s since the newest command that has left; `now` in ns."""
        return 1e-9 * (now - self._newest)

    def step(self, position: FloatArray, velocity: FloatArray, now: int, *, was_passive: bool) -> MITCommand:
        """Return the next command of a turn that goes on.

        Args:
            position: shape (n,), rad, measured, finite.
            velocity: shape (n,), rad/s, measured.
            was_passive: commands were missing, so that the joints were damped meanwhile.
        """
        assert self._state is not None
        elapsed, self._stepped = 1e-9 * (now - self._stepped), now
        if was_passive:
            self._state, self.since = self._sliders.again(self._state, position), now
        self._state = self._sliders.step(self._state, position, velocity, elapsed)
        return self._state.command

    def sent(self, stamp: int) -> None:
        """Note that the command of this step has left; `stamp` (ns) says how old it is."""
        self._newest = max(self._newest, stamp)

    def passive(self, position: FloatArray) -> MITCommand:
        """Return what REMOTE does without commands; `position` has shape (n,), rad."""
        return self._all[self.standby].passive(position)

    def told(self, position: FloatArray) -> dict[str, Any] | None:
        """Return what pages show of the turn; None while there is none. `position` has shape (n,), rad, measured."""
        state = self._state
        if state is None:
            return None
        return {
            "page": self.page,
            "number": self._number,
            "joint": self.joint,
            "goals": msgspec.to_builtins(state.goals),
            "bounds": {name: getattr(state.bounds, name) for name in COMMAND_FIELDS},
            "command": {name: float(getattr(state.command, name)[state.joint]) for name in COMMAND_FIELDS},
            "measured": float(position[state.joint]),
        }
