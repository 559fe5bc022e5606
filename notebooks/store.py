"""Execute notebooks and store what they show: `make notebooks`, or `python notebooks/store.py [--check] [FILE ...]`.

With `--check` nothing is written. What belongs to a machine or a day is left out: paths, times of cells, widgets.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
LIMIT = 300  # s for a cell
SETTINGS = {"MPLBACKEND": "module://matplotlib_inline.backend_inline", "MUJOCO_GL": "disable", "COLUMNS": "100"}


def fingerprint(cells: Sequence[Mapping[str, Any]]) -> str:
    """Hash the code of a notebook's cells, which its outputs belong to."""
    code = "\0".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    return hashlib.sha256(code.encode()).hexdigest()


def execute(notebook: Any, folder: Path) -> None:
    """Run a notebook from top to bottom; its files go to `folder`. Raises `CellExecutionError` where a cell fails."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    os.environ.update(SETTINGS, PYTHONPATH=os.pathsep.join(paths), IPYTHONDIR=str(folder), TMPDIR=str(folder))
    from nbclient import NotebookClient  # noqa: PLC0415 - reads the environment

    resources = {"metadata": {"path": str(folder)}}
    options = {"kernel_name": "python3", "record_timing": False, "coalesce_streams": True}
    NotebookClient(notebook, timeout=LIMIT, resources=resources, **options).execute()


def tidy(notebook: Any, folder: Path, metadata: Mapping[str, Any]) -> None:
    """Leave out of the outputs what would differ on another machine or day."""
    import nbformat  # noqa: PLC0415 - an extra

    notebook.metadata = nbformat.from_dict({**metadata, "humanoid_sim": {"outputs_of": fingerprint(notebook.cells)}})
    machine = re.compile(f"{re.escape(str(folder))}/(\\w+/)?|{re.escape(str(ROOT))}/")
    for cell in notebook.cells:
        cell.metadata = nbformat.from_dict({})
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            data.pop("application/vnd.jupyter.widget-view+json", None)
            for holder, name in ((output, "text"), (data, "text/plain"), (data, "text/html")):
                if name in holder:
                    holder[name] = machine.sub("", holder[name])


def main(arguments: Sequence[str]) -> None:
    """Execute the notebooks named, or all."""
    import nbformat  # noqa: PLC0415 - an extra

    names = [name for name in arguments if name != "--check"]
    for path in map(Path, names or sorted(str(path) for path in ROOT.glob("notebooks/*.ipynb"))):
        notebook = nbformat.read(path, as_version=4)
        metadata = dict(notebook.metadata)
        with tempfile.TemporaryDirectory() as folder:
            execute(notebook, Path(folder).resolve())
            tidy(notebook, Path(folder).resolve(), metadata)
        if "--check" not in arguments:
            nbformat.write(notebook, path)
        print(path.name, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
