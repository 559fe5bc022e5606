"""The command lines of all programs: options from frozen dataclasses, help, and one line about what is wrong.

`tyro` reads the values; what a program takes is described once (`description`), and help (`help_page`) and shell
completion (`completion`) are made from that. Nothing heavy is imported here: `--help` must be quick.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextvars import ContextVar
from decimal import Decimal
from itertools import takewhile
from typing import Any, TypeVar, overload

from humanoid_sim.command_line.description import Command, Commands, Option, Specification, describe, filled
from humanoid_sim.errors import InputError, known_names

__all__ = ["Commands", "description_of", "parse"]

_Options = TypeVar("_Options")
_HELP = ("-h", "--help")
_MANY = 8
"""Options of a command beyond which a message does not list them."""
_only_described: ContextVar[bool] = ContextVar("_only_described", default=False)


class _DescribedError(Exception):
    """In the place of options, what a program takes."""

    def __init__(self, command: Command) -> None:
        super().__init__(command.invocation)
        self.command = command


@overload
def parse(
    specification: type[_Options],
    program: str,
    arguments: Sequence[str] | None,
    *,
    positional: bool = False,
) -> _Options: ...


@overload
def parse(
    specification: Commands,
    program: str,
    arguments: Sequence[str] | None,
    *,
    positional: bool = False,
) -> Any: ...


def parse(
    specification: Specification,
    program: str,
    arguments: Sequence[str] | None,
    *,
    positional: bool = False,
) -> Any:
    """A program's options; prints the help that is asked for, or the commands where none is, and ends with status 0.

    Args:
        specification: a frozen dataclass, or subcommands.
        program: the verb; of a script, its path; outside the package, its module (`tools.bench`).
        arguments: words; None for those that Python was started with.
        positional: required options are given by their place, not by name.

    Raises:
        InputError: naming what cannot be used.
        SystemExit: after help.
    """
    command = describe(specification, (program,), positional=positional)
    if _only_described.get():
        raise _DescribedError(command)
    words = list(sys.argv[1:] if arguments is None else arguments)
    while isinstance(specification, Commands):
        if not words or words[0] in _HELP:
            break
        name = words.pop(0)
        if name not in specification.by_name:
            what = "option" if name.startswith("-") else "command"
            meant = ""
            if specification.for_file and (os.path.splitext(name)[1] or os.path.exists(name)):
                meant = f"; did you mean '{' '.join((*command.words, specification.for_file, name))}'?"
            raise InputError(f"{' '.join(command.words)}: {known_names(what, name, specification.by_name)}{meant}")
        specification = specification.by_name[name]
        command = next(inner for inner in command.subcommands if inner.words[-1] == name)
    if isinstance(specification, Commands) or any(word in _HELP for word in words):
        from humanoid_sim.command_line.help_page import help_page  # noqa: PLC0415 - only where it is asked for

        print(help_page(command, brief=_HELP[1] not in words))
        raise SystemExit(0)
    _check_names(command, words, getattr(specification, "OF_ANOTHER_PROGRAM", {}))
    return _read(specification, command, words, positional)


def description_of(program: Callable[[Sequence[str] | None], int]) -> Command | None:
    """What a program takes; None for one that does not use `parse`."""
    token = _only_described.set(True)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            program(["--help"])
    except _DescribedError as described:
        return described.command
    except SystemExit:
        return None
    finally:
        _only_described.reset(token)
    return None


def _check_names(command: Command, words: Sequence[str], elsewhere: Mapping[str, str]) -> None:
    """Refuse options and choices that do not exist, with the nearest ones that do, and options that are given twice.

    `elsewhere` has options that people look for here, and what has them instead.

    Raises:
        InputError: naming the first.
    """
    places = [option for option in command.options if not option.flags]
    for option, word in zip(places, takewhile(lambda word: not word.startswith("-"), words), strict=False):
        if option.choices and word not in option.choices:
            raise InputError(f"{command.words[0]}: {known_names(option.field, word, option.choices)}")
    options = {flag: option for option in command.options for flag in option.flags}
    before: dict[str, str] = {}
    for i, word in enumerate(words):
        if word == "--":
            return
        if not word.startswith("-"):
            continue
        name, has_value, value = word.partition("=")
        given = options.get("-" + name[1:].replace("_", "-"))
        if given is None and not word.startswith("--"):  # a negative number
            continue
        if given is None and name in elsewhere:
            raise InputError(f"unknown option '{name}' ({elsewhere[name]})")
        if given is None:
            few = [flag for flag in options if flag.startswith("--")]
            listed = f"known: {', '.join(few)}; " if len(few) <= _MANY else ""
            says = "says what they do" if listed else "lists all"
            raise InputError(f"{_unknown_option(name, options)}; {listed}'{command.invocation} --help' {says}")
        if not has_value:
            value = words[i + 1] if i + 1 < len(words) else ""
        if given.choices and not given.takes_many and value not in ("", *given.choices):
            raise InputError(f"{given.name}: {known_names('choice', value, given.choices)}")
        if given.field in before and given.value and not given.may_repeat:
            more = ", followed by all its values" if given.takes_many else ""
            raise InputError(
                f"{given.name}: is given twice, as '{before[given.field]}' and '{value}', expected once{more}"
            )
        before[given.field] = value


def _unknown_option(name: str, options: Mapping[str, Option]) -> str:
    typed = name.replace("_", "-")
    called = next((option for option in options.values() if typed in option.not_called), None)
    if called is not None:
        return f"unknown option '{name}' (did you mean '{called.name}'?)"
    return known_names("option", name, options, listed=False)


def _with_whole_numbers(command: Command, words: Sequence[str]) -> list[str]:
    """The words, with whole numbers that are written as `2e6` in full."""
    whole = {flag for option in command.options if option.is_whole for flag in option.flags}
    written = list(words)
    for i, word in enumerate(words):
        flag, has_value, value = word.partition("=")
        if flag in whole and has_value:
            written[i] = f"{flag}={_in_full(value)}"
        elif i and words[i - 1] in whole:
            written[i] = _in_full(word)
    return written


def _in_full(text: str) -> str:
    if not _SHORT.fullmatch(text):
        return text
    number = Decimal(text)
    return f"{number:.0f}" if number == number.to_integral_value() else text


_SHORT = re.compile(r"[0-9]+(\.[0-9]+)?[eE]\+?[0-9]{1,2}")
"""A number that may be a whole one though `int` does not read it."""


def _read(specification: type[Any], command: Command, words: Sequence[str], positional: bool) -> Any:
    import tyro  # noqa: PLC0415 - help and completion do without it

    markers = [tyro.conf.FlagCreatePairsOff, *([tyro.conf.PositionalRequiredArgs] if positional else [])]
    complaint, columns = io.StringIO(), os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "10000"  # of its box, so that no word is cut
    try:
        # What tyro draws with depends on the encoding of stdout, to which it prints nothing.
        with contextlib.redirect_stderr(complaint), contextlib.redirect_stdout(_utf_8()):
            written = _with_whole_numbers(command, words)
            return tyro.cli(specification, prog=command.invocation, args=written, config=tuple(markers))
    except SystemExit as stop:
        if not stop.code:
            raise
        line, surplus = _told(complaint.getvalue(), command), getattr(specification, "SURPLUS", "")
        if surplus and line.startswith(_SURPLUS):
            line = f"{line.partition(';')[0]}; {surplus}"
        raise InputError(line) from None
    finally:
        if columns is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = columns


def _utf_8() -> io.TextIOWrapper:
    return io.TextIOWrapper(io.BytesIO(), encoding="utf-8")


def _told(box: str, command: Command) -> str:
    """What tyro's box says, in one line."""
    said: list[str] = []
    for line in box.splitlines():
        text = line.strip(" │")
        if text.startswith("──"):  # a rule: below it are hints
            break
        if text and not text.startswith(("╭", "╰")):
            said.append(text)
    line = " ".join(" ".join(said).split()).rstrip(".")
    if line.startswith("Missing from "):
        missing = [option for option in command.options if option.is_required and _is_named(option, line)]
        line = "missing: " + ", ".join(" ".join([*option.flags[:1], option.value]) for option in missing)
    for pattern, ours in _OURS:
        line = pattern.sub(ours, line)
    return f"{line}; '{command.invocation} --help' says what is accepted"


def _is_named(option: Option, line: str) -> bool:
    return option.flags[0] in line if option.flags else option.help in filled(line)


_SURPLUS = "unexpected: "
_OURS = tuple(
    (re.compile(pattern), ours)
    for pattern, ours in (
        (r"^Error parsing ", ""),
        (r"^Unrecognized options: ", _SURPLUS),
        (r"^Missing value for argument '(\S+)'.*$", r"\1: its value is missing"),
        (r"^(\S+): could not convert string to float: (.*)$", r"\1: is \2, expected a number"),
        (r"^(\S+): invalid literal for int\(\).*: (.*)$", r"\1: is \2, expected a whole number"),
        (r"^(\S+): no type matching \{None\}\|INT .* from \[(.*?)\].*$", r"\1: is \2, expected a whole number"),
        (r"^(\S+): no type matching \{None\}\|\w+ .* from \[(.*?)\].*$", r"\1: is \2, expected a number"),
    )
)
"""How its most frequent complaints are put here."""
