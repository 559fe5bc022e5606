"""ROS 2 parameter files, as nodes take them with `--params-file`: values under `<node>: ros__parameters:`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

_SECTION = "ros__parameters"
_ANY = ("*", "**", "")
"""Parts of a node's path that stand for any node or namespace."""


def node_parameters(document: Any, node: str) -> dict[str, Any]:
    """Return the parameters of a node, named without a namespace, as nested mappings; empty if there are none for it.

    Those under `/**` belong to every node; its own override them. `joy.damp_button: 2` is `joy: {damp_button: 2}`.
    """
    found: dict[str, Any] = {}
    sections = [(path, values) for path, values in _sections(document, ()) if path[-1:] in ((), (node,))]
    for _, values in sorted(sections, key=lambda section: len(section[0])):
        _merge(found, values)
    return found


def node_names(document: Any) -> tuple[str, ...]:
    """Return the names of the nodes that a document has parameters for, without `/**`."""
    return tuple(dict.fromkeys(path[-1] for path, _ in _sections(document, ()) if path))


def _sections(document: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """Yield each node's path without wildcards, and its parameters."""
    if not isinstance(document, Mapping):
        return
    for key, values in document.items():
        if key == _SECTION and isinstance(values, Mapping):
            yield path, values
        else:
            yield from _sections(values, (*path, *(part for part in str(key).split("/") if part not in _ANY)))


def _merge(found: dict[str, Any], values: Mapping[str, Any]) -> None:
    for key, value in values.items():
        *parents, last = str(key).split(".")
        place = found
        for parent in parents:
            below = place.get(parent)
            place[parent] = below = below if isinstance(below, dict) else {}
            place = below
        if isinstance(value, Mapping):
            inner = place.get(last)
            place[last] = inner = inner if isinstance(inner, dict) else {}
            _merge(inner, value)
        else:
            place[last] = value
