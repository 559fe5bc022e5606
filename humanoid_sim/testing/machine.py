"""A control stack against anything: Hypothesis drives it with hostile inputs, and every tick is checked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule
from hypothesis.strategies import DataObject

from humanoid_sim.controllers.base import REMOTE_POLICY, RL_POLICY
from humanoid_sim.controllers.rl_policy import RLPolicyController
from humanoid_sim.controllers.supervisor import Supervisor
from humanoid_sim.messages import Intent, Mode, RemoteCommand, SafetyStatus, TickInput, TickOutput
from humanoid_sim.mit import FloatArray, MITCommand
from humanoid_sim.testing import strategies
from humanoid_sim.testing.healthy import ScriptedPolicy, healthy_externs, healthy_state, misbehaviours, well_behaved
from humanoid_sim.testing.properties import EDGES, SafetyProperties, require, run_twice

PERIOD = 0.02  # s of the robot's clock from one tick to the next
_WAITING_PERIOD = 0.05  # s likewise while a pose is waited for: as much as `StandbyController` advances in one tick
_LONGEST_STANDBY = 20.0  # s within which a healthy robot must have reached its pose
_FURTHEST_TIME = 1e9  # s: a clock beyond it has no room for hundredths of a second
_POSES = st.sampled_from([Intent.LOAD_A, Intent.LOAD_B])
_STARTS = st.sampled_from([Intent.START_LOCOMOTION, Intent.START_REMOTE])
_ANSWERS = st.sampled_from(["well behaved", *sorted(misbehaviours(1))])
_SMALL_JUMPS = st.sampled_from([0.02, 0.02, 0.02, 0.0, 0.05, 0.11, -0.02, -5.0])  # s between ticks of a remote session
_SKEWS = st.sampled_from([0.0, 0.0, -0.01, -0.06, -0.2, 0.01, 3.0, -100.0])  # s, a command's stamp less its tick's time


class StackMachine(RuleBasedStateMachine):
    """One run of a control stack, checked in every tick. Subclass it with `build`; pytest collects its `TestCase`."""

    def build(self, policy: ScriptedPolicy) -> Supervisor:
        """Return a new stack under test, whose LOCOMOTION runs `policy`; its answers are fuzzed."""
        raise NotImplementedError

    def check(self, given: TickInput, output: TickOutput) -> None:
        self.properties.check(given, output)

    def __init__(self) -> None:
        super().__init__()
        self.policy = ScriptedPolicy(well_behaved(1))
        self.stack = self.build(self.policy)
        self.joint_count = len(self.stack.joints)
        learned = self.stack.controllers.get(RL_POLICY)
        count, limit, self.externs = 1, 100.0, dict[str, int]()
        if isinstance(learned, RLPolicyController):
            contract, self.externs = learned.contract, dict(learned.extern)
            count, limit = contract.action_count, contract.action_limit
        self.answers = {"well behaved": well_behaved(count), **misbehaviours(count, limit)}
        self.joints: FloatArray = np.full(self.joint_count, 0.5)  # rad: where the tick before commanded them to be
        self.memory = self.stack.initial()
        self.properties = SafetyProperties(self.stack)
        self.time = 10.0
        self.remote: RemoteCommand | None = None

    def feed(self, given: TickInput, answer: str = "well behaved", *, is_blocked: bool = False) -> TickOutput:
        """Run one tick twice and check it.

        `answer` is what the policy does: `well behaved`, or one of `misbehaviours`. Joints that are blocked stay where
        they are, whatever is commanded.
        """
        self.policy.answer = self.answers[answer]
        memory, output = run_twice(self.stack.step, self.memory, given)
        self.check(given, output)
        self.memory, self.remote = memory, given.remote or self.remote
        if not is_blocked:
            position, guards = output.command.position, self.stack.guards
            if guards is not None:
                position = np.clip(position, guards.lower, guards.upper)
            self.joints = np.where(output.command.stiffness > 0.0, position, self.joints)
        return output

    def healthy(self, *wanted: Intent, remote: RemoteCommand | None = None) -> TickInput:
        state = healthy_state(self.joints, self.time, self.externs)
        return TickInput(state, intents=wanted, remote=remote or self.remote)

    def tick(self, *wanted: Intent, remote: RemoteCommand | None = None) -> TickOutput:
        """Feed what the healthy robot gives one period later, with `remote` or the last remote command."""
        self.time += PERIOD
        return self.feed(self.healthy(*wanted, remote=remote))

    def pass_time(self, ticks: int, *, sends: bool = True) -> None:
        """Healthy ticks without an intent: the mode stays, and no controller fails.

        A remote command of zeros arrives in each, or in the first alone and then grows old.
        """
        for i in range(ticks + 1):  # the first one takes the consequences of what came before
            new = self._remote_command() if sends or i == 0 else None
            name, output = self.memory.controller, self.tick(remote=new)
            now = output.control_mode.controller_name
            require(i == 0 or not output.faults, "on a healthy robot, in tick {} in {}: {}", i, name, output.faults)
            require(i == 0 or now == name, "{} went to {} by itself, in tick {}", name, now, i)

    def _remote_command(self) -> RemoteCommand:
        """Return a command of zeros that arrives with the next tick."""
        return RemoteCommand(MITCommand.zeros(self.joint_count), self.time + PERIOD)

    def go(self, pose: Intent, begin: Intent | None = None) -> bool:
        """To a finished pose, and from there into LOCOMOTION or REMOTE; False if there are no such controllers.

        What is to begin is requested too early as well.
        """
        if any(EDGES[intent][1] not in self.stack.controllers for intent in (pose, begin) if intent):
            return False
        self.tick(Intent.DAMP)
        output, began = self.tick(pose), self.time
        if begin:
            output = self.tick(begin)
        while output.standby is None or not output.standby.is_finished:
            mode, waited = output.control_mode, self.time - began
            require(mode.mode is Mode.STANDBY, "{} on a healthy robot ended in {}", pose, mode)
            require(waited <= _LONGEST_STANDBY, "{} has not finished after {:g} s", mode.controller_name, waited)
            self.time += _WAITING_PERIOD - PERIOD
            output = self.tick()
        if begin:
            mode = self.tick(begin, remote=self._remote_command()).control_mode
            require(mode.controller_name == EDGES[begin][1], "{} on a healthy robot ended in {}", begin, mode)
        return True

    # --- the ordinary operator ---

    @rule(pose=_POSES, begin=st.none() | _STARTS)
    def start(self, pose: Intent, begin: Intent | None) -> None:
        self.go(pose, begin)

    @rule(data=st.data(), wanted=strategies.INTENTS)
    def press(self, data: DataObject, wanted: tuple[Intent, ...]) -> None:
        self.time += PERIOD
        name = data.draw(st.sampled_from(["", "", *self.stack.policies, "unheard_of"]))
        self.feed(replace(self.healthy(*wanted), policy=name))

    @precondition(lambda self: self.memory.controller == REMOTE_POLICY)
    @rule(data=st.data(), steps=st.lists(st.tuples(_SMALL_JUMPS, st.none() | _SKEWS), min_size=1, max_size=25))
    def commands_arrive(self, data: DataObject, steps: list[tuple[float, float | None]]) -> None:
        n = self.joint_count
        kinds = [strategies.valid_commands(n), strategies.any_commands(n), strategies.valid_commands(n + 1)]
        commands = st.sampled_from([kinds[0], *kinds]).flatmap(lambda kind: st.lists(kind, min_size=1, max_size=3))
        sent = data.draw(commands)
        for i, (jump, skew) in enumerate(steps):
            self.time += jump
            new = None if skew is None else RemoteCommand(sent[i % len(sent)], self.time + skew)
            self.feed(self.healthy(remote=new))

    # --- the attacks ---

    @precondition(lambda self: self.memory.controller == RL_POLICY)
    @rule(answer=_ANSWERS, ticks=st.integers(1, 3))
    def the_policy_misbehaves(self, answer: str, ticks: int) -> None:
        for _ in range(ticks):
            self.time += PERIOD
            self.feed(self.healthy(), answer)

    @rule(ticks=st.integers(1, 60), wanted=st.none() | _POSES, speed=st.sampled_from([0.0, 0.0, 40.0, -200.0]))
    def the_joints_are_blocked(self, ticks: int, wanted: Intent | None, speed: float) -> None:
        for i in range(ticks):
            self.time += PERIOD
            given = self.healthy(*[wanted] if wanted and i == 0 else ())
            state = replace(given.state, joint_velocity=np.full(self.joint_count, speed))
            self.feed(replace(given, state=state), is_blocked=True)

    @rule(data=st.data(), wanted=strategies.INTENTS)
    def the_state_is_odd(self, data: DataObject, wanted: tuple[Intent, ...]) -> None:
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

    @rule(jump=strategies.clock_jumps())
    def the_clock_jumps(self, jump: float) -> None:
        before, self.time = self.time, self.time + jump
        self.feed(self.healthy())
        if not abs(self.time) <= _FURTHEST_TIME:
            self.time = before

    @rule(safety=strategies.SAFETY_STATUSES, wanted=strategies.INTENTS)
    def safety_speaks(self, safety: tuple[SafetyStatus, ...], wanted: tuple[Intent, ...]) -> None:
        self.time += PERIOD
        self.feed(replace(self.healthy(*wanted), safety=safety))

    @rule(data=st.data(), answer=_ANSWERS, jump=strategies.clock_jumps())
    def everything_at_once(self, data: DataObject, answer: str, jump: float) -> None:
        self.feed(data.draw(strategies.any_tick_inputs(self.joint_count, self.time + jump)), answer)
