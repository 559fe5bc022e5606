"""A control stack against anything: Hypothesis drives it with hostile inputs, and every tick is checked."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.internal.conjecture import engine
from hypothesis.reporting import current_reporter, with_reporter
from hypothesis.stateful import precondition, rule
from hypothesis.strategies import DataObject

from humanoid_sim.controllers.joy import JoyBindings, pressed_intents
from humanoid_sim.messages import Intent, Mode, RemoteCommand, SafetyStatus, TickInput
from humanoid_sim.mit import MITCommand
from humanoid_sim.testing.checks import require
from humanoid_sim.testing.drive import StackDriver
from humanoid_sim.testing.healthy import healthy_externs
from humanoid_sim.testing.policies import misbehaviours
from humanoid_sim.testing.properties import RL
from humanoid_sim.testing.strategies import (
    any_externs,
    any_remote_commands,
    any_states,
    any_tick_inputs,
    button_readings,
    clock_jumps,
    healthy_states,
    intents,
    safety_statuses,
    valid_commands,
)

SHRINK_SECONDS = 30.0
"""s, unless another time is given."""


@contextmanager
def shrinking_for(seconds: float) -> Iterator[None]:
    """Let Hypothesis shrink for so long; it takes no such setting, and says "five minutes" when its time is up."""
    before, report = engine.MAX_SHRINKING_SECONDS, current_reporter()

    def without_that(text: object) -> None:
        if "more than five minutes" not in str(text):
            report(text)

    engine.MAX_SHRINKING_SECONDS = seconds  # type: ignore[assignment]  # it is added to a float
    try:
        with with_reporter(without_that):
            yield
    finally:
        engine.MAX_SHRINKING_SECONDS = before


_POSES = st.sampled_from([Intent.LOAD_A, Intent.LOAD_B])
_STARTS = st.sampled_from([Intent.START_LOCOMOTION, Intent.START_REMOTE])
_ANSWERS = st.sampled_from(["well behaved", *sorted(misbehaviours(1))])
_SMALL_JUMPS = st.sampled_from([0.02, 0.02, 0.02, 0.0, 0.05, 0.11, -0.02, -5.0])
"""s from one tick of a remote session to the next."""
_SKEWS = st.sampled_from([0.0, 0.0, -0.01, -0.06, -0.2, 0.01, 3.0, -100.0])
"""s, arrival time less the time of the tick that first shows the command."""
_STRETCHES = st.sampled_from([100, 300, 1000])
"""Ticks."""
_BUTTONS = 8
_FURTHEST_TIME = 1e9
"""s. A clock beyond it has no room for hundredths of a second, and the run could not go on from there."""


class StackMachine(StackDriver):
    """One run of a control stack. Healthy rules take it deep, hostile rules attack it there; every tick is checked.

    Subclass it and give `build`; the subclass's `TestCase` is what pytest and unittest collect. To check more than
    `SafetyProperties`, extend `check` or give another `properties_type`. To attack in ways of your own, add rules that
    call `feed`.
    """

    shrink_seconds = SHRINK_SECONDS
    """s for which its `TestCase` looks for a shorter run that leads to the same violation."""
    bindings = JoyBindings()
    """Buttons of the gamepad."""

    @classmethod
    @cache  # settings are kept on it
    def _to_test_case(cls) -> Any:
        """Return what `TestCase` is: Hypothesis's, which shrinks for no longer than it may."""
        whole: Any = super()._to_test_case()

        class Test(whole):  # type: ignore[misc]
            def runTest(self) -> None:  # noqa: N802 - unittest's name
                with shrinking_for(cls.shrink_seconds):
                    super().runTest()

        Test.__name__, Test.__qualname__ = whole.__name__, whole.__qualname__
        return Test

    # --- the ordinary operator ---

    @rule(wanted=st.none() | st.sampled_from(Intent))
    def press(self, wanted: Intent | None) -> None:
        """One intent, or a tick in which nothing is asked for."""
        self.tick(*([wanted] if wanted else []))

    @rule(buttons=button_readings(_BUTTONS))
    def play_the_gamepad(self, buttons: tuple[bool, ...]) -> None:
        """Buttons as they are held down now; DAMP must come through whatever else is pressed."""
        wanted = pressed_intents(self.bindings, buttons, self.buttons)
        damp = self.bindings.damp_button
        newly = buttons[damp] and not (self.buttons and self.buttons[damp])
        require(not newly or Intent.DAMP in wanted, "button {} is DAMP, and gave {}", damp, wanted)
        self.buttons = buttons
        self.tick(*wanted)

    @rule(pose=_POSES, impatient=st.none() | _STARTS)
    def walk_to_a_pose(self, pose: Intent, impatient: Intent | None) -> None:
        """DAMP, LOAD, and patience, which an operator may lack at first."""
        self._walk(pose, impatient)

    @rule(pose=_POSES, begin=_STARTS)
    def start_a_policy(self, pose: Intent, begin: Intent) -> None:
        """From a finished pose into LOCOMOTION or REMOTE."""
        self._begin(pose, begin)

    @rule(pose=_POSES, data=st.data(), steps=st.lists(st.tuples(_SMALL_JUMPS, st.none() | _SKEWS), max_size=25))
    def a_remote_session(self, pose: Intent, data: DataObject, steps: list[tuple[float, float | None]]) -> None:
        """Each step is a jump of the clock, and the skew of a new command's stamp or None for a silent sender."""
        if not self._begin(pose, Intent.START_REMOTE):
            return
        sent: list[MITCommand] = data.draw(st.lists(valid_commands(self.joint_count), min_size=1, max_size=3))
        for i, (jump, skew) in enumerate(steps):
            self.time += jump
            new = None if skew is None else RemoteCommand(sent[i % len(sent)], self.time + skew)
            self.feed(self._healthy(remote=new or self.remote))

    @rule(pose=_POSES, good=st.integers(0, 10), answer=_ANSWERS)
    def a_policy_session(self, pose: Intent, good: int, answer: str) -> None:
        """Begin with a policy that behaves for a while, and then as `answer` says."""
        if not self._begin(pose, Intent.START_LOCOMOTION):
            return
        for _ in range(good):
            mode = self.tick().control_mode
            require(mode.mode is Mode.LOCOMOTION, "a policy that behaves, on a healthy robot, ended in {}", mode)
        self.the_policy_misbehaves(answer, 3)

    @precondition(lambda self: self.memory.controller not in self._waited)
    @rule(ticks=_STRETCHES, sends=st.booleans())
    def time_passes(self, ticks: int, sends: bool) -> None:
        """Nobody asks for anything for hundreds of ticks: some mistakes need time."""
        self._waited.add(self.memory.controller)
        self.tick()  # which takes the consequences of what was odd
        if self._is_calm:
            self.pass_time(min(ticks, self.healthy_ticks), sends=sends)

    @rule(data=st.data())
    def move(self, data: DataObject) -> None:
        """Move the healthy robot."""
        self.time += self.period
        externs = healthy_externs(self.externs, self.time)
        self.feed(TickInput(data.draw(healthy_states(self.joint_count, self.time, externs)), remote=self.remote))

    # --- the attacks ---

    @precondition(lambda self: self.memory.controller == RL)
    @rule(answer=_ANSWERS, ticks=st.integers(1, 3))
    def the_policy_misbehaves(self, answer: str, ticks: int) -> None:
        """Let the policy answer what it must not."""
        for _ in range(ticks):
            self.time += self.period
            self.feed(self._healthy(remote=self.remote), answer)

    @rule(ticks=st.integers(1, 60), wanted=st.none() | _POSES, speed=st.sampled_from([0.0, 0.0, 40.0, -200.0]))
    def the_joints_are_blocked(self, ticks: int, wanted: Intent | None, speed: float) -> None:
        """Nothing moves, whatever is commanded; or the joints race, whatever is commanded."""
        self._is_blocked = True
        for i in range(ticks):
            self.time += self.period
            given = self._healthy(*[wanted] if wanted and i == 0 else (), remote=self.remote)
            velocity = np.full(self.joint_count, speed)
            self.feed(replace(given, state=replace(given.state, joint_velocity=velocity)))
        self._is_blocked = False

    @rule(data=st.data())
    def the_state_is_odd(self, data: DataObject) -> None:
        """Joints that were never heard, NaN, impossible quaternions."""
        self.time += self.period
        state = data.draw(any_states(self.joint_count, self.time, self.extern_names))
        self.feed(TickInput(state, remote=self.remote))

    @rule(data=st.data())
    def a_remote_command_is_odd(self, data: DataObject) -> None:
        """Negative gains, NaN, a wrong width, a stamp from anywhere."""
        self.time += self.period
        self.feed(self._healthy(remote=data.draw(any_remote_commands(self.joint_count, self.time))))

    @rule(jump=clock_jumps())
    def the_clock_jumps(self, jump: float) -> None:
        """Backwards, ahead, to no number at all."""
        before, self.time = self.time, self.time + jump
        self.feed(self._healthy(remote=self.remote))
        if not np.isfinite(self.time) or abs(self.time) > _FURTHEST_TIME:
            self.time = before

    @rule(safety=safety_statuses(), wanted=intents())
    def safety_speaks(self, safety: tuple[SafetyStatus, ...], wanted: tuple[Intent, ...]) -> None:
        """Any status of any source, together with any intents."""
        self.time += self.period
        given = replace(self._healthy(*wanted, remote=self.remote), safety=safety)
        self.feed(given)

    @rule(data=st.data())
    def live_values_are_odd(self, data: DataObject) -> None:
        """Missing, late, of another width."""
        self.time += self.period
        extern = data.draw(any_externs(self.extern_names))
        state = data.draw(healthy_states(self.joint_count, self.time, extern))
        self.feed(TickInput(state, remote=self.remote))

    @rule(data=st.data(), answer=_ANSWERS, jump=clock_jumps())
    def everything_at_once(self, data: DataObject, answer: str, jump: float) -> None:
        """Whatever a tick may hold, and a policy that may misbehave."""
        self.feed(data.draw(any_tick_inputs(self.joint_count, self.time + jump, self.extern_names)), answer)

    @rule(data=st.data(), change=st.sampled_from([-1, 1, 3]))
    def the_state_has_another_width(self, data: DataObject, change: int) -> None:
        """More joints than there are, or fewer."""
        self.time += self.period
        state = data.draw(healthy_states(max(self.joint_count + change, 0), self.time))
        self.feed(TickInput(state, intents=data.draw(intents())))
