"""Read a suite; whatever is wrong is one line with the file, the field and what is accepted."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec

from humanoid_sim.assets import asset_path
from humanoid_sim.errors import InputError
from humanoid_sim.files import is_file
from humanoid_sim.regress.metrics import METRICS
from humanoid_sim.regress.suite import AXES, Suite
from humanoid_sim.regress.suite_checks import draw_problems, suite_problems
from humanoid_sim.strict_yaml import read_yaml

__all__ = ["load_suite", "shipped_suites"]

_PLACE = re.compile(r"^(?P<problem>.*?)(?: - at `\$\.?(?P<place>.*?)`)?$", re.DOTALL)


_CHOICES = {"task": tuple(METRICS), "axis": tuple(AXES)}
"""What is accepted where a suite may choose."""


def shipped_suites() -> tuple[str, ...]:
    """Names of the suites that come with the package."""
    return tuple(sorted(path.stem for path in asset_path("suites").glob("*.yaml")))


def load_suite(name_or_path: str) -> tuple[Suite, Path]:
    """A shipped suite by its name, or the one in a YAML file; with the folder that its paths are relative to.

    Raises:
        InputError: one line, such as `mine.yaml: seeds: is 1, expected at least 2`.
    """
    path = _find(name_or_path)
    document = read_yaml(path)
    if not isinstance(document, dict):
        raise InputError(f"{path}: is no suite, expected a mapping with name, task, cases, seeds and tolerances")
    try:
        suite = msgspec.convert(document, Suite)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {_place_and_problem(str(error))}") from None
    for problem in suite_problems(suite):
        raise InputError(f"{path}: {problem}")
    try:
        drawn = suite.draw()
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    for problem in draw_problems(drawn):
        raise InputError(f"{path}: {problem}")
    return suite, path.resolve().parent


def _find(name_or_path: str) -> Path:
    if name_or_path in shipped_suites():
        return asset_path("suites", f"{name_or_path}.yaml")
    if not is_file(name_or_path):
        known = ", ".join(shipped_suites())
        raise InputError(f"--suite: is '{name_or_path}', expected a suite's YAML file or one of: {known}")
    return Path(name_or_path)


def _place_and_problem(message: str) -> str:
    """Turn ``Expected `int`, got `str` - at `$.seeds` `` into `seeds: expected int, got str`."""
    found = _PLACE.match(message)
    assert found is not None  # matches any text
    problem = found["problem"].replace("`", "'")
    problem = problem.replace("Object missing required", "misses the").replace("Object contains", "has the")
    problem = problem[0].lower() + problem[1:]
    place = found["place"] or ""
    accepted = _CHOICES.get(place.rpartition(".")[2]) if problem.startswith("invalid enum value") else None
    problem += f", expected one of {', '.join(accepted)}" if accepted else ""
    return f"{place}: {problem}" if place else problem
