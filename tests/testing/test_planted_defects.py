"""Planted defects are found: those that need time at once and always, the others by the search; the first is told."""

import planted_defects
import pytest
from hypothesis import settings
from planted_defects import DEFECTS, NEED_TIME, SOUND, DampingGoesLimp, SleepingGuards, Stack, find

from humanoid_sim import testing
from humanoid_sim.controllers.base import Fault
from humanoid_sim.controllers.damping import DampingController
from humanoid_sim.messages import Intent

JOINTS = ("shoulder", "elbow")
FEW = settings(testing.DEFAULT_SETTINGS, max_examples=5, derandomize=True, database=None)
MESSAGES = dict(
    zip(
        DEFECTS,
        (
            "expected finite numbers (tick 1000 of a healthy stretch in damping_controller); after DAMP, without any",
            "damping_controller went to zero_torque_controller by itself (tick 300 of a healthy stretch",
            "on a healthy robot, after 501 ticks in rl_policy_controller: (FaultReport(",
            "of its targets like the other gains (tick ",
            "expected the newest command",
            "although safety reports",
            "DAMP was requested",
            "expected no negative gain",
            "DAMPING's position",
            "index 14 is out of bounds",
            "should have tripped the following guard 0.05 s ago",
            "following guard: ",
        ),
        strict=True,
    )
)


@pytest.mark.parametrize("name", NEED_TIME)
def test_what_needs_time_is_found_before_anything_random(name):
    with pytest.raises(testing.SafetyViolationError) as caught:
        testing.fuzz_stack(DEFECTS[name], FEW, healthy_ticks=1100)
    assert MESSAGES[name] in str(caught.value)
    assert "without any attack" in str(caught.value)


@pytest.mark.soak
@pytest.mark.parametrize("name", list(DEFECTS))
def test_each_planted_defect_is_found_with_the_default_settings(name):
    found = find(DEFECTS[name], shrink_seconds=0.0)
    assert found.message
    assert found.runs <= 150


class Patient(testing.StackMachine):
    build = staticmethod(SOUND)


class Limp(testing.StackMachine):
    build = staticmethod(DampingGoesLimp)


def test_time_passes_in_a_machine_of_ones_own():
    machine = Patient()
    machine.tick(Intent.DAMP)
    machine.time_passes(300, True)
    assert machine.time == pytest.approx(10.0 + 302 * 0.02)
    assert machine.memory.controller == "damping_controller"
    machine.teardown()
    limp = Limp()
    limp.tick(Intent.DAMP)
    with pytest.raises(testing.SafetyViolationError, match="by itself"):
        limp.time_passes(1000, True)


def test_a_long_stretch_is_repeated_too():
    """What a stretch remembers outside its memory shows when the run is repeated."""
    shared = {"runs": 0}

    class Forgetful(Stack):
        def __init__(self, policy):
            super().__init__(policy)
            shared["runs"] += 1
            self.later = shared["runs"] > 1

        def after(self, memory, given, output):
            if self.later and memory.ticks == 99:
                output = planted_defects.changed(output, damping=output.command.damping * 2.0)
            return memory, output

    class Machine(testing.StackMachine):
        build = staticmethod(Forgetful)

    machine = Machine()
    machine.tick(Intent.DAMP)
    machine.pass_time(99)
    with pytest.raises(testing.SafetyViolationError, match="of the repeated run gave"):
        machine.teardown()


class FailsInTime(DampingController):
    __slots__ = ()

    def update(self, memory, tick_input):
        return Fault("tired") if tick_input.state.time > 40.0 else super().update(memory, tick_input)


def test_a_controller_may_not_fail_on_a_healthy_robot_however_long_it_runs():
    tired = FailsInTime(JOINTS)
    with pytest.raises(testing.SafetyViolationError, match=r"on a healthy robot: Fault\(message='tired'.*in tick 1501"):
        testing.fuzz_controller(tired, FEW)


@pytest.mark.parametrize(("speed", "guard"), [(0.0, "following"), (-200.0, "speed")])
def test_a_blocked_or_racing_joint_shows_guards_that_are_not_asked(speed, guard):
    machines = []
    for build in (SOUND, SleepingGuards):

        class Blocked(testing.StackMachine):
            pass

        Blocked.build = staticmethod(build)
        machines.append(machine := Blocked())
        machine.tick(Intent.DAMP)
        machine.tick(Intent.LOAD_A)
        machine.pass_time(50)
    sound, asleep = machines
    sound.the_joints_are_blocked(60, None, speed)
    assert sound.memory.controller == "damping_controller"
    with pytest.raises(testing.SafetyViolationError, match=f"should have tripped the {guard} guard 0.05 s ago"):
        asleep.the_joints_are_blocked(60, None, speed)
