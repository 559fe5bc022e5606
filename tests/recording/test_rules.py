"""A recording in which a rule shows that was corrected since: the replay says which, not just that it differs."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from recording_samples import write_recording

from humanoid_sim.cli import run_program
from humanoid_sim.messages import ControlMode, FaultReport, Intent, Mode, TickInput, TickOutput, TickRecord
from humanoid_sim.mit import MITCommand
from humanoid_sim.recording.rules import CORRECTIONS, shown_correction
from humanoid_sim.replay import main as replay_main
from humanoid_sim.robots.description import load_robot
from humanoid_sim.stack import build_supervisor, run_header
from humanoid_sim.testing import healthy_state

LITE = load_robot("lite")
TEXT = (
    "  a rule was corrected since: a joint position beyond 1e+06 rad made DAMPING, and REMOTE's passive hold, give way "
    "to ZERO_TORQUE; now they damp, because at K_p 0 the position does not matter\n"
)

replay = partial(run_program, replay_main)


@pytest.fixture
def recorded(tmp_path):
    """Writes a header and ticks to a file, and gives its path."""

    def write(head, ticks):
        path = tmp_path / "run.mcap"
        write_recording(path, ticks, head)
        return path

    return write


def run(reading):
    """Three ticks as the earlier version recorded them: DAMP in the second, with this reading of the elbow."""
    stack = build_supervisor(LITE, 0.02, None, guards=None)
    memory, ticks = stack.initial(), []
    for index in range(3):
        position = np.array(LITE.initial_position)
        position[3] = reading
        given = TickInput(healthy_state(position, 0.02 * index), (), (Intent.DAMP,) if index == 1 else ())
        memory, output = stack.step(memory, given)
        ticks.append(TickRecord(index, given, output, 1e-4, False))
    message = f"command's position of left_elbow_pitch is {reading}, expected a finite number from -1e+06 to 1e+06"
    fault = FaultReport("damping_controller", "zero_torque_controller", message)
    limp = replace(
        ticks[1].output,
        command=MITCommand.zeros(14),
        control_mode=ControlMode(Mode.ZERO_TORQUE, "zero_torque_controller", f"damping_controller failed: {message}"),
        faults=(fault,),
    )
    ticks[1] = replace(ticks[1], output=limp)
    return ticks


def header(*, corrections):
    head = run_header(LITE, 0.02, None, settings={}, guards=None)
    document = json.loads(head.documents["controllers"]) | {"corrections": corrections}
    if corrections is None:
        del document["corrections"]
    return replace(head, documents={**head.documents, "controllers": json.dumps(document)})


def test_the_correction_is_named(recorded, capsys):
    path = recorded(header(corrections=None), run(1e7))
    assert replay([str(path)]) == 1
    out = capsys.readouterr().out
    assert out.startswith("1 ticks identical; tick 1, t = 0.020 s, differs\n  faults: recorded (FaultReport(")
    assert TEXT in out
    assert replay([str(path), "--json"]) == 1
    result = json.loads(capsys.readouterr().out)
    assert (result["tick"], result["correction"]) == (1, "damping_on_absurd_readings")


@pytest.mark.parametrize(
    ("corrections", "reading"),
    [(["damping_on_absurd_readings"], 1e7), (None, 0.5), (None, float("nan"))],
    ids=["made with it", "no absurd reading", "not finite"],
)
def test_a_difference_of_another_cause_is_not_blamed_on_it(recorded, capsys, corrections, reading):
    assert replay([str(recorded(header(corrections=corrections), run(reading)))]) == 1
    assert "corrected" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("known", "named"), [((), "start_waits_for_live_inputs"), (("start_waits_for_live_inputs",), "")]
)
def test_a_start_without_its_live_input_is_named(known, named):
    given = TickInput(healthy_state(LITE.initial_position, 0.0), (), (Intent.START_LOCOMOTION,))
    fault = FaultReport("rl_policy_controller", "damping_controller", "observation key_pressed[0] is nan")
    zeros = MITCommand.zeros(14)
    before = TickOutput(zeros, ControlMode(Mode.DAMPING, "damping_controller", "failed"), faults=(fault,))
    standby = ControlMode(Mode.STANDBY, "standby_controller_a", "refused")
    now = TickOutput(zeros, standby, refusals=("START_LOCOMOTION refused: it has not come yet",))
    found = shown_correction(header(corrections=["damping_on_absurd_readings", *known]), given, before, now)
    assert ("" if found is None else found.name) == named


def test_a_new_recording_names_the_corrections_and_is_repeated(recorded, capsys):
    stack = build_supervisor(LITE, 0.02, None)
    head = run_header(LITE, 0.02, None, settings={})
    assert json.loads(head.documents["controllers"])["corrections"] == [one.name for one in CORRECTIONS]
    memory, ticks = stack.initial(), []
    for index in range(3):
        position = np.full(14, 1e9)
        given = TickInput(healthy_state(position, 0.02 * index), (), (Intent.DAMP,) if index == 1 else ())
        memory, output = stack.step(memory, given)
        ticks.append(TickRecord(index, given, output, 1e-4, False))
    assert ticks[2].output.control_mode.mode is Mode.DAMPING
    assert replay([str(recorded(head, ticks))]) == 0
    assert capsys.readouterr().out == "3 ticks, bit for bit identical\n"
