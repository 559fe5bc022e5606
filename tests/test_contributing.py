"""What CONTRIBUTING.md says about where things are is so."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| ([^|]+\?) \| (`[^|]+) \|$", PAGE, re.MULTILINE)


@pytest.mark.parametrize(("question", "answer"), ROWS, ids=[question for question, _ in ROWS])
def test_the_file_exists_and_holds_the_name(question, answer):
    file, name, *rest = re.findall(r"`([^`]+)`", answer)
    text = (ROOT / file).read_text(encoding="utf-8")
    assert re.search(rf"^\s*(def|class) {name}\b|^{name}\b.*=", text, re.MULTILINE), f"{file} defines no {name}"
    paths = [other for other in rest if "/" in other]
    assert [other for other in paths if not (ROOT / other).exists()] == []
