"""Read a robot description from its YAML file; whatever is wrong is one line with file, field and what is accepted."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import msgspec
import yaml

from humanoid_sim.assets import asset_path
from humanoid_sim.errors import InputError
from humanoid_sim.robots.checks import description_problems
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["RobotDescription", "load_robot", "shipped_robots"]


def shipped_robots() -> tuple[str, ...]:
    """Names of the robots that come with the package."""
    return tuple(sorted(path.stem for path in asset_path("robots").glob("*.yaml")))


def load_robot(name_or_path: str | Path) -> RobotDescription:
    """The description of a shipped robot (`lite`), or of the YAML file at a path, beside its MJCF.

    The MJCF's existence is checked here, its content when a simulation is built.

    Raises:
        InputError: one line, such as `lite.yaml: joints[3].upper: is -3, expected more than lower, …`.
    """
    path, label = _find(str(name_or_path))
    document = _read(path, label)
    if "folder" in document:
        raise InputError(f"{label}: folder: is not a field of the file; give 'mjcf' relative to the file instead")
    document["folder"] = str(path.resolve().parent)
    try:
        robot = msgspec.convert(document, RobotDescription)
    except msgspec.ValidationError as error:
        raise InputError(f"{label}: {_field_and_problem(str(error), document)}") from None
    for problem in description_problems(robot):
        raise InputError(f"{label}: {problem}")
    if not robot.mjcf_path.is_file():
        raise InputError(f"{label}: mjcf: '{robot.mjcf}' is no file; it is looked up beside the description")
    return robot


def _find(name_or_path: str) -> tuple[Path, str]:
    """The file, and what to call it in messages."""
    known = shipped_robots()
    if name_or_path in known:
        return asset_path("robots", f"{name_or_path}.yaml"), f"{name_or_path}.yaml"
    path = Path(name_or_path)
    if path.is_dir():
        raise InputError(f"{name_or_path}: is a folder, expected a robot's YAML file or one of: {', '.join(known)}")
    if not path.is_file():
        raise InputError(f"unknown robot '{name_or_path}': neither a file nor one of: {', '.join(known)}")
    return path, name_or_path


class _Loader(yaml.SafeLoader):
    """YAML's plain types; a key given twice, of which YAML would silently keep the last, is an error."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if key.value in seen:
                raise yaml.constructor.ConstructorError(None, None, f"'{key.value}' is given twice", key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _read(path: Path, label: str) -> dict[str, Any]:
    try:
        document = yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except OSError as error:
        raise InputError(f"{label}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{label}: is not a text file (UTF-8)") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = getattr(error, "problem", None) or str(error).partition("\n")[0]
        raise InputError(f"{label}: {where}not valid YAML: {problem}") from None
    if document is None:
        raise InputError(f"{label}: is empty, expected a robot description")
    if not isinstance(document, dict):
        raise InputError(f"{label}: is a {_kind(document)}, expected a mapping with name, mjcf, joints, …")
    return document


_KINDS = {dict: "mapping", list: "list", str: "text", bool: "boolean", int: "number", float: "number"}


def _kind(value: object) -> str:
    return _KINDS.get(type(value), type(value).__name__)


def _field_and_problem(message: str, document: dict[str, Any]) -> str:
    """Turn ``Expected `float`, got `str` - at `$.joints[3].upper` `` into `joints[3].upper: is 'x', expected …`."""
    problem, _, place = message.partition(" - at `$")
    place = place.rstrip("`").lstrip(".")
    problem = problem.replace("`", "'")
    problem = problem[0].lower() + problem[1:]
    if not place:
        return problem
    expected, separator, _ = problem.partition(", got ")
    if separator:
        problem = f"is {_shown(_at(document, place))}, {expected}"
    elif problem.startswith("invalid enum value"):
        problem = f"is {_shown(_at(document, place))}, which is not accepted"
    return f"{place}: {problem}"


def _at(document: Any, place: str) -> Any:
    for key in re.findall(r"[^.\[\]]+", place):
        document = document[int(key)] if isinstance(document, list) else document[key]
    return document


def _shown(value: object) -> str:
    if isinstance(value, dict | list):
        return f"a {_kind(value)}"
    return "nothing" if value is None else repr(value)
