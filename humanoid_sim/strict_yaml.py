"""YAML files: PyYAML's safe loader, which also refuses equal keys and reads `1e-3` as a number."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import msgspec
import yaml

from humanoid_sim.errors import InputError, one_line, reason_of
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


def _construct_slice(loader: Any, node: yaml.Node) -> slice:
    """`[start, stop, step]`, as trainers write Python's slices."""
    bounds = loader.construct_sequence(node, deep=True)
    if len(bounds) != 3 or not all(bound is None or type(bound) is int for bound in bounds):
        message = "a slice is [start, stop, step], each an integer or null"
        raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)
    return slice(*bounds)


_EXPONENT = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$")  # `1e-3`, no number to YAML 1.1
Loader.add_constructor("tag:yaml.org,2002:python/object/apply:builtins.slice", _construct_slice)
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
    """Return the document in a YAML file; None if it is empty. Raises `InputError` with the place and what is wrong.

    `label` is what to call the file in messages, its path by default; `what` it should be.
    """
    label = label or str(path)
    try:
        return yaml.load(regular_file(path, what).read_text(encoding="utf-8"), loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = one_line(getattr(error, "problem", None) or str(error).partition("\n")[0])
        raise InputError(f"{label}: {where}not valid YAML: {problem}") from None
    except (OSError, ValueError, TypeError, LookupError, AttributeError) as error:  # a value that its tag does not fit
        raise InputError(f"{label}: not YAML that can be read: {reason_of(error)}") from None


def schema_problem(error: msgspec.ValidationError) -> str:
    """Return what msgspec has found wrong with a document, the field first: `joints[3].upper: Expected …`."""
    problem, _, place = str(error).partition(" - at `$")
    place = place.strip(".`")
    return f"{place}: {problem}" if place else problem
