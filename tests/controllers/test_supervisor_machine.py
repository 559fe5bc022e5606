"""The supervisor against anything: Hypothesis drives it with hostile inputs and checks every tick."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule, run_state_machine_as_test
from rig import BAD_ANSWERS, KNOWN, PERIOD, ScriptedPolicy, fingerprint, good_answer, supervisor, tick
from safety_properties import SafetyProperties
from strategies import (
    any_externs,
    any_remote_commands,
    any_states,
    any_tick_inputs,
    clock_jumps,
    healthy_states,
    intents,
    safety_statuses,
    valid_commands,
)

from humanoid_sim.messages import Intent, RemoteCommand, TickInput

pytestmark = pytest.mark.timeout(1800)  # shrinking a failure to its few steps takes up to five minutes

ANSWERS = {"good": good_answer, **BAD_ANSWERS}
SMALL_JUMPS = st.sampled_from([PERIOD, PERIOD, PERIOD, 0.0, 0.05, 0.11, -PERIOD, -5.0])
SKEWS = st.sampled_from([0.0, 0.0, -0.01, -0.06, -0.2, 0.01, 3.0, -100.0])
"""s, arrival time less the time of the tick that first shows the command."""


class SupervisorMachine(RuleBasedStateMachine):
    """One run. Healthy rules take it deep, hostile rules attack it there; both look at every tick."""

    @initialize()
    def start(self):
        self.policy = ScriptedPolicy(good_answer)
        self.stack = supervisor(self.policy)
        self.memory = self.stack.initial()
        self.properties = SafetyProperties()
        self.time = 10.0
        self.remote = None
        self.history = []

    def feed(self, given: TickInput, answer: str = "good"):
        self.policy.answer = ANSWERS[answer]
        before = fingerprint(given), fingerprint(self.memory)
        memory, output = self.stack.step(self.memory, given)
        again, same = self.stack.step(self.memory, given)
        assert before == (fingerprint(given), fingerprint(self.memory)), "an input was written"
        assert fingerprint(output) == fingerprint(same), "the same inputs gave another output"
        assert fingerprint(memory) == fingerprint(again)
        self.properties.check(given, output)
        self.history.append((given, answer, fingerprint(output)))
        self.memory = memory
        self.remote = given.remote or self.remote
        return output

    def tick(self, *wanted: Intent, remote: RemoteCommand | None = None):
        self.time += PERIOD
        return self.feed(tick(self.time, *wanted, position=KNOWN, remote=remote or self.remote))

    # --- the ordinary operator ---

    @rule(wanted=st.none() | st.sampled_from(Intent))
    def press(self, wanted):
        self.tick(*([wanted] if wanted else []))

    @rule(
        pose=st.sampled_from([Intent.LOAD_A, Intent.LOAD_B]),
        impatient=st.none() | st.sampled_from([Intent.START_LOCOMOTION, Intent.START_REMOTE]),
    )
    def walk_to_a_pose(self, pose, impatient=None):
        self.tick(Intent.DAMP)
        self.tick(pose)
        self.tick(*([impatient] if impatient else []))
        for _ in range(3):
            output = self.tick()
        assert output.standby is not None
        assert output.standby.is_finished

    @rule(
        pose=st.sampled_from([Intent.LOAD_A, Intent.LOAD_B]),
        begin=st.sampled_from([Intent.START_LOCOMOTION, Intent.START_REMOTE]),
    )
    def start_a_policy(self, pose, begin):
        self.walk_to_a_pose(pose)
        assert self.tick(begin).control_mode.mode.name in ("LOCOMOTION", "REMOTE")

    @rule(
        pose=st.sampled_from([Intent.LOAD_A, Intent.LOAD_B]),
        sent=st.lists(valid_commands(3), min_size=1, max_size=3),
        steps=st.lists(st.tuples(SMALL_JUMPS, st.none() | SKEWS), max_size=25),
    )
    def a_remote_session(self, pose, sent, steps):
        """Each step is a jump of the clock, and the skew of a new command's stamp or None for a silent sender."""
        self.start_a_policy(pose, Intent.START_REMOTE)
        for i, (jump, skew) in enumerate(steps):
            self.time += jump
            new = None if skew is None else RemoteCommand(sent[i % len(sent)], self.time + skew)
            self.feed(tick(self.time, position=KNOWN, remote=new or self.remote))

    @rule(
        pose=st.sampled_from([Intent.LOAD_A, Intent.LOAD_B]),
        good=st.integers(0, 10),
        answer=st.sampled_from(sorted(ANSWERS)),
    )
    def a_policy_session(self, pose, good, answer):
        self.start_a_policy(pose, Intent.START_LOCOMOTION)
        for _ in range(good):
            assert self.tick().control_mode.mode.name == "LOCOMOTION"
        for _ in range(3):
            self.the_policy_misbehaves(answer, 1)

    @rule(data=st.data())
    def move(self, data):
        self.time += PERIOD
        self.feed(TickInput(data.draw(healthy_states(3, self.time)), remote=self.remote))

    # --- the attacks ---

    @precondition(lambda self: self.memory.controller == "rl_policy_controller")
    @rule(answer=st.sampled_from(sorted(ANSWERS)), ticks=st.integers(1, 3))
    def the_policy_misbehaves(self, answer, ticks):
        for _ in range(ticks):
            self.time += PERIOD
            self.feed(tick(self.time, remote=self.remote), answer)

    @rule(data=st.data())
    def the_state_is_odd(self, data):
        self.time += PERIOD
        self.feed(TickInput(data.draw(any_states(3, self.time)), remote=self.remote))

    @rule(data=st.data())
    def a_remote_command_is_odd(self, data):
        self.time += PERIOD
        self.feed(tick(self.time, remote=data.draw(any_remote_commands(3, self.time))))

    @rule(jump=clock_jumps())
    def the_clock_jumps(self, jump):
        time = self.time + jump
        self.feed(tick(time, remote=self.remote))
        if np.isfinite(time) and abs(time) < 1e9:
            self.time = time

    @rule(safety=safety_statuses(), wanted=intents())
    def safety_speaks(self, safety, wanted):
        self.time += PERIOD
        self.feed(tick(self.time, *wanted, safety=safety, remote=self.remote))

    @rule(extern=any_externs())
    def live_values_are_odd(self, extern):
        self.time += PERIOD
        self.feed(tick(self.time, extern=extern, remote=self.remote))

    @rule(data=st.data(), answer=st.sampled_from(sorted(ANSWERS)), jump=clock_jumps())
    def everything_at_once(self, data, answer, jump):
        self.feed(data.draw(any_tick_inputs(3, self.time + jump)), answer)

    @rule(data=st.data(), n=st.sampled_from([1, 2, 4]))
    def the_state_has_another_width(self, data, n):
        self.time += PERIOD
        self.feed(TickInput(data.draw(healthy_states(n, self.time)), intents=data.draw(intents())))

    def teardown(self):
        """A whole run repeated from its inputs is the same, byte for byte."""
        if not hasattr(self, "history"):
            return
        policy = ScriptedPolicy(good_answer)
        stack = supervisor(policy)
        memory = stack.initial()
        for given, answer, expected in self.history:
            policy.answer = ANSWERS[answer]
            memory, output = stack.step(memory, given)
            assert fingerprint(output) == expected


NORMAL = settings(stateful_step_count=40, suppress_health_check=[HealthCheck.large_base_example, HealthCheck.too_slow])
"""Whole states and commands are drawn in one step; that is large, and meant."""


def test_the_supervisor_withstands_anything():
    run_state_machine_as_test(SupervisorMachine, settings=settings(NORMAL, max_examples=70))


@pytest.mark.slow
def test_the_supervisor_withstands_anything_for_longer():
    """New examples in every run; a failure prints how to repeat it."""
    long = settings(NORMAL, max_examples=700, derandomize=False)
    run_state_machine_as_test(SupervisorMachine, settings=long)
