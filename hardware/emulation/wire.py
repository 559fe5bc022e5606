"""A bus and what becomes of frames on it: which of several waiting ones goes next, when it arrives, and its faults."""

from __future__ import annotations

import math
import random
from collections import deque
from dataclasses import dataclass, replace

from humanoid_sim.hardware.bus.frame import Frame, arbitration_key, frame_bits

HOST = -1
"""The node that is not a motor: the computer on the bus."""
OTHER_HOST = -2
"""Another one."""


@dataclass(frozen=True, slots=True)
class Transmission:
    """A frame that has been on the bus."""

    time: float
    """s, when the bus was free again, every receiver having taken the frame."""
    node: int
    """Sender: `HOST`, `OTHER_HOST`, or a motor's index."""
    frame: Frame


class Wire:
    """One bus: nodes with frames to send, one frame on the bus at a time.

    A node sends its own frames in the order in which they were submitted, as a driver's queue does; between nodes the
    least `arbitration_key` wins. Times never go back; events are taken one by one with `next_time` and `step`.
    """

    def __init__(self, bitrate: float) -> None:
        """Free bus; `bitrate` in bit/s, 0 for a bus on which nothing takes time and frames keep their order."""
        self._bit_time = 1.0 / bitrate if bitrate else 0.0
        self._waiting: dict[int, deque[tuple[float, int, Frame]]] = {}
        # by node: when a frame is ready, its arbitration key, the frame
        self._current: tuple[float, int, Frame] | None = None
        self._free_at = -math.inf
        self._is_hurried = False
        self.next_time = math.inf
        """s, when something happens next: a frame begins or ends. Infinity: nothing is waiting."""
        self.busy = 0.0
        """s for which the bus has been occupied."""
        self.frames = 0

    def submit(self, node: int, frame: Frame, time: float) -> None:
        """Queue a frame that is ready to be sent at `time`, s."""
        self._waiting.setdefault(node, deque()).append((time, arbitration_key(frame), frame))
        self._schedule()

    def waiting(self, node: int) -> int:
        """Frames of a node that are not yet on the bus."""
        queue = self._waiting.get(node)
        return len(queue) if queue else 0

    def clear(self) -> None:
        """Forget every frame that has not been received."""
        self._waiting.clear()
        self._current = None
        self._schedule()

    def hurry(self) -> None:
        """Let everything that waits now pass at once: the bus owes the time in which its computer did not run it."""
        self._is_hurried = bool(self._waiting)

    def _schedule(self) -> None:
        """Set `next_time` after a change: a bus is asked for it far more often than it changes."""
        if self._current is not None:
            self.next_time = self._current[0]
        else:
            ready = min([queue[0][0] for queue in self._waiting.values()], default=math.inf)
            self.next_time = max(ready, self._free_at)

    def step(self) -> Transmission | None:
        """Take the event at `next_time`: the frame that has ended there, or None if one begins."""
        if self._current is not None:
            time, node, frame = self._current
            self._current, self._free_at = None, time
            self.frames += 1
            self._schedule()
            return Transmission(time, node, frame)
        now = self.next_time
        ready = [(queue[0], node) for node, queue in self._waiting.items() if queue[0][0] <= now]
        if self._bit_time:
            (_, _, frame), node = min(ready, key=lambda entry: (entry[0][1], entry[1]))
        else:
            (_, _, frame), node = min(ready, key=lambda entry: entry[0][0])
        queue = self._waiting[node]
        queue.popleft()
        if not queue:
            del self._waiting[node]
        duration = 0.0 if self._is_hurried else frame_bits(frame) * self._bit_time if self._bit_time else 0.0
        self._is_hurried = self._is_hurried and bool(self._waiting)
        self.busy += duration
        self._current = now + duration, node, frame
        self._schedule()
        return None


class FrameFaults:
    """Loses, delays, doubles, swaps and damages frames. Draws from a generator of its own, so runs can be repeated.

    A motor is an index. Without an active fault nothing is drawn and nothing changes.
    """

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._active: dict[int, dict[str, float]] = {}
        self._held: dict[int, Frame] = {}

    def set(self, kind: str, motor: int, amount: float | None) -> None:
        """Begin a fault of the scope `frames`, `amount` as in `FAULTS`; None: end it."""
        active = {name: value for name, value in self._active.pop(motor, {}).items() if name != kind}
        if amount is not None:
            active[kind] = amount
        if active:
            self._active[motor] = active

    def reaches(self, motor: int) -> bool:
        """Return whether a frame that has come over the bus reaches the motor."""
        active = self._active.get(motor)
        return not active or not self._happens(active.get("lost", 0.0))

    def arrivals(self, motor: int, frame: Frame, time: float) -> list[tuple[float, Frame]]:
        """Return when, s, how often and in what shape a motor's frame arrives that came over the bus at `time`."""
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
