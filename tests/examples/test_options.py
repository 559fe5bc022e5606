"""The examples' options are read and explained as the programs' are."""

import ast
import runpy
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_help_and_a_mistyped_option(monkeypatch, capsys):
    name = "gravity_compensation"
    typed = f"python examples/{name}.py"

    def run(word):
        monkeypatch.setattr(sys, "argv", [f"{name}.py", word])
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
        return ended.value.code, *capsys.readouterr()

    status, described, _ = run("--help")
    assert status == 0
    assert described.startswith(f"usage: {typed} ")
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
