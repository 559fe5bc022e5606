"""A control stack against anything: Hypothesis drives it with hostile inputs, and every tick is checked."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.internal.conjecture import engine
from hypothesis.reporting import current_reporter, with_reporter
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule
from hypothesis.strategies import DataObject

from humanoid_sim.controllers.guards import Guards
from humanoid_sim.controllers.joy import JoyBindings, pressed_intents
from humanoid_sim.controllers.parameters import command_problem
from humanoid_sim.controllers.policy_step import ACTION_LIMIT
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import Intent, Mode, RemoteCommand, SafetyStatus, TickInput, TickOutput
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.testing import strategies
from humanoid_sim.testing.healthy import ObedientJoints, healthy_externs, healthy_state, healthy_tick
from humanoid_sim.testing.policies import Answer, ScriptedPolicy, misbehaviours, well_behaved
from humanoid_sim.testing.properties import REMOTE, RL, STANDBY_A, STANDBY_B, SafetyProperties, fingerprint, require

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


_TARGETS = {
    Intent.LOAD_A: STANDBY_A,
    Intent.LOAD_B: STANDBY_B,
    Intent.START_LOCOMOTION: RL,
    Intent.START_REMOTE: REMOTE,
}


@dataclass(frozen=True)
class _Stretch:
    """Healthy ticks, one after the other, in which nobody asks for anything."""

    began: float
    """s, the tick before the first."""
    ticks: int
    remote: RemoteCommand | None
    """The latest one."""
    sends: bool
    """Its sender goes on sending it."""
    position: FloatArray
    """Shape (n,), rad, of the joints before the first."""


class StackMachine(RuleBasedStateMachine):
    """One run of a control stack. Healthy rules take it deep, hostile rules attack it there; every tick is checked.

    Each tick is run twice, and the whole run is repeated at its end.

    Subclass it and give `build`; the subclass's `TestCase` is what pytest and unittest collect. To check more than
    `SafetyProperties`, extend `check` or give another `properties_type`. To attack in ways of your own, add rules that
    call `feed`.
    """

    period = 0.02
    """s of the robot's clock from one tick to the next."""
    waiting_period = 0.05
    """s likewise while a pose is waited for: as much as `StandbyController` goes on by in one tick."""
    position: tuple[float, ...] = ()
    """rad, where the joints of the healthy robot are at first; empty: 0.5 for all. They go where they are told."""
    longest_standby = 20.0
    """s within which a standby pose must have been reached on a healthy robot."""
    healthy_ticks = 1000
    """The longest stretch of healthy ticks in one mode; each mode has one in a run."""
    properties_type: type[SafetyProperties] = SafetyProperties
    """Class of what watches the run."""
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

    def build(self, policy: ScriptedPolicy) -> Supervisor:
        """Make the stack under test, for every run. Whatever runs `policy` in LOCOMOTION is fuzzed with bad answers."""
        raise NotImplementedError(f"{type(self).__name__}.build is not defined: it must return the stack under test")

    def check(self, given: TickInput, output: TickOutput) -> None:
        """Check what must hold in every tick; raise to report a violation."""
        self.properties.check(given, output)

    def __init__(self) -> None:
        super().__init__()
        self.policy = ScriptedPolicy(well_behaved(1))
        self.stack = self.build(self.policy)
        self.joint_count = len(self.stack.joints)
        learned = self.stack.controllers.get(RL)
        count, limit, self.externs = 1, ACTION_LIMIT, dict[str, int]()
        if isinstance(learned, RLPolicyController):
            count, limit, self.externs = learned.contract.action_count, learned.wiring.limit, dict(learned.extern)
        self.answers: dict[str, Answer] = {"well behaved": well_behaved(count), **misbehaviours(count, limit)}
        self.extern_names = tuple(dict.fromkeys((*self.externs, *strategies.EXTERN_NAMES)))
        self.guards: Guards | None = getattr(self.stack, "guards", None)
        self.robot = self._new_robot()
        self.memory = self.stack.initial()
        self.remembered = fingerprint(self.memory)
        self.properties = self.properties_type(self.stack)
        self.time = 10.0
        self.remote: RemoteCommand | None = None
        self.buttons: tuple[bool, ...] = ()
        self.history: list[tuple[TickInput | _Stretch, str, object]] = []
        self._is_calm = self._is_blocked = False
        self._waited: set[str] = set()

    def _new_robot(self) -> ObedientJoints:
        start = np.array(self.position or (0.5,) * self.joint_count)
        if self.guards is None:
            return ObedientJoints(start)
        return ObedientJoints(start, self.guards.lower, self.guards.upper)

    def feed(self, given: TickInput, answer: str = "well behaved") -> TickOutput:
        """One tick, run twice: the same bits must come out, and nothing that went in may change.

        Args:
            answer: how the policy behaves if it is asked: `well behaved`, or one of `misbehaviours`.
        """
        self.policy.answer = self.answers[answer]
        self._is_calm = False
        before = fingerprint(given), self.remembered
        memory, output = self.stack.step(self.memory, given)
        again, same = self.stack.step(self.memory, given)
        require(before == (fingerprint(given), fingerprint(self.memory)), "a tick changed what it was given")
        seen, self.remembered = fingerprint(output), fingerprint(memory)
        require(seen == fingerprint(same), "the same inputs gave {} and {}", output, same)
        require(self.remembered == fingerprint(again), "the same inputs gave memories {} and {}", memory, again)
        self.check(given, output)
        self.history.append((given, answer, seen))
        self.memory = memory
        self.remote = given.remote or self.remote
        if not self._is_blocked:
            self.robot.obey(output.command)
        return output

    def tick(self, *wanted: Intent, remote: RemoteCommand | None = None) -> TickOutput:
        """One period later, on the healthy robot; the last remote command stays the latest.

        If the tick before was such a one, too, no controller may fail.
        """
        was_calm = self._is_calm
        self.time += self.period
        output = self.feed(self._healthy(*wanted, remote=remote or self.remote))
        require(not (was_calm and output.faults), "on a healthy robot: {}", output.faults)
        self._is_calm = not output.faults and self._is_valid(self.remote)
        return output

    def _is_valid(self, remote: RemoteCommand | None) -> bool:
        """Return whether a healthy robot can do what a remote command asks, without pressing against its stops."""
        if remote is None or command_problem(remote.command, self.stack.joints):
            return remote is None
        if self.guards is None:
            return True
        robot = self._new_robot()
        robot.obey(remote.command)
        return self.guards.watch(None, healthy_state(robot.position), remote.command) is None

    def pass_time(self, ticks: int, *, sends: bool = True) -> None:
        """Healthy ticks in the present mode, checked one by one, the last one also run twice.

        The mode stays, and no controller fails. A valid remote command arrives in each, or the last one grows old.
        """
        if sends:
            self.remote = RemoteCommand(MITCommand.zeros(self.joint_count), self.time)
        if not self._is_valid(self.remote):
            return
        stretch = _Stretch(self.time, ticks - 1, self.remote, sends, self.robot.position)
        self.policy.answer = self.answers["well behaved"]
        name = self.memory.controller
        output: TickOutput | None = None
        for i, given in enumerate(self._inputs(stretch, self.robot), 1):
            self.memory, output = self.stack.step(self.memory, given)
            self.time, self.remote = float(given.state.time), given.remote
            self.robot.obey(output.command)
            try:
                self.check(given, output)
            except AssertionError as error:
                error.args = (f"{error} (tick {i} of a healthy stretch in {name})",)
                raise
            require(not output.faults, "on a healthy robot, after {} ticks in {}: {}", i, name, output.faults)
            now = output.control_mode.controller_name
            require(now == name, "on a healthy robot, after {} ticks {} went to {} by itself", i, name, now)
        self.remembered = fingerprint(self.memory)
        self.history.append((stretch, "well behaved", fingerprint(output)))
        self._is_calm = True
        self.tick(remote=self.remote)

    def _inputs(self, stretch: _Stretch, robot: ObedientJoints) -> Iterator[TickInput]:
        time, remote = stretch.began, stretch.remote
        for _ in range(stretch.ticks):
            time += self.period
            if stretch.sends and remote is not None:
                remote = RemoteCommand(remote.command, time)
            yield healthy_tick(robot.position, time, remote=remote, externs=self.externs)

    def _healthy(self, *wanted: Intent, remote: RemoteCommand | None) -> TickInput:
        return healthy_tick(self.robot.position, self.time, *wanted, remote=remote, externs=self.externs)

    def go(self, pose: Intent, begin: Intent | None = None) -> bool:
        """To a finished pose, and from there into LOCOMOTION or REMOTE; whether there are such controllers."""
        return self._walk(pose) if begin is None else self._begin(pose, begin)

    def _walk(self, pose: Intent, impatient: Intent | None = None) -> bool:
        """Return whether there is such a pose; then it was reached."""
        self.tick(Intent.DAMP)
        output = self.tick(pose)
        if _TARGETS[pose] not in self.stack.controllers:
            require(bool(output.refusals), "{} has no controller, and was not refused", pose)
            return False
        began = self.time
        if impatient:
            output = self.tick(impatient)
        while output.standby is None or not output.standby.is_finished:
            mode, waited = output.control_mode, self.time - began
            require(mode.mode is Mode.STANDBY, "{} on a healthy robot ended in {}", pose, mode)
            require(waited <= self.longest_standby, "{} has not finished after {:g} s", mode.controller_name, waited)
            self.time += self.waiting_period - self.period
            output = self.tick()
        return True

    def _begin(self, pose: Intent, begin: Intent) -> bool:
        """Return whether there is such a controller; then it is in control."""
        if not self._walk(pose):
            return False
        output = self.tick(begin)
        if _TARGETS[begin] not in self.stack.controllers:
            require(bool(output.refusals), "{} has no controller, and was not refused", begin)
            return False
        name = output.control_mode.controller_name
        require(name == _TARGETS[begin], "{} on a healthy robot ended in {}", begin, output.control_mode)
        return True

    def broken(self, error: AssertionError) -> None:
        """Note that a run breaks a property, before Hypothesis looks for a shorter one that does."""

    def teardown(self) -> None:
        """Check that a whole run repeated from its inputs on a new stack is the same, bit for bit."""
        error = sys.exception()
        if isinstance(error, AssertionError):
            self.broken(error)
            return
        try:
            self._repeat()
        except AssertionError as violation:
            self.broken(violation)
            raise

    def _repeat(self) -> None:
        policy = ScriptedPolicy(well_behaved(1))
        stack = self.build(policy)
        memory = stack.initial()
        for i, (given, answer, expected) in enumerate(self.history):
            policy.answer = self.answers[answer]
            output = None
            robot = self._new_robot()
            if not isinstance(given, TickInput):
                robot.position = given.position
            for one in [given] if isinstance(given, TickInput) else self._inputs(given, robot):
                memory, output = stack.step(memory, one)
                robot.obey(output.command)
            require(fingerprint(output) == expected, "step {} of the repeated run gave {}", i, output)

    # --- the ordinary operator ---

    @rule(wanted=st.none() | st.sampled_from(Intent))
    def press(self, wanted: Intent | None) -> None:
        """One intent, or a tick in which nothing is asked for."""
        self.tick(*([wanted] if wanted else []))

    @rule(buttons=strategies.button_readings(_BUTTONS))
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
        sent: list[MITCommand] = data.draw(
            st.lists(strategies.valid_commands(self.joint_count), min_size=1, max_size=3)
        )
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
        self.feed(
            TickInput(data.draw(strategies.healthy_states(self.joint_count, self.time, externs)), remote=self.remote)
        )

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
        state = data.draw(strategies.any_states(self.joint_count, self.time, self.extern_names))
        self.feed(TickInput(state, remote=self.remote))

    @rule(data=st.data())
    def a_remote_command_is_odd(self, data: DataObject) -> None:
        """Negative gains, NaN, a wrong width, a stamp from anywhere."""
        self.time += self.period
        self.feed(self._healthy(remote=data.draw(strategies.any_remote_commands(self.joint_count, self.time))))

    @rule(jump=strategies.clock_jumps())
    def the_clock_jumps(self, jump: float) -> None:
        """Backwards, ahead, to no number at all."""
        before, self.time = self.time, self.time + jump
        self.feed(self._healthy(remote=self.remote))
        if not np.isfinite(self.time) or abs(self.time) > _FURTHEST_TIME:
            self.time = before

    @rule(safety=strategies.safety_statuses(), wanted=strategies.intents())
    def safety_speaks(self, safety: tuple[SafetyStatus, ...], wanted: tuple[Intent, ...]) -> None:
        """Any status of any source, together with any intents."""
        self.time += self.period
        given = replace(self._healthy(*wanted, remote=self.remote), safety=safety)
        self.feed(given)

    @rule(data=st.data())
    def live_values_are_odd(self, data: DataObject) -> None:
        """Missing, late, of another width."""
        self.time += self.period
        extern = data.draw(strategies.any_externs(self.extern_names))
        state = data.draw(strategies.healthy_states(self.joint_count, self.time, extern))
        self.feed(TickInput(state, remote=self.remote))

    @rule(data=st.data(), answer=_ANSWERS, jump=strategies.clock_jumps())
    def everything_at_once(self, data: DataObject, answer: str, jump: float) -> None:
        """Whatever a tick may hold, and a policy that may misbehave."""
        self.feed(data.draw(strategies.any_tick_inputs(self.joint_count, self.time + jump, self.extern_names)), answer)

    @rule(data=st.data(), change=st.sampled_from([-1, 1, 3]))
    def the_state_has_another_width(self, data: DataObject, change: int) -> None:
        """More joints than there are, or fewer."""
        self.time += self.period
        state = data.draw(strategies.healthy_states(max(self.joint_count + change, 0), self.time))
        self.feed(TickInput(state, intents=data.draw(strategies.intents())))
