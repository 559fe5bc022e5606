"""What CONTRIBUTING.md says about where things are is so."""

import re
from pathlib import Path

import pytest

from humanoid_sim.cli import VERBS

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| ([^|]+\?) \| (`[^|]+) \|$", PAGE, re.MULTILINE)


def test_every_question_has_an_answer():
    assert 16 < len(ROWS) == PAGE.count("? |") <= 30, "only what names cannot say"


@pytest.mark.parametrize(("question", "answer"), ROWS, ids=[question for question, _ in ROWS])
def test_the_file_exists_and_holds_the_name(question, answer):
    file, name, *rest = re.findall(r"`([^`]+)`", answer)
    text = (ROOT / file).read_text(encoding="utf-8")
    assert re.search(rf"^\s*(def|class) {name}\b|^{name}\b.*=", text, re.MULTILINE), f"{file} defines no {name}"
    paths = [other for other in rest if "/" in other]
    assert [other for other in paths if not (ROOT / other).exists()] == []


def test_every_part_of_the_package_is_in_the_table_of_the_layout():
    table = PAGE[PAGE.index("| part |") :]
    named = {name.removeprefix("humanoid_sim/").rstrip("/") for name in re.findall(r"`([\w/.]+)`", table)}
    package = ROOT / "humanoid_sim"
    parts = {path.name for path in package.iterdir() if path.name != "assets" and not path.name.startswith("_")}
    modules = {name for name in parts if (package / name).is_dir() or name.endswith(".py")}
    assert named >= {name for name in modules if name.removesuffix(".py") not in VERBS}
    assert [name for name in named if not (package / name).exists()] == []
