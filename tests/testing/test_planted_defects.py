"""Planted defects are found: those that need time or one tick at once and always, the others by the search."""

from dataclasses import replace

import pytest
import rig
import yaml
from hypothesis import Phase, settings
from hypothesis.stateful import run_state_machine_as_test
from planted_defects import DEFECTS, NEED_TIME, SOUND, DampingGoesLimp, SleepingGuards, Stack, changed, find

from humanoid_sim import testing
from humanoid_sim.assets import asset_path
from humanoid_sim.controllers import supervisor as supervisor_module
from humanoid_sim.controllers.fsm import Decision, transition
from humanoid_sim.messages import OK, Intent, Mode
from humanoid_sim.testing.fuzz import every_mode_lasts, every_report_and_intent

SEARCH = settings(testing.DEFAULT_SETTINGS, max_examples=200, derandomize=True, database=None, phases=[Phase.generate])
MESSAGES = (
    "expected finite numbers (tick 1000 of a healthy stretch in damping_controller); on a healthy robot, after DAMP",
    "damping_controller went to zero_torque_controller by itself",
    "on a healthy robot: (FaultReport(",
    "expected one share of",
    "REMOTE's command, unless it is the passive hold",
)


def machine(build):
    return type("Machine", (testing.StackMachine,), {"build": staticmethod(build)})


@pytest.mark.parametrize(("name", "message"), [*zip(NEED_TIME, MESSAGES, strict=True)])
def test_what_needs_time_is_found_before_anything_random(name, message):
    with pytest.raises(testing.SafetyViolationError) as caught:
        every_mode_lasts(machine(DEFECTS[name]), 1100)
    assert message in str(caught.value)


@pytest.mark.soak
@pytest.mark.parametrize("name", list(DEFECTS))
def test_each_planted_defect_is_found_with_the_default_settings(name):
    assert find(DEFECTS[name])[0]


def test_a_sound_stack_is_asked_for_everything_in_every_mode():
    asked = set()

    class Watched(machine(SOUND)):
        def check(self, given, output):
            super().check(given, output)
            asked.add((output.control_mode.mode, len(given.safety), len(given.intents)))

    every_report_and_intent(Watched)
    assert {mode for mode, _, _ in asked} == set(Mode)
    assert {(Mode.DAMPING, count, 0) for count in (1, 2, 3)} <= asked
    assert {(Mode.REMOTE, 0, count) for count in (1, 2, 3)} <= asked


class DropsDampAtTheEnd(Stack):
    def before(self, memory, given):
        return replace(given, intents=given.intents[:2]) if given.intents[2:] == (Intent.DAMP,) else given


class PushesAtDamp(Stack):
    def after(self, memory, given, output):
        if Intent.DAMP in given.intents:
            output = changed(output, damping=-output.command.damping)
        return memory, output


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (DEFECTS["the second safety source is ignored"], "although safety reports"),
        (DEFECTS["DAMP together with QUIT is ignored"], "DAMP was requested"),
        (DropsDampAtTheEnd, "'DAMP']"),
        (PushesAtDamp, "expected no negative gain; on a healthy robot, after the start, with ['DAMP']"),
    ],
)
def test_what_is_one_tick_away_is_found_without_a_search(build, message):
    with pytest.raises(testing.SafetyViolationError) as caught:
        every_report_and_intent(machine(build))
    assert message in str(caught.value)


def test_a_run_is_repeated_from_its_inputs():
    built = []

    class ForgetfulOnceMore(Stack):
        def __init__(self, policy):
            super().__init__(policy)
            built.append(self)

        def after(self, memory, given, output):
            if self is not built[0] and memory.ticks == 99:
                output = changed(output, damping=output.command.damping * 2.0)
            return memory, output

    run = machine(ForgetfulOnceMore)()
    run.tick(Intent.DAMP)
    run.pass_time(99)
    with pytest.raises(testing.SafetyViolationError, match="of the repeated run gave"):
        run.teardown()


def test_time_passes_in_a_machine_of_ones_own():
    patient, limp = machine(SOUND)(), machine(DampingGoesLimp)()
    for one in (patient, limp):
        one.tick(Intent.DAMP)
    patient.time_passes(300, True)
    assert patient.time == pytest.approx(10.0 + 302 * 0.02)
    with pytest.raises(testing.SafetyViolationError, match="by itself"):
        limp.time_passes(1000, True)


@pytest.mark.parametrize(("speed", "guard"), [(0.0, "following"), (-200.0, "speed")])
def test_a_blocked_or_racing_joint_shows_guards_that_are_not_asked(speed, guard):
    sound, asleep = machine(SOUND)(), machine(SleepingGuards)()
    for one in (sound, asleep):
        one.tick(Intent.DAMP)
        one.tick(Intent.LOAD_A)
        one.pass_time(50)
    sound.the_joints_are_blocked(60, None, speed)
    assert sound.memory.controller == "damping_controller"
    with pytest.raises(testing.SafetyViolationError, match=f"although a guard has tripped: {guard} guard"):
        asleep.the_joints_are_blocked(60, None, speed)


def without_safety(current, safety, *rest):
    return transition(current, OK, *rest)


def recovers(current, safety, intent, *rest):
    healthy = safety.is_ok and intent is None and current == "damping_controller"
    return Decision("standby_controller_a") if healthy else transition(current, safety, intent, *rest)


@pytest.mark.parametrize(
    ("rule", "message"), [(without_safety, "although safety reports"), (recovers, "went to standby_controller_a")]
)
def test_a_mistake_in_the_fsm_is_found(monkeypatch, rule, message):
    monkeypatch.setattr(supervisor_module, "transition", rule)
    with pytest.raises(testing.SafetyViolationError, match=message):
        testing.fuzz_stack(rig.supervisor, SEARCH, healthy_ticks=100)


def test_a_pose_that_takes_for_ever_is_found(tmp_path):
    document = yaml.safe_load(asset_path("robots", "lite.yaml").read_text(encoding="utf-8"))
    document["mjcf"] = str((asset_path("robots") / document["mjcf"]).resolve())
    document["standby_controller_a"]["segment_durations"] = [2.0, 20.0]
    (tmp_path / "slow.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    with pytest.raises(testing.SafetyViolationError, match="standby_controller_a has not finished after 20"):
        every_mode_lasts(machine(testing.robot_stack(tmp_path / "slow.yaml")), 1)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["lite", "lite_biped", "lite_neck"])
def test_every_shipped_robot_withstands_anything(name):
    testing.fuzz_stack(testing.robot_stack(name), settings(testing.DEFAULT_SETTINGS, max_examples=60))


def test_a_property_of_ones_own_is_checked_in_the_search():
    class Gentle(testing.StackMachine):
        position, waiting_period = rig.KNOWN, rig.PERIOD

        def build(self, policy):
            return rig.supervisor(policy)

        def check(self, given, output):
            super().check(given, output)
            assert abs(output.command.velocity).max() <= 1.0, "too fast"

    with pytest.raises(AssertionError, match="too fast"):
        run_state_machine_as_test(Gentle, settings=SEARCH)
