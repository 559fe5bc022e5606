"""`controllers/` is pure by what it calls; the linter has its imports, the fuzz that equal inputs give equal bits."""

import ast
from pathlib import Path

import pytest

import humanoid_sim.controllers

PACKAGE = Path(humanoid_sim.controllers.__file__).parent
PURE = [
    *sorted(PACKAGE.glob("**/*.py")),
    *(PACKAGE.parent / f"{name}.py" for name in ("mit", "messages", "errors")),
]
"""The functional core; a new file in `controllers/` belongs to it without being named here."""

FORBIDDEN_CALLS = {"open", "print", "input", "exec", "eval", "compile", "__import__", "globals", "id", "hash", "vars"}
FORBIDDEN_ATTRIBUTES = {
    "random", "linalg", "environ", "load", "save", "fromfile", "tofile", "memmap", "seterr", "einsum",
}  # fmt: skip


def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


@pytest.mark.parametrize("path", PURE, ids=lambda path: path.name)
def test_no_input_output_clock_chance_or_matrix_product(path):
    """Matrix products are summed in an order that depends on the shape: a batch would differ from its robots."""
    for node in ast.walk(tree(path)):
        where = f"{path.name}:{getattr(node, 'lineno', 0)}"
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in FORBIDDEN_CALLS, where
        if isinstance(node, ast.Attribute):
            assert node.attr not in FORBIDDEN_ATTRIBUTES, where
        assert not isinstance(node, ast.Global | ast.Nonlocal | ast.AsyncFunctionDef), where
        if isinstance(node, ast.BinOp | ast.AugAssign):
            assert not isinstance(node.op, ast.MatMult), where
