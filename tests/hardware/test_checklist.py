"""The list of docs/checklist.md: its commands exist."""

import re
import shlex
from pathlib import Path

import pytest
import tyro

from humanoid_sim import mode
from humanoid_sim.cli import load_program

_PAGE = (Path(__file__).parents[2] / "docs" / "checklist.md").read_text(encoding="utf-8")
_COMMANDS = re.findall(r"^ {4}python -m humanoid_sim\.(\w+) (.+)$", _PAGE, re.MULTILINE)


class _ParsedError(Exception):
    """Enough: the words were understood."""


def test_every_command_of_the_page_is_looked_at():
    assert len(_COMMANDS) == _PAGE.count("python -m") == 14


@pytest.mark.parametrize(("verb", "words"), _COMMANDS, ids=[f"{verb} {words}" for verb, words in _COMMANDS])
def test_a_command_is_understood(monkeypatch, verb, words):
    def then_stop(parse):
        def parse_only(*arguments, **options):
            parse(*arguments, **options)
            raise _ParsedError

        return parse_only

    monkeypatch.setattr(tyro, "cli", then_stop(tyro.cli))
    if verb == "mode":  # which starts without tyro
        monkeypatch.setattr(mode, "WORDS", ())
    with pytest.raises(_ParsedError):
        load_program(verb)(shlex.split(words))
