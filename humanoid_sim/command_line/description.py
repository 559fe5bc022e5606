"""What a program's command line takes, read from the frozen dataclasses that hold its options.

Help, shell completion and the complaints about words that nothing knows are made from this. It imports nothing heavy.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import sys
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, get_args, get_origin

from humanoid_sim.assets import shipped

__all__ = ["ARGUMENTS", "Command", "Commands", "Option", "Specification", "describe", "field_texts", "filled"]

Specification: TypeAlias = "type[Any] | Commands"
"""A dataclass of options, or subcommands that have one each."""


@dataclass(frozen=True, slots=True)
class Commands:
    """Subcommands of a program."""

    purpose: str
    """Of all of them."""
    by_name: Mapping[str, Specification]
    for_file: str = ""
    """The one that is meant where a file stands in its place; '' for none."""


ARGUMENTS = "arguments"
"""Heading of those that are given by their place."""
_SHIPPED = ("robots", "suites", "motions", "songs", "policies")
"""Kinds of names that a help text may hold, as `{robots}`."""
_METAVARS = {int: "N", float: "X", Path: "FILE"}
"""What stands for a value; for any other kind it is the last word of the option's name."""


@dataclass(frozen=True, slots=True)
class Option:
    """An option, or an argument without a name."""

    field: str
    """Of the dataclass."""
    flags: tuple[str, ...]
    """As typed, `--robot`; empty for an argument that is given by its place."""
    metavar: str
    """What stands for its value; empty for a switch."""
    help: str
    default: str
    """As shown; empty where there is nothing to show."""
    is_required: bool
    takes_many: bool
    choices: tuple[str, ...] = ()
    """All that is accepted; empty: anything."""
    names: tuple[str, ...] = ()
    """That ship with the package, of what is accepted."""
    may_repeat: bool = False
    is_whole: bool = False
    """Whether its value is a whole number."""
    not_called: tuple[str, ...] = ()
    """What other programs call it, for whoever types that."""

    @property
    def name(self) -> str:
        """What messages call it: `--output` of `-o` and `--output`."""
        return next((flag for flag in self.flags if flag.startswith("--")), self.metavar)

    @property
    def value(self) -> str:
        """How the value is written in a usage line: `ROBOT`, `a|b`, `PUSH ...`; empty for a switch."""
        shown = "|".join(self.choices) or self.metavar
        if not self.flags:
            shown = self.metavar
        return f"{shown} ..." if self.takes_many and not self.may_repeat else shown


@dataclass(frozen=True, slots=True)
class Command:
    """A program, or one of its subcommands."""

    words: tuple[str, ...]
    """What calls it: `("policy", "check")`."""
    purpose: str
    """Paragraphs, separated by empty lines."""
    groups: tuple[tuple[str, tuple[Option, ...]], ...] = ()
    """Options under a heading each; the first are what most people need."""
    examples: tuple[tuple[str, str], ...] = ()
    """What follows the command, and what that does."""
    subcommands: tuple[Command, ...] = ()

    @property
    def options(self) -> tuple[Option, ...]:
        """All of them."""
        return tuple(option for _, options in self.groups for option in options)

    @property
    def invocation(self) -> str:
        """Words to type: `python -m humanoid_sim.play`, `python -m tools.bench`, or `python examples/mine.py`."""
        first = self.words[0]
        if not first.endswith(".py"):
            first = f"-m {first}" if first.startswith("tools.") else f"-m humanoid_sim.{first}"
        return " ".join(["python", first, *self.words[1:]])


def describe(specification: Specification, words: tuple[str, ...], *, positional: bool = False) -> Command:
    """What a program takes.

    A dataclass may have `EXAMPLES`, pairs of words and what they do, `GROUPS`, the names of fields by heading, and
    `CALLED_ELSEWHERE`, other programs' flags for its fields, which are then suggested. For messages it may have
    `OF_ANOTHER_PROGRAM`, options that are looked for here, with the program that has them, and `SURPLUS`, what to say
    of words too many.

    Args:
        specification: of its options.
        words: that call it.
        positional: required options are given by their place.
    """
    if isinstance(specification, Commands):
        named = specification.by_name.items()
        inner = tuple(describe(kind, (*words, name), positional=positional) for name, kind in named)
        return Command(words, specification.purpose, subcommands=inner)
    options = {option.field: option for option in _options(specification, positional)}
    places = tuple(option for option in options.values() if not option.flags)
    groups: list[tuple[str, tuple[Option, ...]]] = [(ARGUMENTS, places)]
    wanted: Mapping[str, tuple[str, ...]] = getattr(specification, "GROUPS", {})
    grouped = {name for names in wanted.values() for name in names}
    rest = tuple(option for option in options.values() if option.flags and option.field not in grouped)
    groups += [(title, tuple(options[name] for name in names)) for title, names in wanted.items()]
    groups.append(("options", rest))
    return Command(
        words,
        inspect.cleandoc(specification.__doc__ or ""),
        tuple((title, held) for title, held in groups if held),
        tuple(getattr(specification, "EXAMPLES", ())),
    )


