"""`robot describe`: what it prints of an MJCF, and the file that it writes."""

import pytest

from humanoid_sim.cli import run_program
from humanoid_sim.robot import main


def test_what_is_read_is_printed(hopper, capsys):
    hopper.write_text(hopper.read_text().replace('name="knee" axis', 'name="knee" damping="0.25" axis'))
    hopper.write_text(hopper.read_text().replace('forcerange="-30 40"', ""))
    assert main(["describe", str(hopper)]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = {
        cells[2].strip(): [cell.strip() for cell in cells[3:-1]]
        for cells in (line.split("│") for line in lines)
        if len(cells) > 3
    }
    assert rows["hip"] == ["-1 to 1", "20", "policy's", "policy's", "none", "0"]
    assert rows["knee"] == ["0.2 to 2", "none", "policy's", "policy's", "0.25", "0.2"]
    told = dict(
        line.split("  ", 1) for line in lines if "  " in line and "│" not in line and not line.startswith("joints")
    )
    assert told["base"] == "floating, body 'trunk', starts with its lowest part on the floor"
    assert told["IMU"] == "site 'my_imu' on the base 'trunk' (the site of a gyro)"
    assert told["passive joints"] == "spring"
    assert told["without effort limit"] == "knee"


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["describe", "nobody"], "unknown robot 'nobody'; known: "),
        (["describe", "lite", "-o", "x.yaml"], "--output: is for an MJCF (.xml), and 'lite' is none"),
        (["describe", "{hopper}", "-o", "x.txt"], "--output: "),
        (["describe", "{hopper}", "--imu-site", "head"], "imu of 'hopper': unknown site or body 'head'; known: my_imu"),
    ],
)
def test_mistakes(hopper, words, error, capsys, monkeypatch):
    monkeypatch.chdir(hopper.parent)
    assert run_program(main, [word.format(hopper=hopper) for word in words]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert error in captured.err
    assert captured.err.count("\n") == 1
    assert list(hopper.parent.glob("x.*")) == []
