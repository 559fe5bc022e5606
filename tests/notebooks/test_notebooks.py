"""The notebooks run from top to bottom within five minutes each, and hold no outputs."""

from __future__ import annotations

import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
LIMIT = 300
"""s, of one notebook on two cores."""


def cells(path: Path) -> list[dict]:
    return json.loads(path.read_text(encoding="utf-8"))["cells"]


def source(cell: dict) -> str:
    return "".join(cell["source"])


def test_there_are_four():
    assert [path.name[0] for path in NOTEBOOKS] == ["1", "2", "3", "4"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_no_outputs_are_stored(path):
    code = [cell for cell in cells(path) if cell["cell_type"] == "code"]
    assert code
    for cell in code:
        assert cell["outputs"] == []
        assert cell["execution_count"] is None
        assert cell["metadata"] == {}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_says_what_it_is_about(path):
    first = cells(path)[0]
    assert first["cell_type"] == "markdown"
    assert source(first).startswith("# ")
    assert "pip install 'humanoid_sim[notebooks" in source(first)
    document = json.loads(path.read_text(encoding="utf-8"))
    assert document["metadata"]["kernelspec"]["name"] == "python3"
    assert not re.search(r"/(home|root|work)/", path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_a_notebook_imports_from_here_exists(path):
    code = "\n".join(source(cell) for cell in cells(path) if cell["cell_type"] == "code")
    imports = re.findall(r"^from (humanoid_sim\S*) import ([^#\n(]+)", code, re.MULTILINE)
    assert imports
    for module, names in imports:
        for name in names.split(","):
            assert hasattr(importlib.import_module(module), name.strip()), f"{module} has no {name.strip()}"


@pytest.mark.slow
@pytest.mark.timeout(LIMIT + 60)
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path):
    for package in ("nbclient", "ipykernel", "matplotlib", "torch"):
        pytest.importorskip(package)
    settings = {"IPYTHONDIR": "ipython", "JUPYTER_RUNTIME_DIR": "runtime", "TMPDIR": "tmp", "MPLCONFIGDIR": "mpl"}
    for name in settings.values():
        (tmp_path / name).mkdir()
    environ = {**os.environ, **{name: str(tmp_path / folder) for name, folder in settings.items()}}
    environ["MPLBACKEND"] = "module://matplotlib_inline.backend_inline"
    program = [sys.executable, str(Path(__file__).with_name("execute.py")), str(path), str(LIMIT)]
    done = subprocess.run(
        program, cwd=tmp_path, env=environ, capture_output=True, text=True, timeout=LIMIT, check=False
    )
    assert done.returncode == 0, done.stderr[-4000:]
    assert done.stdout.startswith(str(sum(cell["cell_type"] == "code" for cell in cells(path))))
