"""JSON from strangers: the standard library's reader with one kind of error for all that can be wrong; and for them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from humanoid_sim.errors import reason_of


def parse_json(text: str | bytes) -> Any:
    """Return the document that a text holds. Raises `ValueError`, of one line, if it holds none."""
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    except ValueError as error:
        raise ValueError(reason_of(error)) from None


def finite(value: Any) -> Any:
    """Return plain values with null in the place of NaN and infinity, which JSON does not know."""
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    if isinstance(value, Mapping):
        return {name: finite(item) for name, item in value.items()}
    return [finite(item) for item in value] if isinstance(value, list | tuple) else value
