"""A stack with one planted defect for each safety property: `fuzz_stack` finds it; sound stacks pass."""

from dataclasses import replace

import numpy as np
import pytest
import rig
from hypothesis import Phase, settings

from humanoid_sim import testing
from humanoid_sim.messages import Intent, Mode, RemoteCommand
from humanoid_sim.mit import MITCommand
from humanoid_sim.testing.machine import PERIOD

SEARCH = settings(testing.DEFAULT_SETTINGS, max_examples=200, derandomize=True, database=None, phases=[Phase.generate])
SOUND = testing.robot_stack("lite")


class Stack:
    """A sound stack whose defect is in `after` or `before` a tick. Its children have one each."""

    def __init__(self, policy):
        self.sound = SOUND(policy)
        self.joints, self.controllers, self.guards = self.sound.joints, self.sound.controllers, self.sound.guards
        self.policies, self.calls = self.sound.policies, 0

    def initial(self):
        return self.sound.initial()

    def step(self, memory, given):
        self.calls += 1
        return self.after(given, *self.sound.step(memory, self.before(memory, given)))

    def before(self, memory, given):
        return given

    def after(self, given, memory, output):
        return memory, output


class CommandsNaNInTheEnd(Stack):
    def after(self, given, memory, output):
        if given.state.time > 45.0 and output.control_mode.mode is Mode.DAMPING:
            nan = np.full(len(self.joints), np.nan)
            output = replace(output, command=replace(output.command, position=nan))
        return memory, output


class PolicyTires(Stack):
    """In LOCOMOTION the joints are reported as unknown after a while, so that a sound policy's controller fails."""

    def before(self, memory, given):
        if memory.controller == "rl_policy_controller" and given.state.time > 45.0:
            unknown = np.full(len(given.state.joint_position), np.nan)
            return replace(given, state=replace(given.state, joint_position=unknown))
        return given


class IgnoresTheSecondSource(Stack):
    def before(self, memory, given):
        return replace(given, safety=given.safety[:1])


class RemembersOutsideItsMemory(Stack):
    def after(self, given, memory, output):
        return memory, replace(output, control_mode=replace(output.control_mode, status_message=f"tick {self.calls}"))


class ChangesTheRunningPolicy(Stack):
    """A selection is refused in LOCOMOTION, and holds from the next tick all the same."""

    def after(self, given, memory, output):
        if given.policy in self.policies and output.control_mode.mode is Mode.LOCOMOTION:
            memory = replace(memory, policy=given.policy)
        return memory, output


class SleepingGuards(Stack):
    """It has guards, and never asks them."""

    def __init__(self, policy):
        super().__init__(policy)
        self.sound = replace(self.sound, guards=None)


def pose_that_takes_for_ever(policy):
    slow = rig.standby([10.0] * 3, [1.0] * 3, rig.POSE_A)
    return rig.supervisor(policy, standby_controller_a=replace(slow, segment_durations=np.array([2.0, 20.0])))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (CommandsNaNInTheEnd, "expected finite numbers"),
        (PolicyTires, "on a healthy robot"),
        (IgnoresTheSecondSource, "although safety reports"),
        (ChangesTheRunningPolicy, "LOCOMOTION's stiffness"),
        (RemembersOutsideItsMemory, "the same inputs gave"),
        (pose_that_takes_for_ever, "standby_controller_a has not finished"),
    ],
)
def test_a_planted_defect_is_found(build, message):
    with pytest.raises(testing.SafetyViolationError, match=message):
        testing.fuzz_stack(build, SEARCH)


def test_guards_that_are_never_asked_are_found():
    class Machine(testing.StackMachine):
        build = staticmethod(SleepingGuards)

    run = Machine()
    run.go(Intent.LOAD_A, Intent.START_REMOTE)
    zeros, strong = np.zeros(run.joint_count), np.full(run.joint_count, 60.0)

    def push():
        for _ in range(100):
            run.time += PERIOD
            command = RemoteCommand(MITCommand(run.joints + 0.3, zeros, zeros, strong, strong), run.time)
            run.feed(run.healthy(remote=command), is_blocked=True)

    with pytest.raises(testing.SafetyViolationError, match="although a guard has tripped"):
        push()


def test_a_floating_base_is_led_into_remote():
    class Machine(testing.StackMachine):
        build = staticmethod(testing.robot_stack("lite_biped"))

    assert Machine().go(Intent.LOAD_A, Intent.START_REMOTE)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["lite", "lite_biped", "lite_neck"])
def test_every_shipped_robot_withstands_anything(name):
    testing.fuzz_stack(testing.robot_stack(name), settings(testing.DEFAULT_SETTINGS, max_examples=60))
