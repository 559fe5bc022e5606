"""Layout of a gamepad: which buttons ask for what, and which axes steer; from a file, or as options."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from humanoid_sim.controllers.contract import PolicyContract
from humanoid_sim.controllers.joy import JoyBindings
from humanoid_sim.errors import FieldError, InputError, blaming, require_known
from humanoid_sim.mit import FloatArray
from humanoid_sim.strict_yaml import read_yaml

SpeedRange = npt.NDArray[np.float64]
"""Shape (3, 2): lowest and highest vx, vy (m/s) and yaw rate (rad/s), zero among them."""

_MODEST = ((-0.3, 0.5), (-0.2, 0.2), (-0.5, 0.5))
"""Speeds for a policy that does not say which it knows, as in `SpeedRange`."""


@dataclass(frozen=True, slots=True)
class Sticks:
    """Axis indices as in `sensor_msgs/Joy`, up and left being -1, and what counts as a stick at rest."""

    forward_axis: int = 1
    """Left stick, up."""
    left_axis: int = 0
    """Left stick, left."""
    turn_axis: int = 2
    """Right stick, left."""
    dead_zone: float = 0.15
    """Part of a stick's way, from its middle, that counts as none."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.dead_zone < 1.0:
            raise FieldError(f"dead_zone: is {self.dead_zone}, expected 0 or more, below 1")
        if min(self.axes) < 0:
            raise FieldError(f"axes: are {self.axes}, expected indices >= 0")

    @property
    def axes(self) -> tuple[int, int, int]:
        """Forward, left, turn."""
        return self.forward_axis, self.left_axis, self.turn_axis

    def velocity(self, axes: Sequence[float], speeds: SpeedRange) -> FloatArray:
        """Shape (3,), vx and vy in m/s and yaw rate in rad/s; an axis that the gamepad lacks is at rest.

        Beyond the dead zone the command grows linearly from zero, to the policy's limit at the end of the way.
        """
        pushed = np.array([-axes[i] if i < len(axes) else 0.0 for i in self.axes])
        beyond = np.clip((np.abs(pushed) - self.dead_zone) / (1.0 - self.dead_zone), 0.0, 1.0)
        velocity: FloatArray = np.where(pushed > 0.0, speeds[:, 1], -speeds[:, 0]) * np.sign(pushed) * beyond
        return velocity


def policy_speeds(contract: PolicyContract | None) -> SpeedRange | None:
    """Give what full sticks command of a policy; None where it takes no velocity."""
    walks = contract is not None and contract.takes_velocity_command
    return speed_range(contract.command_ranges) if walks and contract is not None else None


def speed_range(ranges: FloatArray | None) -> SpeedRange:
    """Return what full sticks command: the contract's ranges (3, 2), else modest ones."""
    known = np.array(_MODEST if ranges is None else ranges, dtype=np.float64)
    return np.stack([np.minimum(known[:, 0], 0.0), np.maximum(known[:, 1], 0.0)], axis=1)


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

    Raises `InputError` if both are given, or the file holds no layout.

    Args:
        file: YAML with `joy:` and `sticks:`, or a ROS 2 parameter file with `joy.*` of `mode_manager`; None for none.
        option: that names the file, for the message.
    """
    if file is None:
        return given
    if given.options():
        raise InputError(f"{option} and {given.options()[0]}: both say where the buttons are, expected one of them")
    document = read_yaml(file)
    if not isinstance(document, dict) or not document:
        raise InputError(f"{file}: has no buttons, expected a mapping joy: with damp_button: N and its like")
    joy = _joy_parameters(document)
    sections = document if joy is None else {"joy": joy}
    require_known("section", sections, ("joy", "sticks"), f"{file}: ")
    return PadLayout(
        _section(file, "joy", sections.get("joy", {}), JoyBindings),
        _section(file, "sticks", sections.get("sticks", {}), Sticks),
    )


def _joy_parameters(document: dict[str, Any]) -> dict[str, Any] | None:
    """Return `joy.*` of a ROS 2 parameter file, by name; None if it has no parameters of the node `mode_manager`."""
    nodes = [document[name] for name in ("/**", "mode_manager") if isinstance(document.get(name), dict)]
    sections = [node["ros__parameters"] for node in nodes if isinstance(node.get("ros__parameters"), dict)]
    if not sections:
        return None
    joy: dict[str, Any] = {}
    for parameters in sections:  # a node's own override those of every node
        nested = parameters.get("joy", {})
        joy |= nested if isinstance(nested, dict) else {}
        joy |= {name.removeprefix("joy."): value for name, value in parameters.items() if name.startswith("joy.")}
    return joy


def _section(file: Path, name: str, values: Any, kind: type[_Section]) -> _Section:
    fields = tuple(item.name for item in dataclasses.fields(kind))
    require_known("field", values if isinstance(values, dict) else (), fields, f"{file}: {name}: ")
    with blaming(f"{file}: {name}", msgspec.ValidationError):
        return msgspec.convert(values, kind)
