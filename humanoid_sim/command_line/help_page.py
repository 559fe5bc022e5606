"""A program's help, for a terminal: what it is for, its options in groups, examples, exit statuses."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Iterator

from humanoid_sim.command_line.description import ARGUMENTS, Command, Option

__all__ = ["STATUS_LINE", "help_page", "usage"]

STATUS_LINE = "exit status: 0 fine, 1 failed or worse, 2 bad input, 3 no answer, 130 Ctrl-C"
"""`humanoid_sim.cli.ExitStatus` in a line; docs/exit-statuses.md explains it."""
_WIDEST = 100
"""Columns; longer lines are hard to read."""
_TEXT_AT = 26
"""Column in which the texts of options begin."""


def help_page(command: Command, *, brief: bool = False, width: int | None = None) -> str:
    """The help of a program or subcommand.

    Args:
        command: whose.
        brief: only the first group of options, which most people need.
        width: columns; default: the terminal's.
    """
    width = min(width or shutil.get_terminal_size().columns, _WIDEST)
    return "\n".join(_lines(command, brief, width))


def usage(command: Command) -> str:
    """How to call it, as one types it."""
    if command.subcommands:
        return f"{command.invocation} COMMAND ..."
    required = [_typed(option) for option in command.options if option.is_required or not option.flags]
    more = ["[options]"] if any(option.flags and not option.is_required for option in command.options) else []
    return " ".join([command.invocation, *required, *more])


def _lines(command: Command, brief: bool, width: int) -> Iterator[str]:
    yield from textwrap.wrap(f"usage: {usage(command)}", width, subsequent_indent="         ", break_on_hyphens=False)
    paragraphs = command.purpose.split("\n\n")
    for paragraph in paragraphs[:1] if brief else paragraphs:
        yield ""
        yield from _wrapped(paragraph, width)
    for inner in command.subcommands:
        if inner is command.subcommands[0]:
            yield from ("", "commands:")
        yield from _two_columns("  " + inner.words[-1], _first_sentence(inner.purpose), width)
    first = 2 if command.groups and command.groups[0][0] == ARGUMENTS else 1
    several = len(command.groups) > first
    for title, options in command.groups[:first] if brief else command.groups:
        yield from ("", f"{title}:")
        for option in options:
            yield from _two_columns("  " + _invocation(option), _text(option), width)
    examples = [(inner, example) for inner in (command, *command.subcommands) for example in inner.examples]
    if examples:
        yield from ("", "examples:")
    for inner, (words, what) in examples:
        yield from _wrapped(what, width, "  # ")
        yield f"  {inner.invocation} {words}".rstrip()
    yield ""
    if command.subcommands:
        yield f"'{command.invocation} COMMAND --help' describes a command."
    elif brief and several:
        others = ", ".join(title for title, _ in command.groups[first:])
        yield from _wrapped(f"--help lists all {len(command.options)} options; also: {others}.", width)
    yield from _wrapped(STATUS_LINE, width)


def _typed(option: Option) -> str:
    words = [option.flags[0]] if option.flags else []
    text = " ".join([*words, option.value])
    return text if option.is_required else f"[{text}]"


def _invocation(option: Option) -> str:
    return " ".join([*([", ".join(option.flags)] if option.flags else []), *([option.value] if option.value else [])])


def _text(option: Option) -> str:
    notes = []
    if option.is_required and option.flags:
        notes.append("Required.")
    if option.may_repeat and "repeated" not in option.help:
        notes.append("May be repeated.")
    if option.default:
        notes.append(f"Default: {option.default}.")
    text = option.help.rstrip()
    return " ".join([text if text.endswith((".", "?", "!")) or not text else text + ".", *notes]).strip()


def _first_sentence(text: str) -> str:
    line = " ".join(text.split("\n\n", maxsplit=1)[0].split())
    head, dot, _ = line.partition(". ")
    return head + dot.strip()


def _wrapped(text: str, width: int, indent: str = "") -> list[str]:
    return textwrap.wrap(
        " ".join(text.split()),
        width,
        initial_indent=indent,
        subsequent_indent=indent,
        break_on_hyphens=False,
        break_long_words=False,
    )


def _two_columns(left: str, right: str, width: int) -> Iterator[str]:
    lines = _wrapped(right, width - _TEXT_AT) or [""]
    if len(left) <= _TEXT_AT - 2:
        yield f"{left:<{_TEXT_AT}}{lines.pop(0)}".rstrip()
    else:
        yield from textwrap.wrap(left, width, subsequent_indent="      ", break_on_hyphens=False)
    for line in lines:
        yield " " * _TEXT_AT + line
