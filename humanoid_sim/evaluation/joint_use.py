"""Use of each joint in a run: its greatest speed and effort, and the positions that it reached, with its limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from humanoid_sim.mit import FloatArray, MITState

_ROUNDING = 1e-9
"""Share of an effort limit below which a torque still counts as being at it."""


class JointUse:
    """Accumulates states; in constant memory. Values that are no numbers are left out."""

    def __init__(self, names: Sequence[str], effort_limit: FloatArray, lower: FloatArray, upper: FloatArray) -> None:
        """Start empty, for n joints. All limits are (n,), joint frame, and infinite where there is none.

        Effort limits are in N·m, those of positions, lower and upper, in rad.
        """
        self._names = tuple(names)
        self._limit = np.asarray(effort_limit)
        self._at_limit = self._limit * (1.0 - _ROUNDING)
        count = len(self._names)
        self._bounds = lower, upper
        self._effort = np.zeros(count)
        self._speed = np.zeros(count)
        self._lowest = np.full(count, np.inf)
        self._highest = np.full(count, -np.inf)
        self.saturated = 0
        """States in which a joint was at its effort limit."""

    def update(self, state: MITState) -> None:
        """Take one state into account."""
        effort = np.abs(state.joint_effort)
        np.fmax(self._effort, effort, out=self._effort)
        np.fmax(self._speed, np.abs(state.joint_velocity), out=self._speed)
        np.fmin(self._lowest, state.joint_position, out=self._lowest)
        np.fmax(self._highest, state.joint_position, out=self._highest)
        self.saturated += bool((effort >= self._at_limit).any())

    def effort(self) -> dict[str, Any]:
        """N·m, JSON: the largest, the one closest to its limit, and the joints whose limit nobody knows."""
        known = np.isfinite(self._limit)
        largest = self._place(self._effort)
        closest = self._place(np.where(known, self._effort / self._limit, -1.0)) if known.any() else None
        without = self._place(np.where(known, -1.0, self._effort)) if not known.all() else None
        return {
            "largest": 0.0 if largest is None else float(self._effort[largest]),
            "joint": "" if largest is None else self._names[largest],
            "closest": None if closest is None else self._effort_of(closest),
            "largest_without_limit": None if without is None else self._effort_of(without),
            "without_limit": [name for name, is_known in zip(self._names, known, strict=True) if not is_known],
            "joints": len(self._names),
            "saturated_ticks": self.saturated,
        }

    def rows(self) -> list[dict[str, Any]]:
        """Joint by joint, JSON: rad/s, N·m, rad, and how much of its range it used, 0 to 1; None where unknown."""
        found = []
        for i, name in enumerate(self._names):
            low, high = float(self._lowest[i]), float(self._highest[i])
            lower, upper = float(self._bounds[0][i]), float(self._bounds[1][i])
            seen, bounded = high >= low, np.isfinite(upper - lower)
            found.append(
                {
                    "joint": name,
                    "speed": float(self._speed[i]),
                    "effort": float(self._effort[i]),
                    "effort_limit": float(self._limit[i]) if np.isfinite(self._limit[i]) else None,
                    "lowest": low if seen else None,
                    "highest": high if seen else None,
                    "lower": lower if np.isfinite(lower) else None,
                    "upper": upper if np.isfinite(upper) else None,
                    "range_share": (high - low) / (upper - lower) if seen and bounded and upper > lower else None,
                }
            )
        return found

    def _place(self, values: FloatArray) -> int | None:
        return int(values.argmax()) if len(values) else None

    def _effort_of(self, i: int) -> dict[str, Any]:
        limit = float(self._limit[i])
        return {
            "joint": self._names[i],
            "effort": float(self._effort[i]),
            "limit": limit if np.isfinite(limit) else None,
        }


def describe_effort(figures: dict[str, Any]) -> str:
    """Return what `JointUse.effort` says, such as `37.1 of 88 N·m at left_knee_joint, 0 ticks at an effort limit`.

    A torque beside which no limit is known says so: nothing in the run shows that a motor could bear it.
    """
    closest, without = figures["closest"], figures["largest_without_limit"]
    give = "give effort_limit in the contract"
    if closest is None:
        at = f" at {figures['joint']}" if figures["joint"] else ""
        return f"{figures['largest']:.1f} N·m{at}; NO EFFORT LIMIT KNOWN ({give})"
    text = (
        f"{closest['effort']:.1f} of {closest['limit']:g} N·m at {closest['joint']}, "
        f"{figures['saturated_ticks']} ticks at an effort limit"
    )
    if without is None:
        return text
    return (
        f"{text}; NO EFFORT LIMIT KNOWN for {len(figures['without_limit'])} of {figures['joints']} joints, at most "
        f"{without['effort']:.1f} N·m at {without['joint']} ({give})"
    )
