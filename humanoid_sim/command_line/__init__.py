"""The command lines of all programs: options from frozen dataclasses, help, and one line about what is wrong.

`tyro` reads the values; what a program takes is described once (`description`), and help and shell completion are made
from that. Nothing heavy is imported here: `--help` must be quick.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import sys
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from itertools import takewhile, zip_longest
from typing import Any, TypeVar, overload

from humanoid_sim.command_line.description import Commands, Program, Specification, describe, filled, name_of, typed
from humanoid_sim.errors import InputError, known_names

__all__ = ["Commands", "description_of", "parse"]

_Options = TypeVar("_Options")
_HELP = ("-h", "--help")
_MANY = 8
"""Options of a command beyond which a message does not list them."""
_only_described: ContextVar[bool] = ContextVar("_only_described", default=False)


class _DescribedError(Exception):
    """In the place of options, what a program takes."""

    def __init__(self, program: Program) -> None:
        super().__init__(program.invocation)
        self.program = program


@overload
def parse(
    specification: type[_Options], program: str, arguments: Sequence[str] | None, *, positional: bool = False
) -> _Options: ...


@overload
def parse(
    specification: Commands, program: str, arguments: Sequence[str] | None, *, positional: bool = False
) -> Any: ...


def parse(
    specification: Specification, program: str, arguments: Sequence[str] | None, *, positional: bool = False
) -> Any:
    """Read a program's options; prints the help or the commands if asked for, and ends with status 0.

    Args:
        specification: a frozen dataclass, or subcommands.
        program: the verb; of a script, its path; outside the package, its module (`tools.bench`).
        positional: required options are given by their place, not by name.

    Raises:
        InputError: naming what cannot be used.
        SystemExit: after help.
    """
    if _only_described.get():
        raise _DescribedError(describe(specification, (program,), positional=positional))
    words = list(sys.argv[1:] if arguments is None else arguments)
    place: tuple[str, ...] = (program,)
    while isinstance(specification, Commands) and words and words[0] not in _HELP:
        name = words.pop(0)
        if name not in specification.by_name:
            what = "option" if name.startswith("-") else "command"
            meant = ""
            if specification.for_file and (os.path.splitext(name)[1] or os.path.exists(name)):
                meant = f"; did you mean '{' '.join((*place, specification.for_file, name))}'?"
            raise InputError(f"{' '.join(place)}: {known_names(what, name, specification.by_name)}{meant}")
        specification, place = specification.by_name[name], (*place, name)
    is_asked = isinstance(specification, Commands) or any(word in _HELP for word in words)
    command = describe(specification, place, positional=positional, brief=is_asked and _HELP[1] not in words)
    if isinstance(specification, Commands) or is_asked:
        print(command.format_help(), end="")
        raise SystemExit(0)
    _check_names(command, words)
    return _read(specification, command, words, positional)


def description_of(program: Callable[[Sequence[str] | None], int]) -> Program | None:
    """Describe what a program takes; None for one that does not use `parse`."""
    token = _only_described.set(True)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            program(["--help"])
    except _DescribedError as described:
        return described.program
    except SystemExit:
        return None
    finally:
        _only_described.reset(token)
    return None


def _check_names(command: Program, words: Sequence[str]) -> None:
    """Refuse options and choices that do not exist, with the nearest ones that do.

    Raises `InputError` naming the first.
    """
    places = [option for option in command.options.values() if not option.option_strings]
    for option, word in zip(places, takewhile(lambda word: not word.startswith("-"), words), strict=False):
        if option.choices and word not in option.choices:
            raise InputError(f"{command.words[0]}: {known_names(option.dest, word, option.choices)}")
    options = command.flags
    for word, following in zip_longest(words, words[1:], fillvalue=""):
        if word == "--":
            return
        name, has_value, value = word.partition("=")
        given = options.get("-" + name[1:].replace("_", "-"))
        if given is None and word.startswith("--"):  # else a value, such as a negative number
            few = [flag for flag in options if flag.startswith("--")]
            listed = f"known: {', '.join(few)}; " if len(few) <= _MANY else ""
            says = "says what they do" if listed else "lists all"
            unknown = known_names("option", name, options, listed=False)
            raise InputError(f"{unknown}; {listed}'{command.invocation} --help' {says}")
        value = value if has_value else following
        if given is not None and given.choices and given.nargs is None and value not in ("", *given.choices):
            raise InputError(f"{name_of(given)}: {known_names('choice', value, given.choices)}")


def _read(specification: type[Any], command: Program, words: Sequence[str], positional: bool) -> Any:
    import tyro  # noqa: PLC0415 - help and completion do without it

    markers = [tyro.conf.FlagCreatePairsOff, *([tyro.conf.PositionalRequiredArgs] if positional else [])]
    complaint, columns = io.StringIO(), os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "10000"  # of its box, so that no word is cut
    try:
        # What tyro draws with depends on the encoding of stdout, to which it prints nothing.
        stdout = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
        with contextlib.redirect_stderr(complaint), contextlib.redirect_stdout(stdout):
            return tyro.cli(specification, prog=command.invocation, args=words, config=tuple(markers))
    except SystemExit as stop:
        if not stop.code:
            raise
        raise InputError(_told(complaint.getvalue(), command)) from None
    finally:
        if columns is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = columns


def _told(box: str, command: Program) -> str:
    """Return what tyro's box says, in one line."""
    said: list[str] = []
    for line in box.splitlines():
        text = line.strip(" │")
        if text.startswith("──"):  # a rule: below it are hints
            break
        if text and not text.startswith(("╭", "╰")):
            said.append(text)
    line = " ".join(" ".join(said).split()).rstrip(".")
    if line.startswith("Missing from "):
        missing = [option for option in command.options.values() if option.required and _is_named(option, line)]
        line = "missing: " + ", ".join(map(typed, missing))
    for pattern, ours in _OURS:
        line = pattern.sub(ours, line)
    return f"{line}; '{command.invocation} --help' says what is accepted"


def _is_named(option: argparse.Action, line: str) -> bool:
    if option.option_strings:
        return any(flag in line for flag in option.option_strings)
    return str(option.help).rstrip(".") in filled(line)


_OURS = tuple(
    (re.compile(pattern), ours)
    for pattern, ours in (
        (r"^Error parsing ", ""),
        (r"^Unrecognized options: ", "unexpected: "),
        (r"^Missing value for argument '(\S+)'.*$", r"\1: its value is missing"),
        (r"^(\S+): could not convert string to float: (.*)$", r"\1: is \2, expected a number"),
        (r"^(\S+): invalid literal for int\(\).*: (.*)$", r"\1: is \2, expected a whole number"),
        (r"^(\S+): no type matching \{None\}\|INT .* from \[(.*?)\].*$", r"\1: is \2, expected a whole number"),
        (r"^(\S+): no type matching \{None\}\|\w+ .* from \[(.*?)\].*$", r"\1: is \2, expected a number"),
    )
)
"""Replacements for tyro's most frequent complaints."""
