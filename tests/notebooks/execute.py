"""Execute a notebook in a kernel of its own, and fail with the cell that failed: `python execute.py NOTEBOOK SECONDS`.

A program, not a helper: the kernel's client leaves threads and sockets to be collected later, which the tests' check
for leaks would see.
"""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError


def main() -> int:
    path, seconds = Path(sys.argv[1]), int(sys.argv[2])
    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(notebook, timeout=seconds, kernel_name="python3", resources={"metadata": {"path": "."}})
    try:
        client.execute()
    except CellExecutionError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{sum(cell.cell_type == 'code' for cell in notebook.cells)} cells")
    return 0


if __name__ == "__main__":
    sys.exit(main())