def _options(owner: type[Any], positional: bool, prefix: str = "") -> Iterator[Option]:
    hints, texts = typing.get_type_hints(owner, include_extras=True), field_texts(owner)
    elsewhere: Mapping[str, Sequence[str]] = getattr(owner, "CALLED_ELSEWHERE", {})
    for field in dataclasses.fields(owner):
        kind, *markers = (
            get_args(hints[field.name]) if get_origin(hints[field.name]) is Annotated else (hints[field.name],)
        )
        if dataclasses.is_dataclass(kind) and isinstance(kind, type):
            yield from _options(kind, positional, f"{prefix}{field.name}.")
            continue
        default = field.default if field.default_factory is dataclasses.MISSING else field.default_factory()
        others = tuple(elsewhere.get(field.name, ()))
        yield _option(prefix + field.name, kind, markers, default, texts.get(field.name, ""), positional, others)


def _option(
    name: str, kind: Any, markers: list[Any], default: Any, text: str, positional: bool, not_called: tuple[str, ...]
) -> Option:
    is_required = default is dataclasses.MISSING
    named = {repr(marker) for marker in markers}
    is_place = (positional and is_required) or any("Positional" in marker for marker in named)
    aliases = tuple(alias for marker in markers for alias in getattr(marker, "aliases", None) or ())
    kinds = [part for part in (get_args(kind) if _is_union(kind) else (kind,)) if part is not type(None)]
    takes_many = any(get_origin(part) is tuple for part in kinds)
    inner = [get_args(part)[0] if get_origin(part) is tuple else part for part in kinds]
    choices = tuple(str(choice) for part in inner if get_origin(part) is Literal for choice in get_args(part))
    is_switch = inner == [bool] and not takes_many
    flag = name.replace("_", "-")
    flag = f"--no-{flag}" if is_switch and default is True else f"--{flag}"
    stated = [marker.metavar for marker in markers if getattr(marker, "metavar", None)]
    usual = "FOLDER" if text.startswith("Folder") else _METAVARS.get(inner[0])
    metavar = name.upper() if is_place else usual or name.rpartition(".")[2].rpartition("_")[2].upper()
    names = (*sorted(aliases, key=len), flag) if any(len(alias) == 2 for alias in aliases) else (flag, *aliases)
    return Option(
        name,
        () if is_place else names,
        "" if is_switch else (stated or [metavar])[0],
        filled(f"Do not {text[:1].lower()}{text[1:]}" if is_switch and default is True else text),
        "" if is_switch or "efault" in text or "ithout," in text else _shown(default),
        is_required,
        takes_many,
        choices,
        tuple(name for kind in _SHIPPED if f"{{{kind}}}" in text for name in shipped(kind)),
        any("UseAppendAction" in marker for marker in named),
        inner == [int],
        not_called,
    )


def _is_union(kind: Any) -> bool:
    return get_origin(kind) in (typing.Union, types.UnionType)


def _shown(default: Any) -> str:
    """A default, for a person; empty where it says nothing."""
    if default is dataclasses.MISSING or default is None or default is False or default in ((), ""):
        return ""
    if isinstance(default, tuple):
        return " ".join(_shown(item) for item in default)
    return f"{default:g}" if isinstance(default, float) else str(default)


def filled(text: str) -> str:
    """A help text on one line, with the names that ship with the package in the places of `{robots}` and the like."""
    text = " ".join(text.split())
    for kind in _SHIPPED:
        if f"{{{kind}}}" in text:
            text = text.replace(f"{{{kind}}}", ", ".join(shipped(kind)))
    return text


def field_texts(owner: type[Any]) -> dict[str, str]:
    """The string below each field of a dataclass, of those that it inherits too."""
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
