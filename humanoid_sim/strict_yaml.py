"""YAML from strangers: PyYAML's safe loader, without the silences and crashes that it has left."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import msgspec
import yaml

from humanoid_sim.bounds import YAML_BYTES, YAML_TEXT, YAML_VALUES
from humanoid_sim.errors import InputError, known_names, one_line
from humanoid_sim.files import regular_file

UNREADABLE = (ValueError, OverflowError, TypeError, LookupError, AttributeError, RecursionError)
"""Errors that PyYAML raises besides its own: for values that their tags do not fit, and for unreasonable sizes."""
_SAFE_NESTING = 2000
"""Levels that libyaml's loader recurses into without harm; at many thousands it takes the process with it."""


class _Strictness(yaml.constructor.SafeConstructor):
    """Refuses a key given twice, of which YAML would silently keep the last, and text that no file or name can hold."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return a mapping whose keys differ."""
        seen: set[str] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode) or key.tag == "tag:yaml.org,2002:merge":
                continue
            if key.value in seen:
                raise yaml.constructor.ConstructorError(None, None, f"'{key.value}' is given twice", key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)

    def construct_document(self, node: yaml.Node) -> Any:
        """Return a document of a bounded number of values: aliases of aliases multiply, and merging copies them."""
        _count_values(node, {}, set())
        return super().construct_document(node)

    def construct_scalar(self, node: yaml.ScalarNode | yaml.MappingNode) -> str:
        """Return a text; the escapes of a quoted one can spell what is none."""
        value = str(super().construct_scalar(node))
        if len(value) > YAML_TEXT:
            message = f"a text of {len(value)} characters, expected at most {YAML_TEXT}"
            raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)
        if "\0" in value or any("\ud800" <= character <= "\udfff" for character in value):
            message = "a text holds a null character or half of a surrogate pair"
            raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)
        return value


def _count_values(node: yaml.Node, known: dict[int, int], above: set[int]) -> int:
    """Count the values in a node, those that aliases repeat each time; refuse too many, and a node within itself."""
    if id(node) in known or isinstance(node, yaml.ScalarNode):
        return known.get(id(node), 1)
    if id(node) in above:
        raise yaml.constructor.ConstructorError(None, None, "an alias stands for what it is in", node.start_mark)
    above.add(id(node))
    parts = node.value if isinstance(node, yaml.SequenceNode) else [part for pair in node.value for part in pair]
    size = 1 + sum(_count_values(part, known, above) for part in parts)
    above.remove(id(node))
    known[id(node)] = size
    if size > YAML_VALUES:
        message = f"more than {YAML_VALUES} values"
        raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)
    return size


class StrictLoader(_Strictness, yaml.SafeLoader):
    """The strict loader in Python, whose errors say most."""


class _FastLoader(_Strictness, yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader):  # type: ignore[misc]
    """The same on libyaml, which reads a robot in 7 ms instead of 110 ms."""


def load_strictly(text: str) -> Any:
    """Return the document that a text holds.

    Raises:
        yaml.YAMLError: the text is not YAML, or not strict enough; with the place.
        UNREADABLE: see there.
    """
    # A bound on the nesting: every level takes a bracket, or one more column of indentation.
    if text.count("[") + text.count("{") + max(len(line) for line in text.split("\n")) < _SAFE_NESTING:
        with contextlib.suppress(yaml.YAMLError, *UNREADABLE):
            return yaml.load(text, _FastLoader)
    return yaml.load(text, StrictLoader)  # what fails there fails here, and tells more


_SLICE = "tag:yaml.org,2002:python/object/apply:builtins.slice"
_EXPONENT = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$")
"""A number such as `1e-3`, which is none to YAML 1.1."""


def _construct_slice(loader: Any, node: yaml.Node) -> slice:
    """`[start, stop, step]`, each an integer or null: made here, never by calling what the file names."""
    bounds = loader.construct_sequence(node, deep=True) if isinstance(node, yaml.SequenceNode) else []
    if len(bounds) != 3 or not all(bound is None or type(bound) is int for bound in bounds):
        message = "a slice is [start, stop, step], each an integer or null"
        raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)
    return slice(*bounds)


def _refuse_tag(loader: Any, node: yaml.Node) -> None:  # noqa: ARG001 - the signature of a constructor
    tag = node.tag.replace("tag:yaml.org,2002:", "!!")
    message = f"the tag {tag} is not read; the only one of Python that is: !!python/object/apply:builtins.slice"
    raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)


for _loader in (StrictLoader, _FastLoader):
    _loader.add_constructor(_SLICE, _construct_slice)
    _loader.add_constructor(None, _refuse_tag)  # None: any tag that has no constructor
    _loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, list("-+.0123456789"))


def read_yaml(path: Path, label: str = "", what: str = "a YAML file") -> Any:
    """Return the document in a YAML file; None if it is empty.

    `label` is what to call the file in messages, its path by default; `what` it should be.

    Raises `InputError` with the label, the place and what is wrong.
    """
    label = label or str(path)
    try:
        return load_strictly(regular_file(path, what, YAML_BYTES).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{label}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{label}: is not a text file (UTF-8), expected {what}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = one_line(getattr(error, "problem", None) or str(error).partition("\n")[0])
        raise InputError(f"{label}: {where}not valid YAML: {problem}") from None
    except UNREADABLE as error:
        raise InputError(f"{label}: not YAML that can be read: {type(error).__name__}: {error}") from None


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
        accepted = " or ".join(_ACCEPTED.get(name, name) for name in expected.strip("`").split(" | "))
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
            document = document[int(key) if isinstance(document, list) else key]
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
