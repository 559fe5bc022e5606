"""Statements of one source about a contract: some fields, each with the source it came from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

NOT_STATED = "default"
"""Source of a field that no source gives: the usual meaning stands."""
_ASSUMED, _DERIVED = "assumed", "follows from"
_ROBOT, _OWN_ORDER = "and the robot", "robot's own order"

_NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Given:
    """A value and where it came from."""

    value: Any
    source: str
    """For people: `mjlab metadata`, `deploy.yaml`, `contract.yaml override`."""
    decimals: int | None = None
    """Digits behind the point that the source writes; None: as many as the values have."""


@dataclass(frozen=True, slots=True)
class PartialContract:
    """The fields of a `PolicyContract` that one source states; the others are for other sources."""

    source: str
    fields: Mapping[str, Given] = field(default_factory=lambda: _NOTHING)
    """By the name of the contract's field; `observation` holds the names of the terms alone. Four more say how to
    find what the source does not name: `joint_places` (the policy's joints as places in the robot's own order),
    `action_joint_places` (the driven ones as places in `joint_names`), `action_joint_patterns`, and `joint_patterns`,
    each of which some joint has to match."""
    terms: Mapping[str, Mapping[str, Given]] = field(default_factory=lambda: _NOTHING)
    """Options of observation terms: name of the term, then name of the option."""
    assumed: Mapping[str, Given] = field(default_factory=lambda: _NOTHING)
    """Values that the dialect implies; anything that a source states comes before them."""
    assumed_terms: Mapping[str, Given] = field(default_factory=lambda: _NOTHING)
    """Options of every term, likewise."""
    assumed_kinds: Mapping[str, Mapping[str, Given]] = field(default_factory=lambda: _NOTHING)
    """Options of the terms of one kind, by the kind's name, likewise; they come before those of every term."""
    overrides: bool = False
    """Beats the other sources instead of having to agree with them."""
    ignores: tuple[str, ...] = ()
    """Other sources that are not to be read."""


def given(source: str, values: Mapping[str, Any]) -> dict[str, Given]:
    """Each value with the one source."""
    return {name: Given(value, source) for name, value in values.items()}


def assumed(dialect: str, values: Mapping[str, Any]) -> dict[str, Given]:
    """Values that a dialect implies without stating them."""
    return given(f"{_ASSUMED} ({dialect})", values)


def derived(value: Any, origin: str) -> Given:
    """Return a value that follows from something else in the contract."""
    return Given(value, f"{_DERIVED} {origin}")


def from_robot(value: Any, source: str = "") -> Given:
    """Return a value that is this robot's, by places that the source gives, or in the robot's own order."""
    return Given(value, f"{source} {_ROBOT}" if source else _OWN_ORDER)


def is_from_robot(source: str) -> bool:
    """Return whether the robot gives the field, so that any robot with as many joints would fit."""
    return source == _OWN_ORDER or source.endswith(f" {_ROBOT}")


def is_assumed(source: str) -> bool:
    """Return whether no source states the field, but its dialect implies it."""
    return source.startswith(_ASSUMED)


def is_stated(source: str) -> bool:
    """Return whether some source states the field."""
    return not source.startswith((_ASSUMED, _DERIVED)) and source != NOT_STATED
