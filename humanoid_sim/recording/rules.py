"""Rules of the control stack that were corrected after recordings had been made with the old ones.

A recording's header names the corrected rules that were in force. Where a tick differs on replay, and a correction that
the recording lacks is what the tick turns on, the replay says so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from humanoid_sim.controllers.base import DAMPING, REMOTE_POLICY, RL_POLICY
from humanoid_sim.controllers.parameters import LARGEST_COMMAND
from humanoid_sim.messages import Intent, SessionHeader, TickInput, TickOutput
from humanoid_sim.strict_json import parse_json

__all__ = ["CORRECTIONS", "Correction", "shown_correction"]


@dataclass(frozen=True, slots=True)
class Correction:
    """A rule that is not what it was."""

    name: str
    """In headers."""
    text: str
    """What it said, and what it says, for an operator."""
    shows: Callable[[TickInput, TickOutput, TickOutput], bool]
    """Whether a tick that differs turns on it: its input, what was recorded, and what it gives now."""


def _absurd_reading(given: TickInput, recorded: TickOutput, replayed: TickOutput) -> bool:
    position = np.abs(given.state.joint_position)
    is_absurd = bool((np.isfinite(position) & (position > LARGEST_COMMAND)).any())
    failed, fails = ({fault.controller for fault in output.faults} for output in (recorded, replayed))
    return is_absurd and bool((failed - fails) & {DAMPING, REMOTE_POLICY})


def _started_unfed(given: TickInput, recorded: TickOutput, replayed: TickOutput) -> bool:
    failed = any(fault.controller == RL_POLICY for fault in recorded.faults)
    return failed and Intent.START_LOCOMOTION in given.intents and not replayed.faults and bool(replayed.refusals)


CORRECTIONS = (
    Correction(
        "damping_on_absurd_readings",
        f"a joint position beyond {LARGEST_COMMAND:g} rad made DAMPING, and REMOTE's passive hold, give way to "
        "ZERO_TORQUE; now they damp, because at K_p 0 the position does not matter",
        _absurd_reading,
    ),
    Correction(
        "start_waits_for_live_inputs",
        "START_LOCOMOTION without a fresh value of a live input that the policy observes was granted, and ended in "
        "DAMPING in the same tick; now it is refused",
        _started_unfed,
    ),
)

"""In the order in which they were made. Append; the names are in headers."""


def shown_correction(
    header: SessionHeader, given: TickInput, recorded: TickOutput, replayed: TickOutput
) -> Correction | None:
    """The correction, made since a recording, that a tick which differs turns on; None if none does."""
    try:
        document = parse_json(header.documents.get("controllers", "{}"))
        known = document.get("corrections", ()) if isinstance(document, dict) else ()
    except ValueError:
        known = ()
    made_since = (one for one in CORRECTIONS if one.name not in known)
    return next((one for one in made_since if one.shows(given, recorded, replayed)), None)
