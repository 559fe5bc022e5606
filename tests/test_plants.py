import json

import pytest

from humanoid_sim.assets import SAMPLE_POLICY, motion_path
from humanoid_sim.cli import run_program
from humanoid_sim.plants import main, measured_cost
from humanoid_sim.policy.checkpoint import load_checkpoint
from humanoid_sim.policy.motion import read_motion
from humanoid_sim.robots.description import load_robot


def test_the_table_has_every_plant(capsys):
    assert main(["--seconds", "0.2", "--step", "0.0025", "0.003"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].endswith("lite_tracking.onnx on lite, motion wave, 0.2 s; errors against the converged solution")
    assert [line.split()[:2] for line in lines[2:]] == [["qfrc_applied", "0.5"], ["affine", "0.5"], ["implicit", "2.5"]]


def test_json_has_the_same_figures(capsys):
    assert main(["--seconds", "0.2", "--step", "0.005", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["seconds"] == pytest.approx(0.2)
    (implicit,) = (plant for plant in document["plants"] if plant["actuation"] == "implicit")
    assert implicit["timestep"] == 0.005
    assert 1e-5 < implicit["hands_rms"] < implicit["hands_most"] < 0.01


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--seconds", "0"), "error: --seconds: is 0.0, expected a finite number > 0\n"),
        (("--step", "-1"), "error: --step: is -1.0, expected finite numbers > 0\n"),
        (("--motion", "polka"), "polka"),
    ],
)
def test_bad_options_are_one_line(options, expected, capsys):
    assert run_program(main, options) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1


def test_whoever_chooses_the_plant_is_told_its_error(monkeypatch):
    robot, checkpoint = load_robot("lite"), load_checkpoint(SAMPLE_POLICY)
    monkeypatch.setattr("humanoid_sim.plants._BRIEF", 0.2)
    told = measured_cost(checkpoint, robot, read_motion(motion_path("wave")), "implicit", None)
    assert told.startswith("implicit plant, physics step 0.0025 s: hands within 0.")
    assert told.endswith("of the converged solution, measured on the first 0.2 s")
    failed = measured_cost(checkpoint, robot, None, "implicit", None)
    assert failed.startswith(
        "implicit plant, physics step 0.0025 s: its error could not be measured: motion: is missing"
    )
