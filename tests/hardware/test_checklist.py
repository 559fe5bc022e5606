"""The list of docs/checklist.md: its commands exist, and on emulated motors they print what it says."""

import io
import re
import shlex
from pathlib import Path

import pytest
import tyro

from humanoid_sim import mode
from humanoid_sim.cli import load_program, run_program
from humanoid_sim.hardware.mock.server import MockServer
from humanoid_sim.robots.description import load_robot

_PAGE = (Path(__file__).parents[2] / "docs" / "checklist.md").read_text(encoding="utf-8")
_STEPS = [step.split("\n## ")[0] for step in _PAGE.split("\n- [ ] ")[1:]]
_COMMAND = re.compile(r"^ {4}python -m humanoid_sim\.(\w+) (.+)$", re.MULTILINE)
_COMMANDS = [match for step in _STEPS for match in _COMMAND.findall(step)]
_CHANNEL = "virtual:checklist"


class _ParsedError(Exception):
    """Enough: the words were understood."""


def test_every_command_of_the_page_is_looked_at():
    assert len(_STEPS) == 14
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


def _step(title):
    """Verb, words and the expected readings of the step with this title, on emulated motors."""
    (step,) = [step for step in _STEPS if step.startswith(f"**{title}")]
    verb, words = _COMMAND.findall(step)[0]
    (expected,) = re.findall(r"\*Expect (.*?)\*", step, re.DOTALL)
    readings = [reading for reading in re.findall(r"`([^`]+)`", expected) if reading != "missing"]
    replaced = words.replace("can_left,can_right", _CHANNEL).replace("can_left", _CHANNEL)
    return verb, shlex.split(replaced), readings


@pytest.fixture
def run(capsys):
    def run_step(title):
        verb, words, readings = _step(title)
        status = run_program(load_program(verb), words)
        return status, "".join(capsys.readouterr()), readings

    return run_step


@pytest.fixture(scope="module")
def motors():
    with MockServer(load_robot("lite"), [_CHANNEL]) as motors:
        yield motors


@pytest.mark.soak
@pytest.mark.usefixtures("motors")
@pytest.mark.parametrize("title", ["Who is there", "One motor's answers", "Directions"])
def test_a_tool_prints_what_the_list_expects(run, monkeypatch, title):
    terminal = io.StringIO("yes\n")
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr("sys.stdin", terminal)
    status, printed, readings = run(title)
    assert status == 0
    assert readings
    assert [reading for reading in readings if reading not in printed] == []
    assert "missing" not in printed or title != "Who is there"
