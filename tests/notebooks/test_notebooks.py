"""What is stored in the notebooks is what their code shows; `tests/integration/test_notebooks.py` runs them."""

import ast
import importlib
import json
import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
LARGEST = 1_000_000
"""Bytes."""
SHOWING = {"print", "figure", "show", "Image"}
"""Functions by which a cell shows something."""
MACHINE = re.compile(r"/(work|tmp|home|root|var|Users)/|\b20\d\d-\d\d-\d\d\b")
"""Paths and dates."""

each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def cells(path, kind=None):
    everything = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in everything if kind is None or cell["cell_type"] == kind]


def source(cell):
    return "".join(cell["source"])


def shows(code):
    """Whether a cell puts something out: it ends with a value, or calls something that shows, outside of functions."""
    statements = ast.parse(code).body
    last = statements[-1]
    if isinstance(last, ast.Expr) and not isinstance(last.value, ast.Call):
        return True
    run = [statement for statement in statements if not isinstance(statement, ast.FunctionDef | ast.ClassDef)]
    calls = (node for statement in run for node in ast.walk(statement) if isinstance(node, ast.Call))
    return any(getattr(call.func, "id", getattr(call.func, "attr", "")) in SHOWING for call in calls)


def kinds(path):
    """Of everything that is stored in a notebook."""
    outputs = [output for cell in cells(path, "code") for output in cell["outputs"]]
    return {kind for output in outputs for kind in output.get("data", {})}


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("x = 1", False),
        ("x = 1\nx", True),
        ("fuzz(stack)", False),
        ("plt.show()", True),
        ("def f():\n    print(1)", False),
        ("try:\n    f()\nexcept ValueError as error:\n    print(error)", True),
    ],
)
def test_which_cells_show_something(code, expected):
    assert shows(code) is expected


@each
def test_every_cell_that_shows_something_has_its_output(path):
    code = cells(path, "code")
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1)), "run make notebooks"
    for cell in code:
        assert bool(cell["outputs"]) == shows(source(cell)), source(cell)
        assert cell["metadata"] == {}
        assert not [output for output in cell["outputs"] if output["output_type"] == "error"]
        assert not [output for output in cell["outputs"] if output.get("name") == "stderr"]


@each
def test_the_outputs_are_of_this_code(path, store):
    stored = json.loads(path.read_text(encoding="utf-8"))["metadata"]["humanoid_sim"]["outputs_of"]
    assert stored == store.fingerprint(cells(path)), f"{path.name}: its code has changed: run make notebooks"


@each
def test_nothing_stored_is_of_a_machine_or_large(path):
    assert path.stat().st_size < LARGEST
    for cell in cells(path):
        outputs = cell.get("outputs", [])
        texts = [
            text for output in outputs for text in (output.get("text", []), output.get("data", {}).get("text/plain"))
        ]
        for text in (source(cell), *map("".join, filter(None, texts))):
            assert MACHINE.search(text) is None, MACHINE.search(text)


def test_the_curves_are_there_to_see():
    by_number = {path.name[0]: kinds(path) for path in NOTEBOOKS}
    for number in "135":
        assert "image/png" in by_number[number]


@each
def test_a_notebook_says_what_it_is_about(path):
    first = cells(path)[0]
    assert first["cell_type"] == "markdown"
    assert source(first).startswith("# ")
    assert "pip install -c constraints.txt -e '.[notebooks" in source(first)
    document = json.loads(path.read_text(encoding="utf-8"))
    assert document["metadata"]["kernelspec"]["name"] == "python3"


@each
def test_what_a_notebook_links_to_exists(path):
    for cell in cells(path, "markdown"):
        for target in re.findall(r"\]\(([^)#]+)", source(cell)):
            assert (FOLDER / target).is_file(), target


@each
def test_what_a_notebook_imports_from_here_exists(path):
    code = "\n".join(source(cell) for cell in cells(path, "code"))
    imports = re.findall(r"^from (humanoid_sim\S*) import ([^#\n(]+)", code, re.MULTILINE)
    assert imports
    for module, names in imports:
        for name in names.split(","):
            assert hasattr(importlib.import_module(module), name.strip()), f"{module} has no {name.strip()}"
