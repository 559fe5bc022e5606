"""Values and names of joints as messages of one line show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

_LISTED = 4


def shown(value: Any, width: int = 60) -> str:
    """Return a value as a person would write it, in at most `width` characters."""
    if value is None or isinstance(value, bool):
        return {None: "none", True: "true", False: "false"}[value]
    if isinstance(value, np.ndarray):
        if value.size > 1 and (value == value.flat[0]).all():
            return f"{value.flat[0]:g} everywhere"
        value = value.tolist()
    if isinstance(value, list | tuple) and all(isinstance(item, str | float | int) for item in value):
        text = f"[{', '.join(item if isinstance(item, str) else f'{item:g}' for item in value)}]"
    else:
        text = f"{value:g}" if isinstance(value, float) else str(value)
    return text if len(text) <= width else text[: width - 3] + "..."


def name_joints(names: Sequence[str], every: Sequence[str] = ()) -> str:
    """Return joints in few words: `all 29 joints`, or the first ones and how many more."""
    if len(names) == len(every) > 1:
        return f"all {len(names)} joints"
    listed = ", ".join(names[:_LISTED])
    return listed if len(names) <= _LISTED else f"{listed} and {len(names) - _LISTED} more"
