"""Validation of parameters, joint names and commands; one message form, `Controller.parameter: what is wrong`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.mit import COMMAND_FIELDS, FloatArray, IndexArray, MITCommand, MITState, frozen_array

LARGEST_COMMAND = 1e6
"""In each field's own unit: far beyond any motor, and small enough that no sum or product of two overflows."""

_FIRST_GAIN = COMMAND_FIELDS.index("stiffness")
"""The gains are the last of the command's fields; they are not negative."""


def joint_tuple(
    owner: str, joints: Iterable[str], name: str = "joints", *, may_be_empty: bool = False
) -> tuple[str, ...]:
    """Names of joints (or of terms, bodies) as a tuple; at least one unless `may_be_empty`, none twice."""
    if isinstance(joints, str) or not isinstance(joints, Iterable):
        raise FieldError(f"{owner}.{name}: is {joints!r}, expected a sequence of names")
    result = tuple(joints)
    if not result and not may_be_empty:
        raise FieldError(f"{owner}.{name}: is empty, expected at least one name")
    for joint in result:
        if not isinstance(joint, str) or not joint:
            raise FieldError(f"{owner}.{name}: holds {joint!r}, expected names")
    twice = sorted({joint for joint in result if result.count(joint) > 1})
    if twice:
        raise FieldError(f"{owner}.{name}: names {', '.join(twice)} more than once")
    return result


def joint_indices(wanted: tuple[str, ...], available: tuple[str, ...], what: str) -> IndexArray:
    """Positions of the `wanted` joints among the `available` ones.

    Raises `FieldError` naming the joint that is missing and those that exist.
    """
    place = {name: i for i, name in enumerate(available)}
    for name in wanted:
        if name not in place:
            raise FieldError(f"{known_names('joint', name, available)} ({what})")
    indices = np.array([place[name] for name in wanted], dtype=np.intp)
    indices.setflags(write=False)
    return indices


def number(owner: str, name: str, value: float, minimum: float = 0.0, *, above: bool = False) -> float:
    """Return a finite number that is at least (or, with `above`, greater than) `minimum`."""
    accepted = f"a finite number {'>' if above else '>='} {minimum:g}"
    if isinstance(value, bool) or not isinstance(value, int | float | np.floating | np.integer):
        raise FieldError(f"{owner}.{name}: is {value!r}, expected {accepted}")
    result = float(value)
    if not np.isfinite(result) or result < minimum or (above and result == minimum):
        raise FieldError(f"{owner}.{name}: is {value}, expected {accepted}")
    return result


def one_of(owner: str, name: str, value: object, choices: Any) -> None:
    """Raise `FieldError` unless the value is one of the words of a `Literal`."""
    if value not in get_args(choices):
        raise FieldError(f"{owner}.{name}: is {value!r}, expected one of {', '.join(get_args(choices))}")


def per_joint(
    owner: str,
    name: str,
    values: npt.ArrayLike,
    joints: tuple[str, ...],
    *,
    minimum: float = -np.inf,
) -> FloatArray:
    """Read-only array of shape (n,) from one finite number per joint, or from one for all of them."""
    array = frozen_array(owner, name, values)
    if array.ndim == 0:
        array = frozen_array(owner, name, np.full(len(joints), array))
    if array.shape != (len(joints),):
        raise FieldError(f"{owner}.{name}: has shape {array.shape}, expected ({len(joints)},), one value per joint")
    wrong = ~np.isfinite(array) | (array < minimum)
    if wrong.any():
        i = int(np.argmax(wrong))
        accepted = "a finite number" if minimum == -np.inf else f"a finite number >= {minimum:g}"
        raise FieldError(f"{owner}.{name}: is {array[i]} for {joints[i]}, expected {accepted}")
    return array


def joints_problem(state: MITState, joints: tuple[str, ...]) -> str:
    """Return what is wrong with the number of joints that a robot's state has; else ''."""
    shape = state.joint_position.shape
    return "" if shape == (len(joints),) else f"state has {shape} joint positions, expected ({len(joints)},)"


def state_problem(state: MITState, joints: tuple[str, ...]) -> str:
    """Return what is wrong with the number of joints, or the time, of a robot's state; else ''."""
    known = np.isfinite(state.time)
    return joints_problem(state, joints) or ("" if known else f"time is {state.time}, expected a finite number")


def command_problem(command: MITCommand, joints: tuple[str, ...]) -> str:
    """Return what keeps a command from being sent: a shape, a value that is out of bounds or not finite; else ''."""
    if command.position.shape != (len(joints),):
        return f"command has shape {command.position.shape}, expected ({len(joints)},)"
    # One array for all fields: this runs in every tick, and small arrays cost by the call.
    values = np.array([getattr(command, name) for name in COMMAND_FIELDS])
    sound = np.abs(values) <= LARGEST_COMMAND
    sound[_FIRST_GAIN:] &= values[_FIRST_GAIN:] >= 0.0
    if sound.all():
        return ""
    row, joint = (int(index[0]) for index in np.nonzero(~sound))
    least = 0.0 if row >= _FIRST_GAIN else -LARGEST_COMMAND
    return (
        f"command's {COMMAND_FIELDS[row]} of {joints[joint]} is {values[row, joint]}, "
        f"expected a finite number from {least:g} to {LARGEST_COMMAND:g}"
    )
