"""Layout of a gamepad: which buttons ask for what, and which axes steer; from a file, or as options."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from humanoid_sim.controllers.joy import JoyBindings
from humanoid_sim.errors import InputError, known_names
from humanoid_sim.frontends.gamepad.sticks import Sticks
from humanoid_sim.ros2.parameters import node_parameters
from humanoid_sim.strict_yaml import read_yaml

_NODE = "mode_manager"
"""ROS 2 node whose parameters `joy.*` are read too."""
_Section = TypeVar("_Section", JoyBindings, Sticks)


@dataclass(frozen=True, slots=True)
class PadLayout:
    """Buttons and axes of a gamepad."""

    joy: JoyBindings = field(default_factory=JoyBindings)
    sticks: Sticks = field(default_factory=Sticks)

    def options(self) -> tuple[str, ...]:
        """Return the options of `python -m humanoid_sim.gamepad` that make this layout of the default one."""
        words: list[str] = []
        for name in ("joy", "sticks"):
            section, usual = getattr(self, name), getattr(PadLayout(), name)
            for item in dataclasses.fields(section):
                value = getattr(section, item.name)
                if value != getattr(usual, item.name):
                    values = value if isinstance(value, tuple) else (value,)
                    words += [f"--{name}.{item.name.replace('_', '-')}", *map(str, values)]
        return tuple(words)


def chosen_layout(file: Path | None, given: PadLayout, option: str) -> PadLayout:
    """Return the layout of a file, or the one given by options.

    Args:
        file: YAML with `joy:` and `sticks:`, or a ROS 2 parameter file of `mode_manager`; None for none.
        option: that names the file, for the message.

    Raises:
        InputError: both are given, or the file holds no layout.
    """
    if file is None:
        return given
    if given.options():
        raise InputError(f"{option} and {given.options()[0]}: both say where the buttons are, expected one of them")
    document = read_yaml(file)
    sections = node_parameters(document, _NODE)
    if not sections:
        if not isinstance(document, dict) or not document:
            raise InputError(f"{file}: has no buttons, expected a mapping joy: with damp_button: N and its like")
        for name in document:
            if name not in ("joy", "sticks"):
                raise InputError(f"{file}: {known_names('section', str(name), ('joy', 'sticks'))}")
        sections = document
    elif "joy" not in sections:
        raise InputError(f"{file}: has no parameters joy.* of {_NODE}, expected joy.damp_button: N and its like")
    return PadLayout(
        _section(file, "joy", sections.get("joy", {}), JoyBindings),
        _section(file, "sticks", sections.get("sticks", {}), Sticks),
    )


def _section(file: Path, name: str, values: Any, kind: type[_Section]) -> _Section:
    fields = tuple(item.name for item in dataclasses.fields(kind))
    for key in values if isinstance(values, dict) else ():
        if key not in fields:
            raise InputError(f"{file}: {name}: {known_names('field', str(key), fields)}")
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        raise InputError(f"{file}: {name}: {error}") from None
