"""JSON from strangers: the standard library's reader with one kind of error for all that can be wrong."""

from __future__ import annotations

import json
from typing import Any

from humanoid_sim.errors import reason_of


def parse_json(text: str | bytes) -> Any:
    """Return the document that a text holds.

    Raises:
        ValueError: it is none; one line.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("is nested too deeply") from None
    except ValueError as error:
        raise ValueError(reason_of(error)) from None
