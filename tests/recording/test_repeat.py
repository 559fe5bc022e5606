"""Replay: a recorded run comes out again bit for bit, and any bit that does not is found and named."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_run import COUNT, PERIOD, wobbled
from recording_samples import write_recording

from humanoid_sim.controllers.supervisor import NOT_DRIVEN
from humanoid_sim.messages import Event, EventKind, FaultReport, Mode
from humanoid_sim.mit import COMMAND_FIELDS
from humanoid_sim.recording.repeat import RecordedPolicy, repeat_run
from humanoid_sim.replay import main as replay
from humanoid_sim.stack import rebuild_supervisor


@pytest.fixture(scope="module")
def sample():
    return wobbled()


def test_a_run_is_repeated_bit_for_bit(sample, tmp_path, capsys):
    write_recording(tmp_path / "run.mcap", sample[1], sample[0])
    assert replay([str(tmp_path / "run.mcap")]) == 0
    assert capsys.readouterr().out == f"{COUNT} ticks, bit for bit identical\n"


@pytest.mark.parametrize(("kind", "begins_again"), [(EventKind.FRESH_START, True), (EventKind.NOTE, False)])
def test_a_fresh_start_is_repeated_with_its_reason(sample, kind, begins_again):
    """The reason is that of the run; everything else of the tick is computed again."""
    header, ticks = sample
    stack = rebuild_supervisor(header, RecordedPolicy())
    _, output = stack.step(stack.initial(NOT_DRIVEN), replace(ticks[0].input, intents=()))
    assert output.control_mode.status_message == NOT_DRIVEN
    fresh = replace(ticks[0], index=1, input=replace(ticks[0].input, intents=()), output=output)
    entries = [ticks[0], Event(0.0, "asked for", kind), fresh]
    recording = SimpleNamespace(header=header, entries=lambda: entries, is_complete=True, damage="")
    report = repeat_run(recording)
    assert (report.difference is None, report.ticks) == (begins_again, 1 + begins_again)


def flipped(array):
    """A copy with one bit of its sixth value flipped."""
    copy = np.array(array)
    copy.view(np.uint32 if copy.itemsize == 4 else np.uint64)[5] ^= 1
    return copy


def within(name, **changes):
    """A change of some fields of a part of an output, each a function of its value."""

    def change(output):
        part = getattr(output, name)
        values = {field: new(getattr(part, field)) for field, new in changes.items()}
        return replace(output, **{name: replace(part, **values)})

    return change


IN_STANDBY, IN_LOCOMOTION = 100, 220
CHANGES = {  # by field: a tick, and a change of its output
    **{f"command.{field}": (IN_LOCOMOTION, within("command", **{field: flipped})) for field in COMMAND_FIELDS},
    "control_mode.mode": (IN_STANDBY, within("control_mode", mode=lambda _: Mode.REMOTE)),
    "control_mode.status_message": (IN_STANDBY, within("control_mode", status_message=lambda _: "another")),
    "standby.progress": (IN_STANDBY, within("standby", progress=lambda value: np.nextafter(value, 2.0))),
    "standby.current_segment": (IN_STANDBY, within("standby", current_segment=lambda value: value ^ 1)),
    "standby": (IN_STANDBY, lambda output: replace(output, standby=None)),
    "policy_step.frame": (IN_LOCOMOTION, within("policy_step", frame=lambda value: value + 1)),
    "policy_step.observation": (IN_LOCOMOTION, within("policy_step", observation=flipped)),
    "quit": (IN_STANDBY, lambda output: replace(output, quit=True)),
    "faults": (IN_STANDBY, lambda output: replace(output, faults=(FaultReport("a", "b", "c"),))),
    "refusals": (IN_STANDBY, lambda output: replace(output, refusals=("no",))),
    "policy_error": (IN_STANDBY, lambda output: replace(output, policy_error="out of memory")),
}


@pytest.mark.parametrize(("field", "index", "change"), [(field, *rest) for field, rest in CHANGES.items()], ids=CHANGES)
def test_a_changed_bit_is_found_and_named(sample, tmp_path, capsys, field, index, change):
    header, ticks = sample
    changed = [*ticks[:index], replace(ticks[index], output=change(ticks[index].output)), *ticks[index + 1 :]]
    write_recording(tmp_path / "run.mcap", changed, header)
    assert replay([str(tmp_path / "run.mcap"), "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert (result["tick"], result["ticks"]) == (index, index)
    assert result["time"] == pytest.approx(index * PERIOD)
    assert result["difference"]["field"] == field
    assert result["difference"]["recorded"] != result["difference"]["replayed"]
    if field.startswith("command."):
        assert result["difference"]["where"] == header.joint_names[5]
    if field == "policy_step.observation":
        assert result["difference"]["where"] == "joint_pos[5]"
