"""What a recording says of the options that it was made with: a document of its header, and anybody's text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from humanoid_sim.errors import InputError
from humanoid_sim.messages import SessionHeader
from humanoid_sim.strict_json import parse_json


def recorded_settings(path: str | Path, header: SessionHeader) -> dict[str, Any]:
    """The settings of a run; empty if its header says nothing.

    Args:
        path: of the recording, for messages.
        header: of the recording.

    Raises:
        InputError: what it says is no JSON object.
    """
    try:
        settings = parse_json(header.documents.get("settings", "{}"))
    except ValueError as error:
        raise InputError(f"{path}: its header's 'settings' are no JSON: {error}") from None
    if not isinstance(settings, dict):
        raise InputError(f"{path}: its header's 'settings' are a {type(settings).__name__}, expected a JSON object")
    return settings
