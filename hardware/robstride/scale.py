"""How physical values become 16-bit fields, in the two conventions that are in use.

`REFERENCE` (Actuator-Control, robstride_dynamics, motorbridge) has 65534 steps: raw 32767 is exactly zero and 65535 is
never sent. `MANUAL` (the manuals and the vendor's samples) has 65535 steps and no raw value for zero. The two differ by
0 at raw 0, by half a step in the middle and by one step at full scale. Everything here uses REFERENCE unless told
otherwise, because a zero effort and a zero velocity must arrive as zero where the same convention reads them; a motor
that reads with MANUAL takes a commanded 0 for half a step below it (2e-4 rad, 3e-4 N·m on an rs-02).

Both truncate, so that what is read back lies up to one step below what was sent. Gains have one convention only.
"""

from __future__ import annotations

import math
from enum import Enum

__all__ = ["SIGNED_STEPS", "UNSIGNED_STEPS", "Scale", "from_unsigned", "to_unsigned"]

UNSIGNED_STEPS = 65535
SIGNED_STEPS = 32767
"""Steps from zero to full scale in the reference's convention."""


class Scale(Enum):
    """Convention of the signed fields: position, velocity and effort."""

    REFERENCE = "reference"
    MANUAL = "manual"

    def to_raw(self, value: float, limit: float) -> int:
        """The raw field of a finite value, cut off at ±limit: 0 to 65534 (REFERENCE) or 65535 (MANUAL)."""
        value = min(max(value, -limit), limit)
        if self is Scale.REFERENCE:
            return math.trunc((value / limit + 1.0) * SIGNED_STEPS)
        return math.trunc((value + limit) * UNSIGNED_STEPS / (2.0 * limit))

    def from_raw(self, raw: int, limit: float) -> float:
        """The value of a raw field, 0 to 65535. In REFERENCE the last step lies beyond the limit by 0.003 %."""
        if self is Scale.REFERENCE:
            return (raw / SIGNED_STEPS - 1.0) * limit
        return (2.0 * raw / UNSIGNED_STEPS - 1.0) * limit


def to_unsigned(value: float, limit: float) -> int:
    """The raw field of a finite gain, cut off at 0 and at the limit: 0 to 65535. A gain below one step becomes 0."""
    return math.trunc(min(max(value, 0.0), limit) / limit * UNSIGNED_STEPS)


def from_unsigned(raw: int, limit: float) -> float:
    """The gain of a raw field, 0 to 65535."""
    return raw * limit / UNSIGNED_STEPS
