"""What is stored in the notebooks is what their code shows; `tests/integration/test_notebooks.py` runs them."""

import json
import re
from pathlib import Path

import pytest
from script_files import load_script

FOLDER = Path(__file__).parents[2] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
LARGEST = 1_000_000
"""Bytes."""
MACHINE = re.compile(r"/(work|tmp|home|root|var|Users)/|\b20\d\d-\d\d-\d\d\b")
"""Paths and dates."""

each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def read(path):
    """The document, its cells of code, and their outputs."""
    document = json.loads(path.read_text(encoding="utf-8"))
    code = [cell for cell in document["cells"] if cell["cell_type"] == "code"]
    return document, code, [output for cell in code for output in cell["outputs"]]


def source(cell):
    return "".join(cell["source"])


@each
def test_the_outputs_are_of_this_code_run_from_top_to_bottom(path):
    document, code, outputs = read(path)
    found = load_script(FOLDER / "store.py").fingerprint(document["cells"])
    assert document["metadata"]["humanoid_sim"]["outputs_of"] == found, "its code has changed: run make notebooks"
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1)), "run make notebooks"
    assert len(outputs) >= len(code) // 2
    assert not [output for output in outputs if output["output_type"] == "error" or output.get("name") == "stderr"]


@each
def test_nothing_stored_is_of_a_machine_or_large(path):
    assert path.stat().st_size < LARGEST
    document, _, outputs = read(path)
    shown = [text for output in outputs for text in (output.get("text"), output.get("data", {}).get("text/plain"))]
    for text in (*map(source, document["cells"]), *map("".join, filter(None, shown))):
        assert MACHINE.search(text) is None, MACHINE.search(text)


@each
def test_a_notebook_says_what_it_is_about_and_links_to_what_exists(path):
    document, _, outputs = read(path)
    first, *_ = document["cells"]
    assert source(first).startswith("# ")
    assert "pip install -c constraints.txt -e '.[notebooks" in source(first)
    assert document["metadata"]["kernelspec"]["name"] == "python3"
    if path.name[0] in "135":
        assert any("image/png" in output.get("data", {}) for output in outputs), "its curves"
    for cell in document["cells"]:
        for target in re.findall(r"\]\(([^)#]+)", source(cell)) if cell["cell_type"] == "markdown" else ():
            assert (FOLDER / target).is_file(), target
