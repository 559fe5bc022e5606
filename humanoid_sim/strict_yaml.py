"""YAML files: PyYAML's safe loader, which also refuses equal keys and reads `1e-3` as a number."""

from __future__ import annotations

import re
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import msgspec
import yaml

from humanoid_sim.errors import InputError, known_names, one_line, reason_of
from humanoid_sim.files import regular_file


class Loader(yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader):  # type: ignore[misc]
    """The safe loader, without the last of equal keys silently winning."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return a mapping whose keys differ."""
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag == "tag:yaml.org,2002:merge":
                continue
            if key.value in seen:
                raise yaml.constructor.ConstructorError(None, None, f"'{key.value}' is given twice", key.start_mark)
            seen.add(key.value)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


_SLICE = "tag:yaml.org,2002:python/object/apply:builtins.slice"
_EXPONENT = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$")
"""A number such as `1e-3`, which is none to YAML 1.1."""


def _construct_slice(loader: Any, node: yaml.Node) -> slice:
    """`[start, stop, step]`, as trainers write Python's slices."""
    bounds = loader.construct_sequence(node, deep=True)
    if len(bounds) != 3 or not all(bound is None or type(bound) is int for bound in bounds):
        message = "a slice is [start, stop, step], each an integer or null"
        raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)
    return slice(*bounds)


Loader.add_constructor(_SLICE, _construct_slice)
Loader.add_constructor(
    "tag:yaml.org,2002:python/tuple", lambda loader, node: loader.construct_sequence(node, deep=True)
)
Loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, list("-+.0123456789"))


class TrainerLoader(Loader):
    """The loader of files in which a trainer's program dumped its own objects: these come as plain values, uncalled."""


def _construct_plain(loader: Any, _tag: str, node: yaml.Node) -> Any:
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)


TrainerLoader.add_multi_constructor("tag:yaml.org,2002:python/", _construct_plain)


def read_yaml(path: Path, label: str = "", what: str = "a YAML file", loader: type[Loader] = Loader) -> Any:
    """Return the document in a YAML file; None if it is empty.

    `label` is what to call the file in messages, its path by default; `what` it should be.

    Raises `InputError` with the label, the place and what is wrong.
    """
    label = label or str(path)
    try:
        return yaml.load(regular_file(path, what).read_text(encoding="utf-8"), loader)
    except UnicodeDecodeError:
        raise InputError(f"{label}: is not a text file (UTF-8), expected {what}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = one_line(getattr(error, "problem", None) or str(error).partition("\n")[0])
        raise InputError(f"{label}: {where}not valid YAML: {problem}") from None
    except (OSError, ValueError, TypeError, LookupError, AttributeError) as error:  # a value that its tag does not fit
        raise InputError(f"{label}: not YAML that can be read: {reason_of(error)}") from None


_ACCEPTED = {
    "float": "a number",
    "int": "a whole number",
    "str": "a text",
    "bool": "true or false",
    "array": "a list",
    "object": "a mapping",
}
"""Types in the words of msgspec, and of a person."""
_LONGEST_NUMBER = 1024
"""Bits of a whole number that is shown in a message: more than that a float cannot hold either."""
_LONGEST_VALUE = 60
"""Characters of a value that is shown in a message."""


def schema_problem(error: msgspec.ValidationError, document: Any, struct: type[Any], *, hidden: str = "") -> str:
    """Return what msgspec has found wrong with a document, such as `joints[3].upper: is 'x', expected a number`.

    Args:
        document: that was to be converted.
        struct: to which, a struct or a dataclass.
        hidden: a field of it that no file has.
    """
    problem, _, place = str(error).partition(" - at `$")
    place = place.rstrip("`").lstrip(".")
    expected, is_type, _ = problem.removeprefix("Expected ").partition(", got ")
    if is_type:
        names, _, length = expected.removeprefix("`").partition("`")
        accepted = " or ".join(_ACCEPTED.get(name, name) for name in names.split(" | ")) + length
        problem = f"is {_shown(value_at(document, place))}, expected {accepted}"
    elif problem.startswith("Expected `"):
        kind, _, bound = problem.removeprefix("Expected `").partition("` ")
        accepted = f"{_ACCEPTED.get(kind, kind)} {'that is not empty' if kind == 'str' else bound}"
        problem = f"is {_shown(value_at(document, place))}, expected {accepted}"
    elif problem.startswith("Object contains unknown field"):
        known = [name for name in type_at(struct, place).__struct_fields__ if name != hidden]
        problem = known_names("field", problem.split("`")[1], known)
    elif problem.startswith("Invalid enum value"):
        problem = (
            f"is {_shown(value_at(document, place))}, expected one of {', '.join(_choices(type_at(struct, place)))}"
        )
    else:
        problem = problem.replace("Object missing", "misses").replace("`", "'")
    return f"{place}: {problem}" if place else problem


def _shown(value: object) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, int) and value.bit_length() > _LONGEST_NUMBER:  # Python refuses to write out the longest
        return f"a number of {value.bit_length()} bits"
    text = repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[: _LONGEST_VALUE - 1]}…"


def _choices(annotation: Any) -> list[str]:
    """Return the words that a type accepts, and what else it does."""
    choices = [choice if isinstance(choice, str) else "" for choice in get_args(annotation)]
    if all(choices):
        return choices
    words = [word for part in get_args(annotation) for word in get_args(part) if isinstance(word, str)]
    return [*words, "or values"] if words else [str(choice) for choice in get_args(annotation)]


def value_at(document: Any, place: str) -> Any:
    """Get the value at a place as msgspec names it, such as `joints[3].upper`, or the last that is there on the way."""
    for key in _keys(place):
        try:
            document = document[int(key) if isinstance(document, list | tuple) else key]
        except (KeyError, IndexError, TypeError, ValueError):
            return document
    return document


def type_at(struct: type[Any], place: str) -> Any:
    """Return what a schema expects at a place: of several types a struct before others."""
    kind: Any = struct
    for key in _keys(place):
        is_item = key.isdigit() or key == "..."  # of a list; of a mapping, whatever its key
        kind = get_args(kind)[-1 if key == "..." else 0] if is_item else get_type_hints(kind)[key]
        if get_origin(kind) in (Union, UnionType):
            kinds = [one for one in get_args(kind) if one not in (NoneType, msgspec.UnsetType)]
            kind = next((one for one in kinds if hasattr(one, "__struct_fields__")), kinds[0])
    return kind


def _keys(place: str) -> list[str]:
    return re.findall(r"[^.\[\]]+", place)
