"""A control stack against anything: Hypothesis drives it with hostile inputs, and every tick is checked."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule
from hypothesis.strategies import DataObject

from humanoid_sim.controllers.base import DAMPING, REMOTE_POLICY, RL_POLICY, STANDBY_A, STANDBY_B
from humanoid_sim.controllers.guards import Guards
from humanoid_sim.controllers.parameters import command_problem
from humanoid_sim.controllers.policy_step import ACTION_LIMIT
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import Intent, Mode, RemoteCommand, SafetyStatus, TickInput, TickOutput
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.testing import strategies
from humanoid_sim.testing.healthy import (
    Answer,
    ScriptedPolicy,
    healthy_externs,
    healthy_state,
    healthy_tick,
    misbehaviours,
    well_behaved,
)
from humanoid_sim.testing.properties import SafetyProperties, fingerprint, require

_POSES = st.sampled_from([Intent.LOAD_A, Intent.LOAD_B])
_STARTS = st.sampled_from([Intent.START_LOCOMOTION, Intent.START_REMOTE])
_ANSWERS = st.sampled_from(["well behaved", *sorted(misbehaviours(1))])
_SMALL_JUMPS = st.sampled_from([0.02, 0.02, 0.02, 0.0, 0.05, 0.11, -0.02, -5.0])  # s between ticks of a remote session
_SKEWS = st.sampled_from([0.0, 0.0, -0.01, -0.06, -0.2, 0.01, 3.0, -100.0])  # s, a command's stamp less its tick's time
PERIOD = 0.02  # s of the robot's clock from one tick to the next
_WAITING_PERIOD = 0.05  # s likewise while a pose is waited for: as much as `StandbyController` advances in one tick
_LONGEST_STANDBY = 20.0  # s within which a healthy robot must have reached its pose
_FURTHEST_TIME = 1e9  # s: a clock beyond it has no room for hundredths of a second
TARGETS = {
    Intent.DAMP: DAMPING,
    Intent.LOAD_A: STANDBY_A,
    Intent.LOAD_B: STANDBY_B,
    Intent.START_LOCOMOTION: RL_POLICY,
    Intent.START_REMOTE: REMOTE_POLICY,
}


class StackMachine(RuleBasedStateMachine):
    """One run of a control stack. Healthy rules take it deep, hostile rules attack it there; every tick is checked.

    Each tick is run twice, and the whole run is repeated at its end. Subclass it and give `build`; `TestCase` of the
    subclass is what pytest collects. Extend `check` to check more, and add rules that call `feed` to attack more.
    """

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
        learned = self.stack.controllers.get(RL_POLICY)
        count, limit, self.externs = 1, ACTION_LIMIT, dict[str, int]()
        if isinstance(learned, RLPolicyController):
            count, limit, self.externs = learned.contract.action_count, learned.wiring.limit, dict(learned.extern)
        self.answers: dict[str, Answer] = {"well behaved": well_behaved(count), **misbehaviours(count, limit)}
        self.guards: Guards | None = self.stack.guards
        self.joints: FloatArray = np.full(self.joint_count, 0.5)
        """Shape (n,), rad, of the healthy robot: its joints are where the tick before commanded them to be."""
        self.memory = self.stack.initial()
        self.properties = SafetyProperties(self.stack)
        self.time = 10.0
        self.remote: RemoteCommand | None = None
        self.history: list[tuple[TickInput, str, object]] = []
        """Input, the policy's answer and the output's fingerprint of each tick."""
        self._is_calm = self._is_blocked = False
        self._waited: set[str] = set()

    def feed(self, given: TickInput, answer: str = "well behaved", *, twice: bool = True) -> TickOutput:
        """One tick, run twice but in long stretches: the same bits must come out, and nothing that went in may change.

        The policy behaves in it as `answer` says: `well behaved`, or one of `misbehaviours`.
        """
        self.policy.answer = self.answers[answer]
        self._is_calm = False
        before = (fingerprint(given), fingerprint(self.memory)) if twice else None
        memory, output = self.stack.step(self.memory, given)
        seen = fingerprint(output)
        if twice:
            again, same = self.stack.step(self.memory, given)
            require(before == (fingerprint(given), fingerprint(self.memory)), "a tick changed what it was given")
            require(seen == fingerprint(same), "the same inputs gave {} and {}", output, same)
            require(fingerprint(memory) == fingerprint(again), "the same inputs gave memories {} and {}", memory, again)
        self.check(given, output)
        self.history.append((given, answer, seen))
        self.memory = memory
        self.remote = given.remote or self.remote
        if not self._is_blocked:
            self.joints = self._obeyed(output.command)
        return output

    def _obeyed(self, command: MITCommand) -> FloatArray:
        """Return where joints go, within their limits; one without stiffness stays."""
        position = command.position
        if self.guards is not None:
            position = np.clip(position, self.guards.lower, self.guards.upper)
        return np.where(command.stiffness > 0.0, position, self.joints)

    def tick(self, *wanted: Intent, remote: RemoteCommand | None = None, twice: bool = True) -> TickOutput:
        """One period later, on the healthy robot. If the tick before was such a one, too, no controller may fail."""
        was_calm = self._is_calm
        self.time += PERIOD
        output = self.feed(self._healthy(*wanted, remote=remote or self.remote), twice=twice)
        require(not (was_calm and output.faults), "on a healthy robot: {}", output.faults)
        self._is_calm = not output.faults and self._can_obey(self.remote)
        return output

    def _healthy(self, *wanted: Intent, remote: RemoteCommand | None) -> TickInput:
        return healthy_tick(self.joints, self.time, *wanted, remote=remote, externs=self.externs)

    def _can_obey(self, remote: RemoteCommand | None) -> bool:
        """Return whether a healthy robot can do what a remote command asks, without pressing against its stops."""
        if remote is None or command_problem(remote.command, self.stack.joints):
            return remote is None
        reached = healthy_state(self._obeyed(remote.command))
        return self.guards is None or self.guards.watch(None, reached, remote.command) is None

    def pass_time(self, ticks: int, *, sends: bool = True) -> None:
        """Healthy ticks in which nobody asks for anything: the mode stays, and no controller fails.

        A valid remote command arrives in each, or the last one grows old.
        """
        name = self.memory.controller
        self.remote = RemoteCommand(MITCommand.zeros(self.joint_count), self.time) if sends else self.remote
        if not self._can_obey(self.remote):
            return
        for i in range(1, ticks + 1):
            new = RemoteCommand(self.remote.command, self.time + PERIOD) if sends and self.remote else None
            try:
                output = self.tick(remote=new, twice=i == ticks)
                require(not output.faults, "{}", output.faults)
                now = output.control_mode.controller_name
                require(now == name, "{} went to {} by itself", name, now)
            except AssertionError as error:
                error.add_note(f"in tick {i} of a healthy stretch in {name}")
                raise

    def go(self, pose: Intent, begin: Intent | None = None) -> bool:
        """To a finished pose, and from there into LOCOMOTION or REMOTE; False if there are no such controllers.

        Whatever is to begin is requested too early as well.
        """
        self.tick(Intent.DAMP)
        output = self.tick(pose)
        if not self._exists(pose, output):
            return False
        began = self.time
        if begin is not None:
            output = self.tick(begin)
        while output.standby is None or not output.standby.is_finished:
            mode, waited = output.control_mode, self.time - began
            require(mode.mode is Mode.STANDBY, "{} on a healthy robot ended in {}", pose, mode)
            require(waited <= _LONGEST_STANDBY, "{} has not finished after {:g} s", mode.controller_name, waited)
            self.time += _WAITING_PERIOD - PERIOD
            output = self.tick()
        if begin is not None:
            output = self.tick(begin)
            if not self._exists(begin, output):
                return False
            name = output.control_mode.controller_name
            require(name == TARGETS[begin], "{} on a healthy robot ended in {}", begin, output.control_mode)
        return True

    def _exists(self, intent: Intent, output: TickOutput) -> bool:
        exists = TARGETS[intent] in self.stack.controllers
        require(exists or bool(output.refusals), "{} has no controller, and was not refused", intent)
        return exists

    def teardown(self) -> None:
        """Check that a whole run repeated from its inputs on a new stack is the same, bit for bit."""
        if isinstance(sys.exception(), AssertionError):
            return  # the run has broken a property already
        policy = ScriptedPolicy(well_behaved(1))
        stack = self.build(policy)
        memory = stack.initial()
        for i, (given, answer, expected) in enumerate(self.history):
            policy.answer = self.answers[answer]
            memory, output = stack.step(memory, given)
            require(fingerprint(output) == expected, "tick {} of the repeated run gave {}", i, output)

    # --- the ordinary operator ---

    @rule(wanted=strategies.intents())
    def press(self, wanted: tuple[Intent, ...]) -> None:
        """Ask the healthy robot for something, or for nothing."""
        self.tick(*wanted)

    @rule(pose=_POSES, begin=st.none() | _STARTS)
    def start(self, pose: Intent, begin: Intent | None) -> None:
        """To a pose, and on into LOCOMOTION or REMOTE."""
        self.go(pose, begin)

    @rule(data=st.data(), wanted=strategies.intents())
    def select(self, data: DataObject, wanted: tuple[Intent, ...]) -> None:
        """Select a policy, or one that is not loaded, in whatever mode it is."""
        self.time += PERIOD
        name = data.draw(st.sampled_from([*self.stack.policies, "unheard_of"]))
        self.feed(replace(self._healthy(*wanted, remote=self.remote), policy=name))

    @precondition(lambda self: self.memory.controller == REMOTE_POLICY)
    @rule(data=st.data(), steps=st.lists(st.tuples(_SMALL_JUMPS, st.none() | _SKEWS), min_size=1, max_size=25))
    def commands_arrive(self, data: DataObject, steps: list[tuple[float, float | None]]) -> None:
        """Each step is a jump of the clock, and the skew of a new command's stamp or None for a silent sender."""
        sent = data.draw(st.lists(strategies.valid_commands(self.joint_count), min_size=1, max_size=3))
        for i, (jump, skew) in enumerate(steps):
            self.time += jump
            new = None if skew is None else RemoteCommand(sent[i % len(sent)], self.time + skew)
            self.feed(self._healthy(remote=new or self.remote))

    @precondition(lambda self: self.memory.controller not in self._waited)
    @rule(ticks=st.sampled_from([100, 300, 1000]), sends=st.booleans())
    def time_passes(self, ticks: int, sends: bool) -> None:
        """Nobody asks for anything for hundreds of ticks: some mistakes need time."""
        self._waited.add(self.memory.controller)
        self.tick()  # which takes the consequences of what was odd
        if self._is_calm:
            self.pass_time(ticks, sends=sends)

    # --- the attacks ---

    @precondition(lambda self: self.memory.controller == RL_POLICY)
    @rule(answer=_ANSWERS, ticks=st.integers(1, 3))
    def the_policy_misbehaves(self, answer: str, ticks: int) -> None:
        """Let the policy answer what it must not."""
        for _ in range(ticks):
            self.time += PERIOD
            self.feed(self._healthy(remote=self.remote), answer)

    @rule(ticks=st.integers(1, 60), wanted=st.none() | _POSES, speed=st.sampled_from([0.0, 0.0, 40.0, -200.0]))
    def the_joints_are_blocked(self, ticks: int, wanted: Intent | None, speed: float) -> None:
        """Nothing moves, whatever is commanded; or the joints race, whatever is commanded."""
        self._is_blocked = True
        for i in range(ticks):
            self.time += PERIOD
            given = self._healthy(*[wanted] if wanted and i == 0 else (), remote=self.remote)
            velocity = np.full(self.joint_count, speed)
            self.feed(replace(given, state=replace(given.state, joint_velocity=velocity)))
        self._is_blocked = False

    @rule(data=st.data(), wanted=strategies.intents())
    def the_state_is_odd(self, data: DataObject, wanted: tuple[Intent, ...]) -> None:
        """Joints that are elsewhere, or were never heard; NaN; live inputs that are missing or late; other widths."""
        self.time += PERIOD
        n = self.joint_count
        kinds = [
            strategies.healthy_states(n, self.time, healthy_externs(self.externs, self.time)),
            strategies.healthy_states(n, self.time, data.draw(strategies.any_externs())),
            strategies.any_states(n, self.time),
            strategies.healthy_states(n + data.draw(st.sampled_from([1 - n, -1, 1, 3])), self.time),
        ]
        state = data.draw(data.draw(st.sampled_from(kinds)))
        self.feed(TickInput(state, intents=wanted, remote=self.remote))

    @rule(data=st.data())
    def a_remote_command_is_odd(self, data: DataObject) -> None:
        """Negative gains, NaN, a wrong width, a stamp from anywhere."""
        self.time += PERIOD
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
        self.time += PERIOD
        self.feed(replace(self._healthy(*wanted, remote=self.remote), safety=safety))

    @rule(data=st.data(), answer=_ANSWERS, jump=strategies.clock_jumps())
    def everything_at_once(self, data: DataObject, answer: str, jump: float) -> None:
        """Whatever a tick may hold, and a policy that may misbehave."""
        self.feed(data.draw(strategies.any_tick_inputs(self.joint_count, self.time + jump)), answer)
