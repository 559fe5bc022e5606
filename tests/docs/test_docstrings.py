"""A docstring begins with a verb or a noun; ruff's D401 passes the question words."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
QUESTIONS = {"How", "Of", "What", "When", "Where", "Which", "Who", "Whether", "Whose", "Why"}
_BODIES = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
FOLDERS = ("controllers", "docs", "envs", "examples", "hardware", "humanoid_sim", "notebooks", "tools")


def texts(tree: ast.Module) -> Iterator[ast.Constant]:
    """The docstrings of everything but the module, those of attributes included."""
    for node in ast.walk(tree):
        body = node.body[isinstance(node, ast.Module) :] if isinstance(node, _BODIES) else ()
        expressions = (statement.value for statement in body if isinstance(statement, ast.Expr))
        yield from (text for text in expressions if isinstance(text, ast.Constant) and isinstance(text.value, str))


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_docstring_begins_with_a_question_word(folder):
    heads = [
        (str(text.value).split(maxsplit=1)[0].strip(",.:;"), f"{path.relative_to(ROOT)}:{text.lineno}")
        for path in sorted((ROOT / folder).rglob("*.py"))
        for text in texts(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert [place for word, place in heads if word in QUESTIONS] == []
    assert heads
