"""The examples run as they stand."""

from pathlib import Path

import pytest
from script_files import load_script

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name):
    return load_script(EXAMPLES / f"{name}.py")


def test_a_controller_of_ones_own_drives_the_robot(capsys):
    load("own_controller").main()
    *modes, swayed = capsys.readouterr().out.splitlines()
    assert [line.split()[2] for line in modes] == ["DAMPING", "STANDBY", "LOCOMOTION", "DAMPING"]
    low, high = (float(word) for word in swayed.split()[3:6:2])
    assert high - low == pytest.approx(0.4, abs=0.05)


def test_the_controller_stands_what_the_fuzzer_does_to_it():
    from humanoid_sim.testing import DEFAULT_SETTINGS, fuzz_controller  # noqa: PLC0415 - an extra

    few = type(DEFAULT_SETTINGS)(DEFAULT_SETTINGS, max_examples=20, derandomize=True, database=None)
    fuzz_controller(load("own_controller").Sway(("shoulder", "elbow"), ("elbow",)), few)
