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
    told = [step.intent.name if step.kind == "intent" else (step.kind, step.seconds) for step in steps]
    wait, motion = ("wait", 0.0), ("motion", 0.0)
    assert told == [
        *("DAMP", "LOAD_B", wait, "START_REMOTE", ("hold", 5.0), motion, ("hold", 0.0)),
        *("LOAD_A", "START_LOCOMOTION", "QUIT"),
    ]


@pytest.mark.parametrize("text", BAD_SCRIPTS)
def test_a_bad_script_is_refused_with_its_step_and_the_grammar(text):
    with pytest.raises(InputError) as caught:
        parse_script(text)
    message = str(caught.value)
    assert message.startswith(f"--script: {BAD_SCRIPTS[text]}")
    assert "hold" in message


def play(text, frames=0, faults=()):
    """Run a script on the rig; `faults` are the times of one-tick safety faults."""
    script, sink = Script(parse_script(text), {"": frames}), FakeSink()
    run = session(
        FakeRobot(),
        duration=20.0,
        intents=[script],
        sinks=[sink],
        safety_filter=lambda _: (
            (SafetyStatus(SafetyLevel.FAULT, SafetyFlag.BUS_OFF),)
            if any(abs(run.time - fault) < 0.5 * rig.PERIOD for fault in faults)
            else ()
        ),
    )
    result = run.run()
    assert result.reason == "script finished" or "quit" in text
    return script, sink.records


def starts(records):
    """Where each mode begins, s."""
    found = []
    for record in records:
        name = record.output.control_mode.mode.name
        if not found or found[-1][0] != name:
            found.append((name, round(float(record.input.state.time), 6)))
    return found


def test_steps_are_played_in_order_one_intent_per_tick():
    _, records = play("damp; load_a; wait; hold 0.1; start_locomotion; motion; damp; hold 0.2; quit", frames=4)
    assert max(len(record.input.intents) for record in records) == 1
    assert [name for name, _ in starts(records)] == ["ZERO_TORQUE", "DAMPING", "STANDBY", "LOCOMOTION", "DAMPING"][1:]
    times = dict(starts(records))
    # The pose is reached 4 ticks after LOAD_A, which `wait` sees one tick later; then 0.1 s.
    assert times["STANDBY"] == 0.02
    assert times["LOCOMOTION"] == pytest.approx(0.02 + 5 * 0.02 + 0.1 + 0.04, abs=0.021)
    shown = [record.output.policy_step.frame for record in records if record.output.policy_step]
    assert shown[-1] == 3
    assert records[-1].output.quit
    damped = [record for record in records if record.output.control_mode.mode is Mode.DAMPING]
    assert len(damped) >= 0.2 / rig.PERIOD


@pytest.mark.parametrize(
    ("text", "mode"),
    [
        ("damp; hold 0.1; load_a; wait; hold 10; start_locomotion; hold 10", "STANDBY"),
        ("damp; load_a; wait; start_locomotion; hold 10; damp; load_b; wait; start_locomotion; hold 9", "LOCOMOTION"),
        ("damp; load_a; wait; start_locomotion; motion; load_a; hold 10", "LOCOMOTION"),
    ],
)
def test_nothing_that_was_planned_before_a_fault_moves_the_robot_after_it(text, mode):
    script, records = play(text, frames=1000, faults=(0.5,))
    assert [name for name, _ in starts(records)][-2:] == [mode, "DAMPING"]
    assert starts(records)[-1][1] == 0.5
    assert script.finished
    assert not any(record.input.intents for record in records[-20:-1])


def test_an_operator_takes_the_scripts_place_for_good():
    operator, sink = FakeSource({10: (Intent.DAMP,)}), FakeSink()
    steps = parse_script("damp; hold 0.1; load_a; wait; start_locomotion; hold 1")
    script = Script(steps, operators=[FakeSource(), operator])
    result = session(FakeRobot(), duration=1.0, intents=[script], sinks=[sink]).run()
    assert result.reason == "duration of 1 s reached"  # whoever took over also ends the run
    assert [name for name, _ in starts(sink.records)] == ["DAMPING", "STANDBY", "DAMPING"]
    assert not script.finished
    alone = Script(parse_script("damp; hold 0.1"), operators=[FakeSource()])
    assert session(FakeRobot(), intents=[alone]).run().reason == "script finished", "that nobody overrides"


def test_a_fault_that_moves_nothing_drops_the_rest():
    """LOAD_A that fails to start leaves the robot in DAMPING: no fall, but what was planned is off."""
    script = Script(parse_script("damp; load_a; hold 1; load_b"))
    damping = ControlMode(Mode.DAMPING, "damping_controller")
    assert script.poll(0.0, None) == [Intent.DAMP]
    assert script.poll(0.1, TickOutput(MITCommand.zeros(2), damping)) == [Intent.LOAD_A]
    fault = FaultReport("standby_controller_a", "damping_controller", "position of wrist is nan")
    assert script.poll(0.2, TickOutput(MITCommand.zeros(2), damping, faults=(fault,))) == []
    assert script.finished
