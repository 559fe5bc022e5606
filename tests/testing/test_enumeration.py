"""What needs no luck is found always: every safety report and every combination of intents, in every mode."""

from dataclasses import replace

import pytest
from planted_defects import DEFECTS, SOUND, Stack, changed

from humanoid_sim.messages import Intent, Mode
from humanoid_sim.testing import SafetyViolationError, StackMachine
from humanoid_sim.testing.fuzz import every_mode_lasts, every_report_and_intent


def machine(build):
    return type("Machine", (StackMachine,), {"build": staticmethod(build)})


def test_a_sound_stack_passes_and_is_asked_in_every_mode():
    asked = set()

    class Watched(machine(SOUND)):
        def check(self, given, output):
            super().check(given, output)
            asked.update((output.control_mode.mode, len(given.safety)) for _ in given.safety[:1])

    every_report_and_intent(Watched)
    assert {(Mode.DAMPING, count) for count in (1, 2, 3)} <= asked
    assert {mode for mode, _ in asked} == set(Mode)


@pytest.mark.parametrize(
    ("defect", "message"),
    [
        ("the second safety source is ignored", "although safety reports"),
        ("DAMP together with QUIT is ignored", "DAMP was requested"),
    ],
)
def test_what_is_one_tick_away_is_found_without_a_search(defect, message):
    with pytest.raises(SafetyViolationError, match=message) as caught:
        every_report_and_intent(machine(DEFECTS[defect]))
    assert " on a healthy robot, with " in str(caught.value)


def test_a_third_intent_that_hides_damp_is_found():
    class DropsDampAtTheEnd(Stack):
        def before(self, memory, given):
            return replace(given, intents=given.intents[:2]) if given.intents[2:] == (Intent.DAMP,) else given

    with pytest.raises(SafetyViolationError, match="DAMP was requested") as caught:
        every_report_and_intent(machine(DropsDampAtTheEnd))
    assert "'DAMP']" in str(caught.value)


def test_a_mode_that_fails_on_the_way_is_named():
    class RefusesToRest(Stack):
        def after(self, memory, given, output):
            if Intent.DAMP in given.intents:
                output = changed(output, damping=-output.command.damping)
            return memory, output

    with pytest.raises(SafetyViolationError, match="expected no negative gain; after DAMP, without any attack"):
        every_mode_lasts(machine(RefusesToRest), 5)
