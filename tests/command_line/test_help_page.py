"""Help of every program, as somebody with a terminal of 80 columns sees it, and its examples, which run."""

from __future__ import annotations

import dataclasses
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

import pytest
import tyro

from humanoid_sim import mode
from humanoid_sim.cli import VERBS, ExitStatus, load_program
from humanoid_sim.cli import main as start
from humanoid_sim.command_line import description_of
from humanoid_sim.command_line.description import Command, describe
from humanoid_sim.command_line.help_page import STATUS_LINE, help_page

OTHERS = {"ros2_services"}
"""Verbs that run in other environments, with the standard library's parser."""


def commands() -> Iterator[Command]:
    def inner(command: Command) -> Iterator[Command]:
        yield command
        for one in command.subcommands:
            yield from inner(one)

    for verb in VERBS:
        described = description_of(load_program(verb))
        assert (described is None) == (verb in OTHERS)
        if described is not None:
            yield from inner(described)


COMMANDS = tuple(commands())
LEAVES = [command for command in COMMANDS if not command.subcommands]


def named(command: Command) -> str:
    return " ".join(command.words)


FIRST = ("arguments", "most used")


def is_grouped(command: Command) -> bool:
    return any(title == "most used" for title, _ in command.groups)


@pytest.mark.parametrize("command", COMMANDS, ids=named)
def test_help_at_80_columns(command: Command, capsys: pytest.CaptureFixture[str], monkeypatch: Any) -> None:
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
        groups = (
            [g for g in command.groups if g[0] in FIRST] if flag == "-h" and is_grouped(command) else command.groups
        )
        flags = [option.flags for _, held in groups for option in held if option.flags]
        flags = [next(name for name in names if name.startswith("--")) for names in flags]
        assert shown == set(flags)
        for inner in command.subcommands:
            assert re.search(rf"^  {inner.words[-1]}  +\w", text, re.MULTILINE)


@pytest.mark.parametrize("command", LEAVES, ids=named)
def test_every_option_is_in_one_group_and_says_something(command: Command) -> None:
    fields = [option.field for option in command.options]
    assert len(fields) == len(set(fields))
    assert [name for name in fields if name.startswith("joy.") is False and not by_field(command)[name].help] == []
    assert not any(option.flags and option.flags[0].startswith("--no-no") for option in command.options)


def by_field(command: Command) -> dict[str, Any]:
    return {option.field: option for option in command.options}


class _ParsedError(Exception):
    pass


def examples() -> Iterator[tuple[str, str]]:
    for command in LEAVES:
        for words, _ in command.examples:
            yield named(command), words


@pytest.mark.parametrize(("command", "words"), list(examples()))
def test_an_example_is_understood(command: str, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real = tyro.cli

    def parse_only(*arguments: Any, **options: Any) -> None:
        raise _ParsedError(real(*arguments, **options))

    monkeypatch.setattr(tyro, "cli", parse_only)
    monkeypatch.setattr(mode, "_read_usual", lambda _: None)
    verb, *rest = command.split()
    with pytest.raises(_ParsedError) as parsed:
        load_program(verb)([*rest, *shlex.split(words)])
    assert dataclasses.is_dataclass(parsed.value.args[0])


def test_most_programs_have_examples_and_the_large_ones_groups() -> None:
    assert {command.words[0] for command in LEAVES if command.examples} >= set(VERBS) - OTHERS - {"training"}
    large = [command for command in LEAVES if len(command.options) > 20]
    assert {named(command) for command in large} >= {"play", "regress", "prepare"}
    assert [named(command) for command in large if len(command.groups) < 3] == []


def test_the_first_screen_of_play_fits_one(capsys: pytest.CaptureFixture[str]) -> None:
    (play,) = [command for command in COMMANDS if named(command) == "play"]
    brief, whole = help_page(play, brief=True, width=80), help_page(play, width=80)
    assert len(brief.splitlines()) < 66 < len(whole.splitlines())
    assert "lite, lite_biped, lite_neck, " in " ".join(brief.split())
    assert "robot_descriptions:" in brief
    assert "--help lists all" in brief
    assert "--host-id" not in brief
    assert "--host-id" in whole
    assert whole.count("--no-gamepad") == 1
    assert "--no-console" not in whole


def test_the_options_are_those_that_the_parser_knows() -> None:
    """What is described and what is read are made of one dataclass, in two ways."""
    from humanoid_sim.frontends.gamepad.program import GamepadConfig  # noqa: PLC0415
    from humanoid_sim.hardware.tools.options import Budget, Emulate, Set  # noqa: PLC0415
    from humanoid_sim.play.options import PlayConfig  # noqa: PLC0415
    from humanoid_sim.prepare import PrepareOptions  # noqa: PLC0415

    for owner in (PlayConfig, PrepareOptions, Budget, Emulate, Set, GamepadConfig):
        with pytest.warns(DeprecationWarning, match="get_parser"):  # there is no other way to see what tyro reads
            parser = tyro.extras.get_parser(owner, config=(tyro.conf.FlagCreatePairsOff,))
        read = {flag for action in parser._actions for flag in action.option_strings} - {"-h", "--help"}
        described = describe(owner, ("x",))
        assert {flag for option in described.options for flag in option.flags} == read
        unnamed = [action for action in parser._actions if not action.option_strings]
        assert len(unnamed) == len([option for option in described.options if not option.flags])


def test_the_line_of_exit_statuses_is_that_of_the_programs() -> None:
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


def test_a_page_literally() -> None:
    assert (
        help_page(describe(_Sample, ("play",)), width=80)
        == f"""\
usage: python -m humanoid_sim.play --where WHERE [options]

Do something.

And more of it.

options:
  --where WHERE           The place. Required.
  --often N               How often. Default: 3.
  --quietly               Without noise.
  --no-loudly             Do not make noise.
  --many X ...            Numbers. Default: 1 0.5.

examples:
  # once
  python -m humanoid_sim.play --where here

{STATUS_LINE}"""
    )


def test_help_needs_no_parser() -> None:
    code = (
        "import sys\nfrom humanoid_sim.replay import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
        "print(*sorted({'tyro'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env={**os.environ})
    assert run.stdout.splitlines()[-1] == ""
