"""The examples' options are read and explained as the programs' are."""

import ast
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize(
    ("name", "package", "option"),
    [("gravity_compensation", "humanoid_sim", "--form effort|pd"), ("growing_harder", "stable_baselines3", "--envs N")],
)
def test_help_and_a_mistyped_option(name, package, option):
    if find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    typed = f"python examples/{name}.py"
    described = subprocess.run(
        [sys.executable, f"{EXAMPLES / name}.py", "--help"], capture_output=True, text=True, check=True
    )
    assert described.stdout.startswith(f"usage: {typed} [options]\n\n")
    assert f"\n  {option}" in described.stdout
    refused = subprocess.run(
        [sys.executable, f"{EXAMPLES / name}.py", "--xyz"], capture_output=True, text=True, check=False
    )
    assert refused.returncode == 2
    assert refused.stderr.startswith("error: unknown option '--xyz'; known: --")
    assert f" {option.split(maxsplit=1)[0]}" in refused.stderr
    assert refused.stderr.endswith(f"; '{typed} --help' says what they do\n")


def test_the_recorder_of_mjlab_needs_nothing_but_mjlab_and_numpy():
    """It is copied to where mjlab is, and this package is not."""
    needed = set()
    for node in ast.walk(ast.parse((EXAMPLES / "mjlab_trace.py").read_text(encoding="utf-8"))):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
        needed |= {name.partition(".")[0] for name in names}
    assert needed - sys.stdlib_module_names == {"mjlab", "numpy"}
