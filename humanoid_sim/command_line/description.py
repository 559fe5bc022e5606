"""Description of a program's command line: an `argparse` parser, made from the frozen dataclass that holds its options.

Help and shell completion come from it, and the names in complaints; `tyro` reads the words. It imports nothing heavy.
"""

from __future__ import annotations

import argparse
import ast
import dataclasses
import importlib.util
import inspect
import re
import sys
import textwrap
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, get_args, get_origin

from humanoid_sim.assets import shipped

Specification: TypeAlias = "type[Any] | Commands"
"""A dataclass of options, or subcommands that have one each."""
STATUS_LINE = "exit status: 0 fine, 1 failed or worse, 2 bad input, 3 no answer, 130 Ctrl-C"
"""`humanoid_sim.cli.ExitStatus` in a line; docs/exit-statuses.md explains it."""
_SHIPPED = ("robots", "suites", "motions", "songs", "policies")
"""Kinds of names that a help text may hold, as `{robots}`."""
_TABLE = re.compile(r"\{([\w.]+)\.([A-Z_]+)\}")
_METAVARS = {int: "N", float: "X", Path: "FILE"}
"""Placeholders for values by type; for any other type it is the last word of the option's name."""
_Option: TypeAlias = tuple[list[str], dict[str, Any]]
"""Flags of an option, and keywords for `add_argument`; also `required` of arguments without a name, and `kinds`."""
_WIDEST = 100
"""Columns; longer lines are hard to read."""


@dataclass(frozen=True, slots=True)
class Commands:
    """Subcommands of a program."""

    purpose: str
    by_name: Mapping[str, Specification]
    for_file: str = ""
    """Subcommand that is meant where a file stands in its place; '' for none."""


