"""Extras install nothing that nothing imports, and everything that is imported is installed by something."""

import ast
import re
import tomllib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
FOLDERS = ("humanoid_sim", "controllers", "envs", "hardware", "tools", "examples", "tests", "notebooks")

MODULES = {
    "cyclonedds": "cyclonedds",
    "foxglove-sdk": "foxglove",
    "import-linter": "importlinter",
    "minari": "minari",
    "pillow": "PIL",
    "pygame-ce": "pygame",
    "pyserial": "serial",
    "python-can": "can",
    "python-rtmidi": "rtmidi",
    "pyyaml": "yaml",
    "rerun-sdk": "rerun",
    "rsl-rl-lib": "rsl_rl",
}
"""Import names that are not the package's own with underscores."""
NOT_IMPORTED = {
    "plotly": "a file of it is served",
    "ipykernel": "notebooks run in it",
    "mermaidx": "the site's pictures",
    "mkdocstrings-python": "the site's reference",
    "zensical": "the site",
    "mypy": "a program",
    "pytest-timeout": "a plugin",
    "pytest-xdist": "a plugin",
    "ruff": "a program",
    "setuptools": "builds the wheel",
    "types-pyyaml": "types",
    "moviepy": "Gymnasium imports it for RecordVideo",
}
"""What is needed all the same, and why."""


def packages():
    """Where each is required, and its name."""
    found = []
    for extra, lines in (("", PROJECT["dependencies"]), *PROJECT["optional-dependencies"].items()):
        names = (re.match(r"[\w.-]+", line) for line in lines)
        found += [(extra, name[0].lower().replace("_", "-")) for name in names if name is not None]
    return [(extra, name) for extra, name in found if name != "humanoid-sim"]


def module_of(package):
    return MODULES.get(package, package.replace("-", "_"))


@cache
def imported():
    """The first names of modules that the project's Python files import, also where it is by a text: all that count."""
    names, wanted = set(), {module_of(package) for _, package in packages()}
    for file in (file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        if not re.search(rf"(?:import|from)[^\n]*\b(?:{'|'.join(wanted - names)})\b", text):  # nothing still sought
            continue
        for node in ast.walk(ast.parse(text)):
            match node:
                case ast.Import(names=aliases):
                    names |= {alias.name.partition(".")[0] for alias in aliases}
                case ast.ImportFrom(module=str(module), level=0):
                    names.add(module.partition(".")[0])
                case ast.Call(args=[ast.Constant(value=str(module)), *_]) if _imports(node.func):
                    names.add(module.partition(".")[0])
    return frozenset(names)


def _imports(function):
    name = str(getattr(function, "attr", getattr(function, "id", "")))
    return name.endswith(("import_module", "importorskip", "import_lerobot", "__import__"))


@pytest.mark.parametrize(("extra", "package"), packages())
def test_what_is_installed_is_imported(extra, package):
    assert (module_of(package) in imported()) != (package in NOT_IMPORTED), f"{extra or 'always'}: {package}"


def test_every_table_row_is_of_a_package():
    known = {package for _, package in packages()}
    assert {*MODULES, *NOT_IMPORTED} <= known
