"""Docstrings of functions and properties begin with a verb; ruff's D401 passes the question words."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NO_VERBS = {"How", "Of", "What", "When", "Where", "Which", "Who", "Whether", "Whose", "Why"}
FOLDERS = ("controllers", "docs", "envs", "examples", "hardware", "humanoid_sim", "notebooks", "tools")


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_docstring_of_a_function_begins_with_a_question_word(folder):
    heads = [
        (text.split(maxsplit=1)[0].strip(",.:;"), f"{path.relative_to(ROOT)}:{node.lineno}")
        for path in sorted((ROOT / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and (text := ast.get_docstring(node))
    ]
    assert [place for word, place in heads if word in NO_VERBS] == []
    assert heads
