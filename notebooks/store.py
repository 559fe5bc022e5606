"""Execute notebooks and store in them what they show: `make notebooks`, or `python notebooks/store.py [NOTEBOOK ...]`.

Without names, all of them. What would differ on another machine or day is left out: paths, times of cells, addresses of
objects, the state of widgets. Pictures are drawn in software. With `--check` the notebooks are executed, their outputs
are compared in kind with those that are stored, and nothing is written.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "notebooks"
KEY = "humanoid_sim"
"""Key of the notebook's metadata where `fingerprint` is kept."""
LIMIT = 300
"""s that a cell may take; `--limit` gives another."""
_FOLDERS = {"IPYTHONDIR": "ipython", "JUPYTER_RUNTIME_DIR": "runtime", "TMPDIR": "tmp", "MPLCONFIGDIR": "mpl"}
_SETTINGS = {"MPLBACKEND": "module://matplotlib_inline.backend_inline", "MUJOCO_GL": "disable", "COLUMNS": "100"}


def fingerprint(cells: Sequence[Mapping[str, Any]]) -> str:
    """Hash the code of a notebook's cells, which its outputs belong to."""
    code = "\0".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    return hashlib.sha256(code.encode()).hexdigest()


def kinds(cell: Mapping[str, Any]) -> list[str]:
    """Return what a code cell has put out: names of streams, and the best kind of each thing that it showed."""
    found = []
    for output in cell["outputs"]:
        names = [output["name"]] if output["output_type"] == "stream" else list(output.get("data", {"error": ""}))
        found.append(next((name for name in names if name.startswith("image/")), names[0]))
    return found


def execute(notebook: Any, folder: Path, limit: int) -> None:
    """Run a notebook from top to bottom in a kernel of its own; its files go to `folder`.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell failed.
    """
    for name in _FOLDERS.values():
        (folder / name).mkdir()
    os.environ.update({name: str(folder / place) for name, place in _FOLDERS.items()} | _SETTINGS)
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    os.environ["PYTHONPATH"] = os.pathsep.join(paths)  # this checkout, whatever is installed
    from nbclient import NotebookClient  # noqa: PLC0415 - reads the environment

    resources = {"metadata": {"path": str(folder)}}
    options = {"kernel_name": "python3", "record_timing": False, "coalesce_streams": True}
    NotebookClient(notebook, timeout=limit, resources=resources, **options).execute()


def tidy(notebook: Any, folder: Path, metadata: Mapping[str, Any]) -> None:
    """Leave out of the outputs what would differ on another machine or day."""
    import nbformat  # noqa: PLC0415 - an extra

    notebook.metadata = nbformat.from_dict({**metadata, KEY: {"outputs_of": fingerprint(notebook.cells)}})
    temporary = re.compile(re.escape(str(folder / _FOLDERS["TMPDIR"])) + r"/\w+/")
    for cell in (cell for cell in notebook.cells if cell.cell_type == "code"):
        cell.metadata = nbformat.from_dict({})
        for output in cell.outputs:
            output.get("data", {}).pop("application/vnd.jupyter.widget-view+json", None)
            for holder, name, text in list(_texts(output)):
                short = [_anonymous(line, temporary) for line in text.split("\n")]
                holder[name] = "\n".join(short)


def _anonymous(line: str, temporary: re.Pattern[str]) -> str:
    """A line without paths and addresses; the frame of a table stays where it is."""
    short = temporary.sub("", line).replace(f"{ROOT}/", "")
    short = re.sub(r"\bat 0x[0-9a-f]+", "at 0x…", short)
    return short[:-1].ljust(len(line) - 1) + "│" if line.endswith("│") else short.rstrip()


def _texts(output: Any) -> Iterator[tuple[Any, str, str]]:
    """Yield where an output has text: the mapping, the key, the text."""
    if "text" in output:
        yield output, "text", output.text
    for name, content in output.get("data", {}).items():
        if name.startswith("text/"):
            yield output.data, name, content


def compare(stored: Sequence[Any], now: Sequence[Any]) -> list[str]:
    """Return what cells put out now that is not of the kinds that are stored."""
    return [
        f"cell {i}: stored is {kinds(before)}, now {kinds(after)}"
        for i, (before, after) in enumerate(zip(stored, now, strict=True))
        if before.cell_type == "code" and kinds(before) != kinds(after)
    ]


def run(path: Path, *, limit: int, check: bool) -> list[str]:
    """Execute a notebook and store its outputs, or compare them; returns what is wrong."""
    import nbformat  # noqa: PLC0415 - an extra
    from nbclient.exceptions import CellExecutionError, CellTimeoutError  # noqa: PLC0415 - an extra

    stored = nbformat.read(path, as_version=4)
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory(prefix="notebook-") as name:
        folder = Path(name).resolve()
        try:
            execute(notebook, folder, limit)
        except (CellExecutionError, CellTimeoutError) as error:
            return [str(error)]
        tidy(notebook, folder, stored.metadata)
    if check:
        return compare(stored.cells, notebook.cells)
    temporary = path.with_suffix(".tmp")
    nbformat.write(notebook, temporary)
    temporary.replace(path)
    return []


def main() -> int:
    """Returns the exit status: 1 where a cell failed, or where outputs are of other kinds."""
    parser = argparse.ArgumentParser(description="Execute notebooks and store what they show.")
    parser.add_argument("notebooks", nargs="*", type=Path, help="default: all")
    parser.add_argument("--check", action="store_true", help="compare, and write nothing")
    parser.add_argument("--limit", type=int, default=LIMIT, help="seconds for a cell")
    options = parser.parse_args()
    paths = [path.resolve() for path in options.notebooks] or sorted(FOLDER.glob("*.ipynb"))
    wrong = False
    for path in paths:
        problems = run(path, limit=options.limit, check=options.check)
        wrong = wrong or bool(problems)
        for problem in problems:
            print(f"{path.name}: {problem}", file=sys.stderr)
        if not problems:
            print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB", flush=True)
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
