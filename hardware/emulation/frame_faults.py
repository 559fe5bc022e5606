"""What becomes of frames on the way between the bus and a motor while faults are active."""

from __future__ import annotations

import random
from dataclasses import replace

from humanoid_sim.hardware.robstride.frames import Frame

__all__ = ["FrameFaults"]


class FrameFaults:
    """Loses, delays, doubles, swaps and damages frames. Draws from a generator of its own, so runs can be repeated.

    A motor is an index. Without an active fault nothing is drawn and nothing changes.
    """

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._active: dict[int, dict[str, float]] = {}
        self._held: dict[int, Frame] = {}

    def begin(self, kind: str, motor: int, amount: float) -> None:
        """A fault of the scope `frames` sets in; `amount` as in `FAULTS`."""
        self._active.setdefault(motor, {})[kind] = amount

    def end(self, kind: str, motor: int) -> None:
        """It is over."""
        active = self._active.get(motor, {})
        active.pop(kind, None)
        if not active:
            self._active.pop(motor, None)

    def reaches(self, motor: int) -> bool:
        """Whether a frame that has come over the bus reaches the motor."""
        active = self._active.get(motor)
        return not active or not self._happens(active.get("lost", 0.0))

    def arrivals(self, motor: int, frame: Frame, time: float) -> list[tuple[float, Frame]]:
        """When, s, and how often and in what shape a motor's frame arrives that came over the bus at `time`."""
        held = self._held.pop(motor, None)
        late = [] if held is None else [(time, held)]
        active = self._active.get(motor)
        if not active:
            return [(time, frame), *late]
        if self._happens(active.get("lost", 0.0)):
            return late
        if "corrupted_id" in active:
            frame = replace(frame, arbitration_id=frame.arbitration_id ^ 1 << int(active["corrupted_id"]))
        if "corrupted_dlc" in active:
            length = int(active["corrupted_dlc"])
            frame = replace(frame, data=frame.data[:length].ljust(length, b"\0"))
        if held is None and self._happens(active.get("reordered", 0.0)):
            self._held[motor] = frame
            return late
        time += active.get("delayed", 0.0)
        copies = 1 + self._happens(active.get("duplicated", 0.0))
        return [*[(time, frame)] * copies, *late]

    def _happens(self, probability: float) -> bool:
        return probability > 0.0 and self._random.random() < probability
