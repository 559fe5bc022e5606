"""Layout of a gamepad: which buttons ask for what, from a file or as options, and what its sticks command."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.joy import JoyBindings
from humanoid_sim.errors import InputError, blaming, require_known
from humanoid_sim.mit import FloatArray
from humanoid_sim.strict_yaml import read_yaml

_MODEST = ((-0.3, 0.5), (-0.2, 0.2), (-0.5, 0.5))  # m/s, m/s, rad/s: for a policy that does not say which it knows
_DEAD_ZONE = 0.15  # part of a stick's way, from its middle, that counts as none
_FORWARD, _LEFT, _TURN = 1, 0, 2  # axes: left stick up, left stick left, right stick left, where they are -1


def policy_speeds(contract: PolicyContract | None) -> FloatArray | None:
    """Return lowest and highest vx, vy (m/s) and yaw rate (rad/s), shape (3, 2); None if the policy takes none."""
    if contract is None or not contract.takes_velocity_command:
        return None
    known = np.array(_MODEST if contract.command_ranges is None else contract.command_ranges, dtype=np.float64)
    return np.stack([np.minimum(known[:, 0], 0.0), np.maximum(known[:, 1], 0.0)], axis=1)


def stick_velocity(axes: Sequence[float], speeds: FloatArray) -> FloatArray:
    """Return the velocity that sticks command, shape (3,), m/s, m/s, rad/s.

    Beyond the dead zone it grows linearly from zero, to the end of `speeds`, shape (3, 2), at the end of the way.
    """
    pushed = -np.array([axes[_FORWARD], axes[_LEFT], axes[_TURN]])
    beyond = np.clip((np.abs(pushed) - _DEAD_ZONE) / (1.0 - _DEAD_ZONE), 0.0, 1.0)
    velocity: FloatArray = np.where(pushed > 0.0, speeds[:, 1], -speeds[:, 0]) * np.sign(pushed) * beyond
    return velocity


@dataclass(frozen=True, slots=True)
class PadLayout:
    """Buttons of a gamepad."""

    joy: JoyBindings = field(default_factory=JoyBindings)

    def options(self) -> tuple[str, ...]:
        """Return the options of `python -m humanoid_sim.gamepad` that make this layout of the default one."""
        words: list[str] = []
        for item in dataclasses.fields(JoyBindings):
            value = getattr(self.joy, item.name)
            if value != getattr(JoyBindings(), item.name):
                values = value if isinstance(value, tuple) else (value,)
                words += [f"--joy.{item.name.replace('_', '-')}", *map(str, values)]
        return tuple(words)


def chosen_layout(file: Path | None, given: PadLayout, option: str) -> PadLayout:
    """Return the layout of a file, or the one given by options.

    Raises `InputError` if both are given, or the file holds no layout.

    Args:
        file: YAML with `joy:`, or a ROS 2 parameter file with `joy.*` of `mode_manager`; None for none.
        option: that names the file, for the message.
    """
    if file is None:
        return given
    if given.options():
        raise InputError(f"{option} and {given.options()[0]}: both say where the buttons are, expected one of them")
    document = read_yaml(file)
    if not isinstance(document, dict) or not document:
        raise InputError(f"{file}: has no buttons, expected a mapping joy: with damp_button: N and its like")
    sections = _ros_parameters(document) or document
    require_known("section", sections, ("joy",), f"{file}: ")
    joy = sections.get("joy", {})
    fields = tuple(item.name for item in dataclasses.fields(JoyBindings))
    require_known("field", joy if isinstance(joy, dict) else (), fields, f"{file}: joy: ")
    with blaming(f"{file}: joy", msgspec.ValidationError):
        return PadLayout(msgspec.convert(joy, JoyBindings))


def _ros_parameters(document: dict[str, Any]) -> dict[str, Any] | None:
    """Return `joy.*` of a ROS 2 parameter file; None if it has no parameters of the node `mode_manager`."""
    nodes = [document[name] for name in ("/**", "mode_manager") if isinstance(document.get(name), dict)]
    sections = [node["ros__parameters"] for node in nodes if isinstance(node.get("ros__parameters"), dict)]
    joy: dict[str, Any] = {}
    for parameters in sections:  # a node's own override those of every node
        nested = parameters.get("joy", {})
        joy |= nested if isinstance(nested, dict) else {}
        joy |= {name.removeprefix("joy."): value for name, value in parameters.items() if name.startswith("joy.")}
    return {"joy": joy} if sections else None
