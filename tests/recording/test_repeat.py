"""Replay: a recorded run comes out again bit for bit, and any bit that does not is found and named."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_run import COUNT, PERIOD, wobbled
from recording_samples import write_recording

from humanoid_sim.messages import FaultReport, Mode
from humanoid_sim.mit import COMMAND_FIELDS
from humanoid_sim.replay import main as replay


@pytest.fixture(scope="module")
def sample():
    return wobbled()


@pytest.mark.parametrize(("name", "ticks"), [("simulated_locomotion.mcap", 408), ("hardware_reactivated.mcap", 450)])
def test_a_recording_of_an_earlier_run_is_repeated_bit_for_bit(name, ticks, capsys):
    assert replay([str(Path(__file__).parents[1] / "data" / "recordings" / name)]) == 0
    assert capsys.readouterr().out == f"{ticks} ticks, bit for bit identical\n"


def test_a_run_is_repeated_bit_for_bit(sample, tmp_path, capsys):
    write_recording(tmp_path / "run.mcap", sample[1], sample[0])
    assert replay([str(tmp_path / "run.mcap")]) == 0
    assert capsys.readouterr().out == f"{COUNT} ticks, bit for bit identical\n"


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
