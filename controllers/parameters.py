"""Checks of parameters, states and commands. One form of message: `Type.field: is VALUE, expected WHAT IS ACCEPTED`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from humanoid_sim.errors import FieldError, known_names
from humanoid_sim.mit import COMMAND_FIELDS, BoolArray, FloatArray, IndexArray, MITCommand, MITState, frozen_array

LARGEST_COMMAND = 1e6
"""In each field's own unit: far beyond any motor, and small enough that no sum or product of two overflows."""
_FIRST_GAIN = COMMAND_FIELDS.index("stiffness")  # from here on fields are not negative


def require(is_accepted: Any, field: str, value: object, accepted: str) -> None:
    """Raise `FieldError` unless the value of a field is accepted."""
    if not is_accepted:
        raise FieldError(f"{field}: is {value}, expected {accepted}")


def require_fields(where: str, instance: object, checks: Mapping[str, tuple[Any, str]]) -> None:
    """Raise `FieldError` for the first field that is not accepted; by its name, whether it is, and what would be."""
    for name, (is_accepted, accepted) in checks.items():
        require(is_accepted, f"{where}.{name}", getattr(instance, name), accepted)


def one_of(owner: str, name: str, value: object, choices: Any) -> None:
    """Raise `FieldError` unless the value is one of the words of a `Literal`."""
    require(value in get_args(choices), f"{owner}.{name}", repr(value), f"one of {', '.join(get_args(choices))}")


def require_names(field: str, names: Sequence[str], known: Iterable[str] | None = None) -> None:
    """Raise `FieldError` unless there is one name or more, none twice, and each is among those known, if given."""
    wrong = sorted({name for name in names if names.count(name) > 1 or (known is not None and name not in known)})
    accepted = "names" if known is None else f"names of {', '.join(known)}"
    require(names and not wrong, field, ", ".join(wrong) or "empty", f"{accepted}: one or more, none twice")


def joint_indices(wanted: tuple[str, ...], available: tuple[str, ...], what: str) -> IndexArray:
    """Return the positions of the `wanted` joints among the `available` ones; `FieldError` for a missing joint."""
    for name in wanted:
        if name not in available:
            raise FieldError(f"{known_names('joint', name, available)} ({what})")
    indices = np.array([available.index(name) for name in wanted], dtype=np.intp)
    indices.setflags(write=False)
    return indices


def per_joint(
    owner: str,
    name: str,
    values: npt.ArrayLike,
    joints: tuple[str, ...],
    accepts: Callable[[FloatArray], BoolArray] = np.isfinite,
    accepted: str = "a finite number",
) -> FloatArray:
    """Return a read-only array of shape (n,) from one number per joint, or from one for all of them."""
    array = frozen_array(owner, name, values)
    if array.ndim == 0:
        array = frozen_array(owner, name, np.full(len(joints), array))
    if array.shape != (len(joints),):
        raise FieldError(f"{owner}.{name}: has shape {array.shape}, expected ({len(joints)},), one value per joint")
    if wrong := np.flatnonzero(~accepts(array)).tolist():
        others = f" and {len(wrong) - 1} more" if len(wrong) > 1 else ""
        require(False, f"{owner}.{name}", f"{array[wrong[0]]} for {joints[wrong[0]]}{others}", accepted)
    return array


def time_problem(state: MITState) -> str:
    """Return what is wrong with the time of a state; else ''."""
    return "" if np.isfinite(state.time) else f"time is {state.time}, expected a finite number"


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
    row, joint = np.argwhere(~sound)[0]
    least = 0.0 if row >= _FIRST_GAIN else -LARGEST_COMMAND
    field, value = f"command's {COMMAND_FIELDS[row]} of {joints[joint]}", values[row, joint]
    return f"{field} is {value}, expected a finite number from {least:g} to {LARGEST_COMMAND:g}"
