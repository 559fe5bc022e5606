"""Every message that docs/troubleshooting.md quotes is one that the program has."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
GAP = "…"
END = "\0"
"""Between two texts."""


def quoted(page):
    """The messages in the first column of the page's tables."""
    cells = re.findall(r"^\| (`.+?) \| ", page, re.MULTILINE)
    return [message for cell in cells for message in re.findall(r"`([^`]+)`", cell)]


def texts(source):
    """Every text in a module but docstrings, with a gap in the place of each value that is put into it."""
    waiting = [ast.parse(source)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else GAP for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        if not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
            waiting += ast.iter_child_nodes(node)


def says(text, message):
    """Whether a message is found in texts: its words in their order in one of them, with anything in its gaps."""
    words = [re.escape(part) for part in message.split(GAP)]
    return re.search(f"[^{END}]*".join(words), text) is not None


def everything():
    """All texts of the program."""
    folders = ("humanoid_sim", "controllers", "envs", "hardware")
    modules = (path for folder in folders for path in (ROOT / folder).rglob("*.py"))
    return END.join(dict.fromkeys(text for path in modules for text in texts(path.read_text(encoding="utf-8"))))


MESSAGES = quoted(PAGE)


@pytest.fixture(scope="module")
def program():
    return everything()


def test_the_page_quotes_messages_long_enough_to_be_found_once():
    assert len(MESSAGES) > 50
    assert [message for message in MESSAGES if len(message.replace(GAP, "").strip()) < 12] == []


@pytest.mark.parametrize("message", MESSAGES)
def test_the_program_says_so(message, program):
    assert says(program, message)


def test_a_message_that_no_program_has_is_noticed(program):
    assert not says(program, "the flux capacitor of … is …")


def test_texts_have_gaps_for_values_and_docstrings_are_none():
    found = list(texts('def f():\n    """A rate is wrong."""\n    g(f"{a}: is {b:g} s, " f"expected {c}", "or less")'))
    assert {"…: is … s, expected …", "or less"} <= set(found)
    assert "A rate is wrong." not in found
    assert says(END.join(found), "is … s, expected")
    assert not says(END.join(found), "expected …: is")
    assert not says(END.join(found), "expected … or less")
