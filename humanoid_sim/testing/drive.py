"""A control stack that is driven tick by tick: each is checked, run twice, and the whole run repeated at its end."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from hypothesis.stateful import RuleBasedStateMachine

from humanoid_sim.controllers.guards import Guards
from humanoid_sim.controllers.parameters import command_problem
from humanoid_sim.controllers.policy_step import ACTION_LIMIT
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import Intent, Mode, RemoteCommand, TickInput, TickOutput
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.testing.checks import fingerprint, require
from humanoid_sim.testing.healthy import ObedientJoints, healthy_state, healthy_tick
from humanoid_sim.testing.policies import Answer, ScriptedPolicy, misbehaviours, well_behaved
from humanoid_sim.testing.properties import REMOTE, RL, STANDBY_A, STANDBY_B, SafetyProperties
from humanoid_sim.testing.strategies import EXTERN_NAMES

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


class StackDriver(RuleBasedStateMachine):
    """Driver of a control stack through its modes on a healthy robot, for rules to build on; it has none itself."""

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
        self.extern_names = tuple(dict.fromkeys((*self.externs, *EXTERN_NAMES)))
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

        The mode stays, and no controller fails.

        Args:
            sends: a valid remote command arrives in each of them; else the last one grows old.
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
