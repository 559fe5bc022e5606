"""YAML files: PyYAML's safe loader, which also refuses equal keys and reads `1e-3` as a number."""

from __future__ import annotations

import json
import math
import re
import reprlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import yaml

from humanoid_sim.errors import InputError, blaming, known_names, reason_of
from humanoid_sim.files import regular_file

_Kind = TypeVar("_Kind")


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


def _construct_plain(loader: Any, _tag: str, node: yaml.Node) -> Any:
    if isinstance(node, yaml.ScalarNode):
        return loader.construct_scalar(node)
    construct = loader.construct_mapping if isinstance(node, yaml.MappingNode) else loader.construct_sequence
    return construct(node, deep=True)


_EXPONENT = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$")  # `1e-3`, no number to YAML 1.1
Loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, list("-+.0123456789"))
# What a trainer's program dumped of its own objects comes as plain values, uncalled; Python's slices as slices.
Loader.add_multi_constructor("tag:yaml.org,2002:python/", _construct_plain)
Loader.add_constructor(
    "tag:yaml.org,2002:python/object/apply:builtins.slice", lambda loader, node: slice(*loader.construct_sequence(node))
)


def read_yaml(path: Path, what: str = "a YAML file") -> Any:
    """Return the document in a YAML file; None if it is empty. Raises `InputError` with the place and what is wrong.

    `what` it should be.
    """
    try:
        return yaml.load(regular_file(path, what).read_text(encoding="utf-8"), Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        raise InputError(f"{path}: {where}not valid YAML: {error.problem or reason_of(error)}") from None
    except (ValueError, TypeError, LookupError, AttributeError, yaml.YAMLError) as error:
        raise InputError(f"{path}: not YAML that can be read: {reason_of(error)}") from None


def require_finite(document: Any) -> None:
    """Raise an `InputError` with their places if a document holds `.nan` or `.inf`."""
    with blaming("refers to itself", ValueError):
        json.dumps(document, default=str)
    if found := [*_not_finite(document)]:
        raise InputError("; ".join(found))


def _not_finite(value: Any, place: str = "") -> Iterator[str]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _not_finite(inner, f"{place}.{name}".lstrip("."))
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            yield from _not_finite(inner, f"{place}[{i}]")
    elif isinstance(value, float) and not math.isfinite(value):
        yield f"{place}: is {value}, expected a finite number"


def converted(
    document: Any, kind: type[_Kind], where: str = "", dec_hook: Callable[[type, Any], Any] | None = None
) -> _Kind:
    """Return a document as a type. Raises `InputError` such as `robot.yaml: joints[3].upper: is 'x', expected …`."""
    try:
        return msgspec.convert(document, kind, dec_hook=dec_hook)
    except msgspec.ValidationError as error:
        problem, _, place = str(error).partition(" - at `$")
        if problem.startswith("Object contains unknown field"):
            problem = known_names("field", problem.split("`")[1], _fields(kind, place))
        elif problem.startswith(("Expected", "Invalid enum")) and "..." not in place:
            parent, _, name = place.strip("`").rpartition(".")
            accepted = getattr(_fields(kind, parent).get(name), "values", ())
            expected = " or ".join(map(str, accepted)) or problem.partition(", got")[0].removeprefix("Expected ")
            expected = expected.replace("`object`", "a mapping").replace("`array`", "a list")
            problem = f"is {reprlib.repr(_value(document, place))}, expected {expected}"
        raise InputError(": ".join(filter(None, (where, place.strip(".`"), problem)))) from None


def _value(document: Any, place: str) -> Any:
    for name in re.findall(r"\w+", place):
        document = document[int(name) if isinstance(document, (list, tuple)) else name]
    return document


def _fields(kind: type, place: str) -> dict[str, Any]:
    """Return the fields, with their types, that a type has at a place such as `.joints[3].motor`."""
    node: Any = msgspec.inspect.type_info(kind)
    for name in [*re.findall(r"[^\W\d]\w*", place), ""]:
        while not hasattr(node, "fields"):  # of a union the first, of a list or mapping an item
            inner = node.types[0] if hasattr(node, "types") else getattr(node, "item_type", None)
            node = inner or node.value_type
        node = next((field.type for field in node.fields if field.encode_name == name), node)
    return {field.encode_name: field.type for field in node.fields}
