"""Help of every program, as somebody with a terminal of 80 columns sees it, and its examples, which run."""

import dataclasses
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Sequence
from typing import ClassVar

import pytest
import tyro

from humanoid_sim import mode
from humanoid_sim.cli import VERBS, ExitStatus, load_program
from humanoid_sim.cli import main as start
from humanoid_sim.command_line import description_of
from humanoid_sim.command_line.description import STATUS_LINE, describe, name_of

OTHERS = {"ros2_services"}
"""Verbs that run in other environments, with the standard library's parser."""


def commands():
    def inner(command):
        yield command
        for one in command.commands.values():
            yield from inner(one)

    for verb in VERBS:
        described = description_of(load_program(verb))
        assert (described is None) == (verb in OTHERS)
        if described is not None:
            yield from inner(described)


COMMANDS = tuple(commands())
LEAVES = [command for command in COMMANDS if not command.commands]


def named(command):
    return " ".join(command.words)


FIRST = ("arguments", "most used")


def is_grouped(command):
    return "most used" in command.groups


@pytest.mark.parametrize("command", COMMANDS, ids=named)
def test_help_at_80_columns(command, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    for flag in ("--help", "-h"):
        with pytest.raises(SystemExit) as ended:
            start([*command.words, flag])
        assert ended.value.code == 0
        lines = capsys.readouterr().out.splitlines()
        assert [line for line in lines if len(line) > 80] == []
        assert lines[0].startswith(f"usage: python -m humanoid_sim.{named(command)}")
        assert lines[-1] == STATUS_LINE
        text = "\n".join(lines)
        assert re.search(r"None}|STR\b|FLOAT|\{\w+\}", text) is None
        shown = set(re.findall(r"^  (?:-\w, )?(--[\w.-]+)", text, re.MULTILINE))
        is_brief = flag == "-h" and is_grouped(command)
        fields = [name for title in command.groups if title in FIRST or not is_brief for name in command.groups[title]]
        assert shown == {name_of(option) for field in fields if (option := command.options[field]).option_strings}
        for name in command.commands:
            assert re.search(rf"^  {name}  +\w", text, re.MULTILINE)


@pytest.mark.parametrize("command", LEAVES, ids=named)
def test_every_option_is_in_one_group_and_says_something(command):
    assert sorted(name for names in command.groups.values() for name in names) == sorted(command.options)
    options = {name: option for name, option in command.options.items() if not name.startswith("joy.")}
    assert [name for name, option in options.items() if not option.help] == []
    assert not any(flag.startswith("--no-no") for flag in command.flags)


class _ParsedError(Exception):
    pass


def examples():
    for command in LEAVES:
        for line in command.examples.splitlines()[1::2]:
            yield named(command), line.strip().removeprefix(command.invocation)


@pytest.mark.parametrize(("command", "words"), list(examples()))
def test_an_example_is_understood(command, words, monkeypatch):
    real = tyro.cli

    def parse_only(*arguments, **options):
        raise _ParsedError(real(*arguments, **options))

    monkeypatch.setattr(tyro, "cli", parse_only)
    monkeypatch.setattr(mode, "_read_usual", lambda _: None)
    verb, *rest = command.split()
    with pytest.raises(_ParsedError) as parsed:
        load_program(verb)([*rest, *shlex.split(words)])
    assert dataclasses.is_dataclass(parsed.value.args[0])


def test_most_programs_have_examples_and_the_large_ones_groups():
    assert {command.words[0] for command in LEAVES if command.examples} >= set(VERBS) - OTHERS - {"training"}
    large = [command for command in LEAVES if len(command.options) > 20]
    assert {named(command) for command in large} >= {"play", "regress", "prepare"}
    assert [named(command) for command in large if len(command.groups) < 3] == []


def test_the_first_screen_of_play_fits_one(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    (play,) = [command for command in COMMANDS if named(command) == "play"]
    with pytest.raises(SystemExit):
        start(["play", "-h"])
    brief, whole = capsys.readouterr().out, play.format_help()
    assert len(brief.splitlines()) < 66 < len(whole.splitlines())
    assert "lite, lite_biped, lite_neck, " in " ".join(brief.split())
    assert "robot_descriptions:" in brief
    assert "--help lists all" in brief
    assert "--host-id" not in brief
    assert "--host-id" in whole
    assert whole.count("--no-gamepad") == 1
    assert "--no-console" not in whole


def test_the_options_are_those_that_the_parser_knows():
    """What is described and what is read are made of one dataclass, in two ways."""
    from humanoid_sim.gamepad import GamepadConfig  # noqa: PLC0415
    from humanoid_sim.hardware.tools.options import Budget, Emulate, Set  # noqa: PLC0415
    from humanoid_sim.play.options import PlayConfig  # noqa: PLC0415
    from humanoid_sim.prepare import PrepareOptions  # noqa: PLC0415

    for owner in (PlayConfig, PrepareOptions, Budget, Emulate, Set, GamepadConfig):
        with pytest.warns(DeprecationWarning, match="get_parser"):  # there is no other way to see what tyro reads
            parser = tyro.extras.get_parser(owner, config=(tyro.conf.FlagCreatePairsOff,))
        read = {flag for action in parser._actions for flag in action.option_strings} - {"-h", "--help"}
        described = describe(owner, ("x",))
        assert set(described.flags) == read
        unnamed = [action for action in parser._actions if not action.option_strings]
        assert len(unnamed) == len([option for option in described.options.values() if not option.option_strings])


def test_the_line_of_exit_statuses_is_that_of_the_programs():
    assert [int(number) for number in re.findall(r"\b(\d+) ", STATUS_LINE)] == [int(status) for status in ExitStatus]


@dataclasses.dataclass(frozen=True)
class _Sample:
    """Do something.

    And more of it.
    """

    where: str
    """The place."""
    often: int = 3
    """How often"""
    quietly: bool = False
    """Without noise."""
    loudly: bool = True
    """Make noise."""
    many: tuple[float, ...] = (1.0, 0.5)
    """Numbers."""
    EXAMPLES: ClassVar[Sequence[tuple[str, str]]] = (("--where here", "once"),)


def test_a_page_literally(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    assert (
        describe(_Sample, ("play",)).format_help()
        == f"""\
usage: python -m humanoid_sim.play --where WHERE [options]

Do something.

And more of it.

options:
  --where WHERE  The place. Required.
  --often N      How often. Default: 3.
  --quietly      Without noise.
  --no-loudly    Do not make noise.
  --many X ...   Numbers. Default: 1 0.5.

examples:
  # once
  python -m humanoid_sim.play --where here

{STATUS_LINE}
"""
    )


def test_help_needs_no_parser():
    code = (
        "import sys\nfrom humanoid_sim.replay import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
        "print(*sorted({'tyro'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env={**os.environ})
    assert run.stdout.splitlines()[-1] == ""
