"""`record signs`: a mirrored joint shows in the efforts of a robot at rest."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from recording_samples import write_recording

from humanoid_sim.cli import run_program
from humanoid_sim.messages import Intent, SafetyStatus, TickInput, TickRecord
from humanoid_sim.record import main as record_main
from humanoid_sim.recording.reader import open_recording
from humanoid_sim.recording.signs import judge_signs
from humanoid_sim.robots.description import load_robot
from humanoid_sim.simulation.model import SimConfig
from humanoid_sim.simulation.sim_robot import SimRobot
from humanoid_sim.stack import build_supervisor, run_header

LITE = load_robot("lite")
PERIOD = 0.02
record = partial(run_program, record_main)


def recorded(path, *, mirrored=(), ticks=262):
    """A STANDBY of the simulated robot, some of whose joints report and obey the other direction."""
    sign = np.array([-1.0 if name in mirrored else 1.0 for name in LITE.joint_names])
    supervisor = build_supervisor(LITE, PERIOD, None)
    plant = SimRobot(LITE, SimConfig(control_period=PERIOD))
    plant.activate()
    memory, records = supervisor.initial(), []

    def flipped(value, prefix=""):
        names = (f"{prefix}{name}" for name in ("position", "velocity", "effort"))
        return replace(value, **{name: sign * getattr(value, name) for name in names})

    for index in range(ticks):
        state, _ = plant.read()
        intents = {1: (Intent.DAMP,), 2: (Intent.LOAD_A,)}.get(index, ())
        tick_input = TickInput(flipped(state, "joint_"), (SafetyStatus(),), intents, None)
        memory, output = supervisor.step(memory, tick_input)
        records.append(TickRecord(index, tick_input, output, 0.0, False))
        plant.write(flipped(output.command))
    plant.close()
    write_recording(path, records, run_header(LITE, PERIOD, None, settings={}))
    return path


def verdicts(path):
    return {row.joint: row.verdict for row in judge_signs(open_recording(path), LITE)}


def test_a_sound_robot_agrees_with_gravity(tmp_path):
    found = verdicts(recorded(tmp_path / "run.mcap"))
    assert {*found.values()} == {"agrees", "agrees, as it would mirrored"}
    assert found["left_shoulder_roll"] == found["right_elbow_pitch"] == "agrees"


@pytest.mark.parametrize("joint", ["left_shoulder_roll", "right_shoulder_pitch"])
def test_a_mirrored_joint_is_named(joint, tmp_path):
    found = verdicts(recorded(tmp_path / "run.mcap", mirrored=(joint,)))
    assert found[joint] == "contradicts: direction wrong?"
    assert all("contradicts" not in verdict for name, verdict in found.items() if name[:4] != joint[:4])


def test_the_table_and_a_recording_without_a_rest(tmp_path, capsys):
    path = str(recorded(tmp_path / "run.mcap", mirrored=("left_shoulder_roll",)))
    assert record(["signs", path]) == 0
    assert "direction wrong?" in capsys.readouterr().out
    short = str(recorded(tmp_path / "short.mcap", ticks=100))
    assert record(["signs", short]) == 2
    assert capsys.readouterr().err.startswith(f"error: {short}: the robot never rested for 1 s in STANDBY or LOCO")