class _Page(argparse.HelpFormatter):
    """Wraps each line of a text on its own, and writes all names before one value: `-o, --output FILE`."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=26)
        self._width = min(self._width + 2, _WIDEST)

    def _format_usage(self, usage: str | None, actions: Any, groups: Any, prefix: str | None) -> str:
        del actions, groups, prefix
        return _wrapped(f"usage: {usage}", self._width, " " * 9) + "\n\n"

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        lines = (line if line.startswith("  python") else _wrapped(line, width) for line in text.splitlines())
        return textwrap.indent("\n".join(lines), indent)

    def _split_lines(self, text: str, width: int) -> list[str]:
        return _wrapped(text, width).splitlines()

    def _format_action_invocation(self, action: argparse.Action) -> str:
        names = ", ".join(action.option_strings)
        return names if action.nargs == 0 else f"{names} {action.metavar or action.dest}{_more(action)}".strip()

    def _format_action(self, action: argparse.Action) -> str:
        if isinstance(action, argparse._SubParsersAction):  # without a line for all of them
            return "".join(map(self._format_action, action._get_subactions()))
        return super()._format_action(action)


def _wrapped(line: str, width: int, indent: str | None = None) -> str:
    indent = line[: len(line) - len(line.lstrip())] if indent is None else indent
    return textwrap.fill(line, width, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False)


def _more(option: argparse.Action) -> str:
    return " ..." if option.nargs == "*" else ""


class Program(argparse.ArgumentParser):
    """The parser of a program or subcommand, whose help and names are used; `tyro` reads the words."""

    def __init__(self, words: tuple[str, ...], purpose: str) -> None:
        first = words[0]
        if not first.endswith(".py"):
            first = f"-m {first}" if first.startswith("tools.") else f"-m humanoid_sim.{first}"
        self.invocation = " ".join(["python", first, *words[1:]])
        """As one types it: `python -m humanoid_sim.play`, `python -m tools.bench`, `python examples/mine.py`."""
        super().__init__(self.invocation, description=purpose, formatter_class=_Page, add_help=False)
        self.words = words
        """Words that call it: `("policy", "check")`."""
        self.options: dict[str, argparse.Action] = {}
        """All options by field; where there are `choices`, nothing else is accepted."""
        self.groups: Mapping[str, Sequence[str]] = {}
        """Fields by heading; the first headings are of what most people need."""
        self.kinds: dict[str, list[str]] = {}
        """Kinds of what ships with the package that an option accepts, by field."""
        self.commands: dict[str, Program] = {}
        self.examples = ""
        """Two lines each: what it does, and the command."""

    @property
    def flags(self) -> dict[str, argparse.Action]:
        """Options by each of their names, `-o` and `--output`."""
        return {flag: option for option in self.options.values() for flag in option.option_strings}

    def close(self, *notes: str) -> None:
        """Complete usage, examples and notes, once all options or subcommands are there."""
        needed = [option for option in self.options.values() if option.required or not option.option_strings]
        more = ["[options]"] if len(needed) < len(self.options) else []
        words = ["COMMAND ..."] if self.commands else [*map(typed, needed), *more]
        self.usage = " ".join([self.invocation, *words])
        examples = "".join(program.examples for program in (self, *self.commands.values()))
        self.epilog = "\n".join([*([f"examples:\n{examples}"] if examples else []), *notes, STATUS_LINE])


def name_of(option: argparse.Action) -> str:
    """Return what messages call an option: `--output` of `-o` and `--output`."""
    return next(flag for flag in option.option_strings if flag.startswith("--"))


def typed(option: argparse.Action) -> str:
    """Return how an option is written in a usage line: `--robot ROBOT`, `[FILE]`."""
    text = " ".join([*option.option_strings[:1], f"{option.metavar}{_more(option)}"])
    return text if option.required else f"[{text}]"


def describe(
    specification: Specification, words: tuple[str, ...], *, positional: bool = False, brief: bool = False
) -> Program:
    """Describe what a program takes.

    A dataclass may have `EXAMPLES`, pairs of words and what they do, and `GROUPS`, the names of fields by heading.

    Args:
        positional: required options are given by their place.
        brief: only the first paragraph and group, which most people need.
    """
    if isinstance(specification, Commands):
        program = Program(words, specification.purpose)
        inner = program.add_subparsers(title="commands", metavar="COMMAND", parser_class=argparse.ArgumentParser)
        for name, kind in specification.by_name.items():
            command = program.commands[name] = describe(kind, (*words, name), positional=positional)
            first, dot, _ = (command.description or "").partition("\n")[0].partition(". ")
            inner.add_parser(name, help=first + dot.strip(), parents=[command])
        program.close(f"'{program.invocation} COMMAND --help' describes a command.")
        return program
    paragraphs = [" ".join(text.split()) for text in inspect.cleandoc(specification.__doc__ or "").split("\n\n")]
    program = Program(words, "\n\n".join(paragraphs[:1] if brief else paragraphs))
    options = dict(_options(specification, positional))
    wanted: Mapping[str, tuple[str, ...]] = getattr(specification, "GROUPS", {})
    grouped = {name for names in wanted.values() for name in names}
    groups: dict[str, Sequence[str]] = {"arguments": [name for name, (flags, _) in options.items() if not flags]}
    groups |= wanted
    groups["options"] = [name for name, (flags, _) in options.items() if flags and name not in grouped]
    program.groups = {title: names for title, names in groups.items() if names}
    titles = list(program.groups)
    shown = titles[: 1 + ("arguments" in titles)] if brief else titles
    for title in shown:
        group = program.add_argument_group(title)
        for name in program.groups[title]:
            flags, keywords = options[name]
            needed, program.kinds[name] = keywords.pop("required"), keywords.pop("kinds")
            option = program.options[name] = group.add_argument(*flags, dest=name, **keywords)
            option.required = needed
    for example, what in getattr(specification, "EXAMPLES", ()):
        program.examples += f"  # {what}\n  {program.invocation} {example}".rstrip() + "\n"
    left = titles[len(shown) :]
    program.close(*([f"--help lists all {len(options)} options; also: {', '.join(left)}."] if left else []))
    return program


def _options(owner: type[Any], positional: bool, prefix: str = "") -> Iterator[tuple[str, _Option]]:
    hints, texts = typing.get_type_hints(owner, include_extras=True), field_texts(owner)
    for field in dataclasses.fields(owner):
        hint, name = hints[field.name], prefix + field.name
        kind, *markers = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        if dataclasses.is_dataclass(kind) and isinstance(kind, type):
            yield from _options(kind, positional, f"{name}.")
            continue
        default = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
        text = texts.get(field.name) or next(filter(None, (getattr(marker, "help", "") for marker in markers)), "")
        yield name, _option(name, kind, markers, default, text, positional)


def _option(name: str, kind: Any, markers: list[Any], default: Any, text: str, positional: bool) -> _Option:
    is_required = default is dataclasses.MISSING
    is_place = (positional and is_required) or any("Positional" in repr(marker) for marker in markers)
    is_union = get_origin(kind) in (typing.Union, types.UnionType)
    kinds = [part for part in (get_args(kind) if is_union else (kind,)) if part is not type(None)]
    takes_many = any(get_origin(part) is tuple for part in kinds)
    inner = [get_args(part)[0] if get_origin(part) is tuple else part for part in kinds]
    choices = [str(choice) for part in inner if get_origin(part) is Literal for choice in get_args(part)]
    is_switch = inner == [bool] and not takes_many
    is_off = is_switch and default is True
    may_repeat = any("UseAppendAction" in repr(marker) for marker in markers)
    notes = [filled(f"Do not {text[:1].lower()}{text[1:]}" if is_off else text)]
    if text and not notes[0].endswith((".", "?", "!")):
        notes[0] += "."
    if is_required and not is_place:
        notes.append("Required.")
    if may_repeat and "repeated" not in text:
        notes.append("May be repeated.")
    if not is_switch and "efault" not in text and "ithout," not in text and (shown := _shown(default)):
        notes.append(f"Default: {shown}.")
    keywords: dict[str, Any] = {"help": " ".join(notes).strip().replace("%", "%%"), "required": is_required}
    keywords["kinds"] = [kind for kind in _SHIPPED if f"{{{kind}}}" in text]
    if is_switch:
        keywords["action"] = "store_true"
    else:
        stated = [marker.metavar for marker in markers if getattr(marker, "metavar", None)]
        usual = "FOLDER" if text.startswith("Folder") else _METAVARS.get(inner[0])
        last = name.upper() if is_place else usual or name.rpartition(".")[2].rpartition("_")[2].upper()
        keywords["metavar"] = "|".join(choices) if choices and not is_place else (stated or [last])[0]
        keywords["choices"] = choices or None
        keywords["nargs"] = "*" if takes_many and not may_repeat else None if is_required or not is_place else "?"
    if is_place:
        return [], keywords
    flag = f"--{'no-' if is_off else ''}{name.replace('_', '-')}"
    aliases = [alias for marker in markers for alias in getattr(marker, "aliases", None) or ()]
    return sorted([flag, *aliases], key=lambda name: name.startswith("--")), keywords


def _shown(default: Any) -> str:
    """Return a default, for a person; empty where it says nothing."""
    if default is dataclasses.MISSING or default is None or default is False or default in ((), ""):
        return ""
    if isinstance(default, tuple):
        return " ".join(_shown(item) for item in default)
    return f"{default:g}" if isinstance(default, float) else str(default)


def filled(text: str) -> str:
    """Return a help text on one line, with the names that ship with the package in place of `{robots}` and so on.

    A table's name, as `{humanoid_sim.envs.tasks.TASKS}`, becomes the names in it.
    """
    text = _TABLE.sub(lambda found: ", ".join(_keys(found[1], found[2])), " ".join(text.split()))
    for kind in _SHIPPED:
        if f"{{{kind}}}" in text:
            text = text.replace(f"{{{kind}}}", ", ".join(shipped(kind)))
    return text


def _keys(module: str, table: str) -> list[str]:
    """Return the keys of a module's table. The module is read and not imported: help must be quick."""
    spec = importlib.util.find_spec(module)
    assert spec is not None, module
    (row,) = (
        node
        for node in _tree(str(spec.origin)).body
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) == table
    )
    keys = [key for node in ast.walk(row) if isinstance(node, ast.Dict) for key in node.keys]
    return [key.value for key in keys if isinstance(key, ast.Constant) and isinstance(key.value, str)]


def field_texts(owner: type[Any]) -> dict[str, str]:
    """Return the string below each field of a dataclass, of those that it inherits too."""
    texts: dict[str, str] = {}
    for base in reversed(owner.__mro__):
        file = getattr(sys.modules.get(base.__module__), "__file__", None)
        if not dataclasses.is_dataclass(base) or file is None:
            continue
        for node in _tree(file).body:
            if isinstance(node, ast.ClassDef) and node.name == base.__name__:
                for field, below in zip(node.body, node.body[1:], strict=False):
                    if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                        match below:
                            case ast.Expr(value=ast.Constant(value=str(text))):
                                texts[field.target.id] = text
    return texts


@cache
def _tree(file: str) -> ast.Module:
    with open(file, encoding="utf-8") as source:
        return ast.parse(source.read())
