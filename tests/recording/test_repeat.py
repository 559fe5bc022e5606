"""Replay: a recorded run comes out again bit for bit, and any bit that does not is found and named."""

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from recorded_run import COUNT, PERIOD, wobbled
from recording_samples import write_recording

from humanoid_sim.cli import run_program
from humanoid_sim.controllers.supervisor import NOT_DRIVEN
from humanoid_sim.messages import Event, EventKind, FaultReport, Mode
from humanoid_sim.mit import COMMAND_FIELDS
from humanoid_sim.recording.repeat import RecordedPolicy, repeat_entries
from humanoid_sim.replay import main as replay_main
from humanoid_sim.stack import rebuild_supervisor


@pytest.fixture(scope="module")
def sample():
    return wobbled()


@pytest.fixture
def recorded(tmp_path):
    """Writes ticks to a recording and returns its path."""

    def write(header, ticks):
        path = tmp_path / "run.mcap"
        write_recording(path, ticks, header)
        return path

    return write


replay = partial(run_program, replay_main)


def test_a_run_is_repeated_bit_for_bit(sample, recorded, capsys):
    assert replay([str(recorded(*sample))]) == 0
    assert capsys.readouterr().out == f"{COUNT} ticks, bit for bit identical\n"


@pytest.mark.parametrize(("kind", "begins_again"), [(EventKind.FRESH_START, True), (EventKind.NOTE, False)])
def test_a_fresh_start_is_repeated_with_its_reason(sample, kind, begins_again):
    """The reason is that of the run; everything else of the tick is computed again."""
    header, ticks = sample
    stack = rebuild_supervisor(header, RecordedPolicy())
    _, output = stack.step(stack.initial(NOT_DRIVEN), replace(ticks[0].input, intents=()))
    assert output.control_mode.status_message == NOT_DRIVEN
    fresh = replace(ticks[0], index=1, input=replace(ticks[0].input, intents=()), output=output)
    report = repeat_entries(header, [ticks[0], Event(0.0, "asked for", kind), fresh])
    assert (report.difference is None, report.ticks) == (begins_again, 1 + begins_again)


def with_output(ticks, index, output):
    """The run with another output in one tick."""
    return [*ticks[:index], replace(ticks[index], output=output), *ticks[index + 1 :]]


def flipped(array, index, bit=0):
    """A copy with one bit of one value flipped."""
    copy = np.array(array)
    copy.view(np.uint32 if copy.itemsize == 4 else np.uint64)[index] ^= 1 << bit
    return copy


def changed_output(name, output):
    """An output with one bit of one field changed."""
    step, mode, standby = output.policy_step, output.control_mode, output.standby
    part, _, field = name.partition(".")
    if part == "command":
        return replace(output, command=replace(output.command, **{field: flipped(getattr(output.command, field), 5)}))
    if part == "policy_step":
        value = step.frame + 1 if field == "frame" else flipped(getattr(step, field), 5)
        return replace(output, policy_step=replace(step, **{field: value}))
    if part == "control_mode":
        values = {"mode": Mode.REMOTE, "controller_name": "another_controller", "status_message": "another message"}
        return replace(output, control_mode=replace(mode, **{field: values[field]}))
    if part == "standby" and field:
        changed = {
            "progress": np.nextafter(standby.progress, 2.0),
            "is_finished": not standby.is_finished,
            "current_segment": standby.current_segment ^ 1,
            "total_segments": standby.total_segments ^ 1,
        }
        return replace(output, standby=replace(standby, **{field: changed[field]}))
    values = {
        "quit": not output.quit,
        "faults": (*output.faults, FaultReport("a", "b", "c")),
        "refusals": (*output.refusals, "no"),
        "policy_error": "out of memory",
        "standby": None,
        "policy_step": None,
    }
    return replace(output, **{name: values[name]})


IN_STANDBY, IN_LOCOMOTION = 100, 220
FIELDS = [
    *((f"command.{field}", IN_LOCOMOTION) for field in COMMAND_FIELDS),
    *((f"control_mode.{field}", IN_STANDBY) for field in ("mode", "controller_name", "status_message")),
    *((f"standby.{field}", IN_STANDBY) for field in ("progress", "is_finished", "current_segment", "total_segments")),
    *((f"policy_step.{field}", IN_LOCOMOTION) for field in ("frame", "observation")),
    *((field, IN_STANDBY) for field in ("quit", "faults", "refusals", "policy_error", "standby")),
]


@pytest.mark.parametrize(("field", "index"), FIELDS)
def test_a_changed_bit_is_found_and_named(sample, recorded, capsys, field, index):
    header, ticks = sample
    assert ticks[index].output.policy_step is not None or index != IN_LOCOMOTION
    changed = with_output(ticks, index, changed_output(field, ticks[index].output))
    assert replay([str(recorded(header, changed)), "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert (result["tick"], result["ticks"]) == (index, index)
    assert result["time"] == pytest.approx(index * PERIOD)
    assert result["difference"]["field"] == field
    assert result["difference"]["recorded"] != result["difference"]["replayed"]
    if field.startswith("command."):
        assert result["difference"]["where"] == header.joint_names[5]
    if field == "policy_step.observation":
        assert result["difference"]["where"] == "joint_pos[5]"
