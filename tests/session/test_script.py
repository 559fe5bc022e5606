import re

import pytest
import rig
from fakes import FakeRobot, FakeSink, FakeSource, session

from humanoid_sim.errors import InputError
from humanoid_sim.messages import (
    ControlMode,
    FaultReport,
    Intent,
    Mode,
    SafetyFlag,
    SafetyLevel,
    SafetyStatus,
    TickOutput,
)
from humanoid_sim.mit import MITCommand
from humanoid_sim.session.script import Script, parse_script

BAD_SCRIPTS = {
    " ; ;": "is empty",
    "damp; laod_a": "step 2 is 'laod_a' (did you mean 'load_a'?), expected one of damp, load_a, ",
    "damp; wait 3": "step 2 is 'wait 3'",
    "hold": "step 1 is 'hold'",
    "hold -1": "step 1 is 'hold -1', expected one of ",
    "hold nan": "step 1 is 'hold nan', expected one of ",
}


def test_the_grammar():
    steps = parse_script("damp; LOAD_B ;wait;start_remote; hold 5;; motion; hold 0; load_a; start_locomotion; quit;")
    words = [step.intent.value if step.intent else f"{step.kind} {step.seconds:g}" for step in steps]
    expected = "damp, load_b, wait 0, start_remote, hold 5, motion 0, hold 0, load_a, start_locomotion, quit"
    assert ", ".join(words) == expected


@pytest.mark.parametrize("text", BAD_SCRIPTS)
def test_a_bad_script_is_refused_with_its_step_and_the_grammar(text):
    with pytest.raises(InputError, match=f"^--script: {re.escape(BAD_SCRIPTS[text])}.*hold SECONDS"):
        parse_script(text)


def play(text, fault=None, operators=()):
    """Run a script; `fault` is the time of a one-tick safety fault, s. The script, its result and ticks, the modes."""
    script, sink = Script(parse_script(text), operators=operators), FakeSink()
    statuses = (SafetyStatus(SafetyLevel.FAULT, SafetyFlag.BUS_OFF),)
    run = session(
        FakeRobot(),
        duration=20.0,
        intents=[script],
        sinks=[sink],
        safety_filter=lambda _: statuses if fault is not None and abs(run.time - fault) < 0.5 * rig.PERIOD else (),
    )
    result = run.run()
    modes = [record.output.control_mode.mode.name for record in sink.records]
    return script, result.reason, sink.records, modes


def test_steps_are_played_in_order_one_intent_per_tick():
    text = "damp; load_a; wait; hold 0.1; start_locomotion; motion; damp; hold 0.2; quit"
    _, _, records, modes = play(text)
    assert max(len(record.input.intents) for record in records) == 1
    assert list(dict.fromkeys(modes)) == ["DAMPING", "STANDBY", "LOCOMOTION"]
    # The pose is reached 4 ticks after LOAD_A, which `wait` sees one tick later; then 0.1 s.
    assert modes.index("STANDBY") == 1
    assert modes.index("LOCOMOTION") == pytest.approx(1 + 5 + 5 + 2, abs=1)
    assert [record.output.policy_step.frame for record in records if record.output.policy_step][-1] == 3
    assert records[-1].output.quit
    assert modes.count("DAMPING") >= 0.2 / rig.PERIOD


@pytest.mark.parametrize(
    ("text", "mode"),
    [
        ("damp; hold 0.1; load_a; wait; hold 10; start_locomotion; hold 10", "STANDBY"),
        ("damp; load_a; wait; start_locomotion; hold 10; damp; load_b; wait; start_locomotion; hold 9", "LOCOMOTION"),
        ("damp; load_a; wait; start_locomotion; motion; load_a; hold 10", "LOCOMOTION"),
    ],
)
def test_nothing_that_was_planned_before_a_fault_moves_the_robot_after_it(text, mode):
    script, reason, records, modes = play(text, fault=0.5)
    assert modes[24] == mode
    assert set(modes[25:]) == {"DAMPING"}
    assert (script.finished, reason) == (True, "script finished")
    assert not any({*record.input.intents} - {Intent.DAMP, Intent.QUIT} for record in records[25:])


def test_an_operator_takes_the_scripts_place_until_the_end():
    text = "damp; hold 0.1; load_a; wait; start_locomotion; hold 1"
    script, reason, _, modes = play(text, operators=[FakeSource(), FakeSource({10: (Intent.DAMP,)})])
    assert reason == "duration of 20 s reached", "an operator also ends the run"
    assert set(modes[10:]) == {"DAMPING"}
    assert not script.finished
    assert play("damp; hold 0.1", operators=[FakeSource()])[1] == "script finished", "that nobody overrides"


def test_a_fault_that_moves_nothing_drops_the_rest():
    """LOAD_A that fails to start leaves the robot in DAMPING: no fall, but what was planned is off."""
    script = Script(parse_script("damp; load_a; hold 1; load_b"))
    damping = ControlMode(Mode.DAMPING, "damping_controller")
    assert script.poll(0.0, None) == [Intent.DAMP]
    assert script.poll(0.1, TickOutput(MITCommand.zeros(2), damping)) == [Intent.LOAD_A]
    fault = FaultReport("standby_controller_a", "damping_controller", "position of wrist is nan")
    assert script.poll(0.2, TickOutput(MITCommand.zeros(2), damping, faults=(fault,))) == []
    assert script.finished
