"""`controllers/` is pure: what it calls, and that the same inputs give the same bits; the linter has its imports."""

import ast
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rig import PATHS, Run, supervisor

import humanoid_sim.controllers
from humanoid_sim.testing.properties import fingerprint
from humanoid_sim.testing.strategies import any_tick_inputs

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


@given(st.sampled_from(sorted(PATHS)), any_tick_inputs(3, 20.0))
def test_two_stacks_agree_bit_for_bit(name, given_tick):
    """On anything, in every mode; and neither the input nor the memory is written."""
    outputs = []
    before = fingerprint(given_tick)
    for _ in range(2):
        run = Run(supervisor())
        run.walk(*PATHS[name])
        memory = fingerprint(run.memory)
        after, output = run.supervisor.step(run.memory, given_tick)
        assert fingerprint(run.memory) == memory
        outputs.append((fingerprint(after), fingerprint(output)))
    assert fingerprint(given_tick) == before
    assert outputs[0] == outputs[1]
