"""Buttons and sticks of a gamepad: bindings from a file, and the velocity that sticks command."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from humanoid_sim.controllers.joy import JoyBindings
from humanoid_sim.errors import FieldError, blaming, require_known
from humanoid_sim.frontends.pads import BUTTON_COUNT
from humanoid_sim.messages import SessionHeader
from humanoid_sim.mit import FloatArray
from humanoid_sim.stack import recorded_contracts
from humanoid_sim.strict_yaml import converted, read_yaml

_MODEST = ((-0.3, 0.5), (-0.2, 0.2), (-0.5, 0.5))  # m/s, m/s, rad/s: for a policy that does not say which it knows
_DEAD_ZONE = 0.15  # part of a stick's way, from its middle, that counts as none
_FORWARD, _LEFT, _TURN = 1, 0, 2  # axes: left stick up, left stick left, right stick left, where they are -1


def policy_speeds(header: SessionHeader) -> FloatArray | None:
    """Return lowest and highest vx, vy (m/s) and yaw rate (rad/s), shape (3, 2), of a run's first policy that walks.

    None if no policy takes a velocity.
    """
    contract = next((one for one in recorded_contracts(header) if one.takes_velocity_command), None)
    if contract is None:
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


def _mapping(value: Any) -> dict[str, Any]:
    return {str(key): inner for key, inner in value.items()} if isinstance(value, dict) else {}


def read_bindings(file: Path) -> JoyBindings:
    """Return the bindings below `joy:` of a file, or `joy.*` of `mode_manager` in a ROS 2 parameter file.

    Raises `InputError` if the file holds none, or binds a button that no gamepad has.
    """
    with blaming(file, FieldError):
        document, fields = _mapping(read_yaml(file)), dict[str, Any]()
        nodes = [name for name in document if name.rpartition("/")[2] in ("**", "mode_manager")]
        nodes.sort(key=lambda name: not name.endswith("**"))  # a node's own parameters override those of every node
        for parameters in (document, *(_mapping(_mapping(document[name]).get("ros__parameters")) for name in nodes)):
            fields |= _mapping(parameters.get("joy"))
            fields |= {key.removeprefix("joy."): value for key, value in parameters.items() if key.startswith("joy.")}
        if not fields:
            raise FieldError("binds no buttons, expected a mapping joy: with damp_button: N and its like")
        known = [item.name for item in dataclasses.fields(JoyBindings)]
        require_known("field of joy", fields, known, f"{file}: ")
        joy = converted(fields, JoyBindings, f"{file}: joy")
        joy.check(BUTTON_COUNT)
    return joy
