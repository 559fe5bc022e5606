"""Turns of pages at the sliders and at the velocity: whose they are, until when, and what they command.

No clock, no socket.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from humanoid_sim.client import VELOCITY_TIMEOUT
from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.frontends.console.sliders import Goals, Sliders, SliderState
from humanoid_sim.frontends.console.wishes import SEEN_WITHIN
from humanoid_sim.messages import Mode
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, MITCommand
from humanoid_sim.robots.schema import RobotDescription
from humanoid_sim.session.sources import VELOCITY_KEYS

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

        Raises `FieldError` if no such joint, or another page has the turn.

        Args:
            position: shape (n,), rad, measured, finite.
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
        """Note that the page was heard. Raises `FieldError` if a goal is not a finite number.

        Args:
            number: what `told` told it with the goals that its sliders began from; older goals do not count.
            goals: where its sliders stand; None: unchanged.
            seen: ns, when what it shows left the console.
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


_DELIBERATE = 0.1
"""s for which a change is sent as deliberate: of what arrives within one tick only the newest counts."""


@dataclass(frozen=True, slots=True)
class Due:
    """A velocity command to send."""

    velocity: tuple[float, float, float]
    """m/s, m/s, rad/s."""
    deliberate: bool
    heard: int
    """Time of the latest message from its page, CLOCK_MONOTONIC ns, from which its age counts."""


class Steering:
    """At most one page steers: the one that changed the velocity last. A slider at rest claims nothing."""

    def __init__(self, ranges: FloatArray) -> None:
        """Nobody steers; `ranges` has shape (3, 2): m/s, m/s, rad/s, zero among them."""
        self._ranges = ranges
        self.page: int | None = None
        self.velocity: FloatArray = np.zeros(3)
        """Shape (3,), m/s, m/s, rad/s."""
        self.changed = self._heard = self._seen = 0
        """ns"""

    def press(self, page: int, key: str, present: FloatArray, mode: Mode, now: int) -> None:
        """Take a velocity key: a step from `present`, shape (3,), the command that counts, whoever's it is; or a stop.

        Raises `FieldError` if no such key, or the robot does not walk; a stop is always taken.
        """
        if key not in VELOCITY_KEYS:
            raise FieldError(f"velocity: {known_names('key', key[:20], tuple(VELOCITY_KEYS))}")
        change = VELOCITY_KEYS[key]
        before = self.velocity if self.page == page else present
        after: FloatArray = before + np.array(change, dtype=np.float64) if any(change) else np.zeros(3)
        self._take(page, after, mode, now)

    def steer(self, page: int, axis: int, value: float, present: FloatArray, mode: Mode, now: int) -> None:
        """Take a slider: one component anew. Arguments and errors as for `press`."""
        if axis not in range(3):
            raise FieldError(f"velocity: axis is {axis}, expected 0, 1 or 2")
        if not math.isfinite(value):
            raise FieldError(f"velocity: is {value}, expected a finite number")
        velocity: FloatArray = np.array(self.velocity if self.page == page else present)
        velocity[axis] = value
        self._take(page, velocity, mode, now)

    def _take(self, page: int, velocity: FloatArray, mode: Mode, now: int) -> None:
        bounded: FloatArray = np.clip(velocity, self._ranges[:, 0], self._ranges[:, 1]).round(6)
        if bounded.any() and mode is not Mode.LOCOMOTION:
            raise FieldError(f"velocity refused: requires LOCOMOTION, mode is {mode.name}")
        self.page, self.velocity, self.changed = page, bounded, now
        self._heard = self._seen = now

    def beat(self, page: int, now: int, seen: int) -> None:
        """Note that a page was heard; `seen` (ns) is when what it shows left the console."""
        if page == self.page:
            self._heard, self._seen = now, seen

    def let_go(self) -> None:
        """Nobody steers any more; what was commanded last ends by itself."""
        self.page, self.velocity = None, np.zeros(3)

    def problem(self, mode: Mode, owner: str | None, now: int) -> str:
        """Return why its page steers no longer; empty if it still does.

        `owner` is whom else the velocity belongs to, None for nobody else; `now` in ns.
        """
        if 1e-9 * (now - self._heard) > VELOCITY_TIMEOUT:
            return f"page {self.page} was not heard for {VELOCITY_TIMEOUT:g} s"
        if 1e-9 * (now - self._seen) > SEEN_WITHIN:
            return f"page {self.page} shows what is older than {SEEN_WITHIN:g} s"
        if self.velocity.any() and mode is not Mode.LOCOMOTION:
            return f"mode is {mode.name}"
        if owner is None:
            return ""
        return f"{owner} controls it now" if owner else "no longer controlled by anyone"

    def due(self, now: int) -> Due | None:
        """Return what to send at present; None if nothing. A stop is sent for as long as it is news."""
        if self.page is None:
            return None
        deliberate = 1e-9 * (now - self.changed) <= _DELIBERATE
        if not deliberate and not self.velocity.any():
            self.let_go()
            return None
        vx, vy, wz = self.velocity.tolist()
        return Due((vx, vy, wz), deliberate, self._heard)
