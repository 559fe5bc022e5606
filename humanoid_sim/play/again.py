"""Play again what a recording holds: its policy on its robot, with its motion or its command."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from typing import Any

from humanoid_sim.errors import InputError
from humanoid_sim.play.config import PlayConfig
from humanoid_sim.policy.motion import ATTACHMENT
from humanoid_sim.recording.reader import open_recording

__all__ = ["again"]

_REPEATED = (
    "policy",
    "contract",
    "robot",
    "command",
    "yaw",
    "base_height",
    "action_limit",
    "actuation",
    "control_frequency",
    "physics_timestep",
    "command_delay",
    "state_delay",
    "state_sampling",
)
"""Options that are taken from the recording."""


def again(config: PlayConfig) -> PlayConfig:
    """The options of `config`, and the recording's where they were left as they are by default.

    What the run looked like, where it was written to and who drove it are not taken from there.

    Raises:
        InputError: the recording cannot be read, or does not say what it was made with.
    """
    if config.again is None:
        return config
    header = open_recording(config.again).header
    recorded = _options(config.again, header.documents.get("settings", ""))
    known = {field.name: field for field in fields(config)}
    values = {
        name: recorded[name] for name in _REPEATED if name in recorded and getattr(config, name) == known[name].default
    }
    if config.motion is None and ATTACHMENT in header.attachments:
        values["motion"] = config.again  # a recording is read as the motion that it was made with
    return replace(config, **values)


def _options(path: str, settings: str) -> dict[str, Any]:
    """The options that a recording was made with, those that `play` knows and of a kind that it takes."""
    try:
        options = json.loads(settings)["options"]
    except (ValueError, LookupError, TypeError):
        options = None
    if not isinstance(options, dict):
        raise InputError(
            f"--again: '{path}' does not say what it was made with, expected a recording of play or regress"
        )
    for field in fields(PlayConfig):
        value = options.get(field.name, field.default)
        kinds = {type(field.default), str, float} if field.default is None else {type(field.default), int}
        if value is not None and type(value) not in kinds and field.name in _REPEATED:
            raise InputError(f"--again: '{path}' was made with {field.name} {value!r}, which is no such option")
    return options
