"""YAML from strangers: read safely, with one line for what is wrong."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from humanoid_sim.errors import InputError
from humanoid_sim.files import regular_file
from humanoid_sim.strict_yaml import UNREADABLE, StrictLoader

__all__ = ["read_yaml"]

_PYTHON = "tag:yaml.org,2002:python/"
_SLICE = _PYTHON + "object/apply:builtins.slice"


class _Loader(StrictLoader):
    """Reads `1e-3` as the number that it is, and knows one Python tag: `slice`."""

    def construct_slice(self, node: yaml.Node) -> slice:
        """`[start, stop, step]`, each an integer or null: made here, never by calling what the file names."""
        bounds = self.construct_sequence(node, deep=True) if isinstance(node, yaml.SequenceNode) else []
        if len(bounds) != 3 or not all(bound is None or type(bound) is int for bound in bounds):
            message = "a slice is [start, stop, step], each an integer or null"
            raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)
        return slice(*bounds)

    def refuse(self, node: yaml.Node) -> None:
        tag = node.tag.replace("tag:yaml.org,2002:", "!!")
        message = f"the tag {tag} is not read; the only one of Python that is: !!python/object/apply:builtins.slice"
        raise yaml.constructor.ConstructorError(None, None, message, node.start_mark)


_Loader.add_constructor(_SLICE, _Loader.construct_slice)
_Loader.add_constructor(None, _Loader.refuse)  # None: any tag that has no constructor
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


def read_yaml(path: Path) -> Any:
    """The document in a YAML file; None if it is empty.

    Raises:
        InputError: one line with the file, the place and what is wrong.
    """
    try:
        return yaml.load(regular_file(path, "a YAML file").read_text(encoding="utf-8"), _Loader)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is no text (UTF-8), expected a YAML file") from None
    except yaml.YAMLError as error:
        raise InputError(f"{path}: is no YAML that can be read{_place(error)}: {_problem(error)}") from None
    except UNREADABLE as error:
        raise InputError(f"{path}: is no YAML that can be read: {type(error).__name__}: {error}") from None


def _place(error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    return "" if mark is None else f" (line {mark.line + 1})"


def _problem(error: yaml.YAMLError) -> str:
    text = getattr(error, "problem", None) or str(error)
    return " ".join(text.split())
