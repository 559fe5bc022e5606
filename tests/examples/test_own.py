"""The examples run as they stand, and their options are read and explained as the programs' are."""

import ast
import runpy
import sys
from pathlib import Path

import pytest
from script_files import load_script

from humanoid_sim.testing import DEFAULT_SETTINGS, fuzz_controller

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def own_controller():
    return load_script(EXAMPLES / "own_controller.py")


def test_a_controller_of_ones_own_drives_the_robot(own_controller, capsys):
    own_controller.main()
    *modes, swayed = capsys.readouterr().out.splitlines()
    assert [line.split()[2] for line in modes] == ["DAMPING", "STANDBY", "LOCOMOTION", "DAMPING"]
    low, high = (float(word) for word in swayed.split()[3:6:2])
    assert high - low == pytest.approx(0.4, abs=0.05)


def test_the_controller_stands_what_the_fuzzer_does_to_it(own_controller):
    few = type(DEFAULT_SETTINGS)(DEFAULT_SETTINGS, max_examples=20, derandomize=True, database=None)
    fuzz_controller(own_controller.Sway(("shoulder", "elbow"), ("elbow",)), few)


def test_help_and_a_mistyped_option(monkeypatch, capsys):
    def run(word):
        monkeypatch.setattr(sys, "argv", ["gravity_compensation.py", word])
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(str(EXAMPLES / "gravity_compensation.py"), run_name="__main__")
        return ended.value.code, *capsys.readouterr()

    status, described, _ = run("--help")
    assert status == 0
    assert described.startswith("usage: python examples/gravity_compensation.py ")
    assert "--form {effort,pd}" in described
    status, _, refused = run("--frm")
    assert status == 2
    assert refused.startswith("error: Unrecognized options: --frm; Perhaps you meant: --form ")


def test_the_recorder_of_mjlab_needs_nothing_but_what_mjlab_has():
    """It is copied to where mjlab is, and this package is not."""
    needed = set()
    for node in ast.walk(ast.parse((EXAMPLES / "mjlab_trace.py").read_text(encoding="utf-8"))):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
        needed |= {name.partition(".")[0] for name in names}
    assert needed - sys.stdlib_module_names == {"mjlab", "mujoco", "numpy"}
