"""What figures of a run mean, in words that files keep: figures of other definitions are not to be compared."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from humanoid_sim.evaluation.failure import (
    FALLEN_HEIGHT,
    FALLEN_TILT,
    STRAYED_DISTANCE,
    STRAYED_HEIGHT,
    STRAYED_TILT,
)

DEFINITIONS: Mapping[str, str] = MappingProxyType(
    {
        "fall": f"the centre of mass is below {FALLEN_HEIGHT:g} of the height above the floor at which it stands, or "
        f"the axis of the base that then points up leans by more than {FALLEN_TILT:g} rad",
        "loss": f"a tracked body is more than {STRAYED_DISTANCE:g} m from the motion, or the anchor body is more than "
        f"{STRAYED_HEIGHT:g} m off its height or leans by more than {STRAYED_TILT:g} rad against it",
        "errors": "the pose in the very tick in which a frame is shown, less that frame; each frame once, the last too",
    }
)
"""By name. A change of what is measured changes these words."""


def differing(recorded: Mapping[str, str]) -> tuple[str, ...]:
    """Names of the definitions that a file was made with others of; all of them if it says nothing."""
    return tuple(name for name, text in DEFINITIONS.items() if recorded.get(name) != text)
