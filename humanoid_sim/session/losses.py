"""Losses that damp the robot: of the operator's device, and of the loop's own time while its process stood still.

What drove the robot before a standstill must not drive it after: the motors have stopped by themselves meanwhile, the
arms have sunk, and nobody knows what the operator did about it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from time import CLOCK_BOOTTIME, clock_gettime

from humanoid_sim.messages import Intent, Mode, TickOutput
from humanoid_sim.session.sources import IntentSource

DEVICE_TIMEOUT = 0.2  # s without a heartbeat after which a device is lost


class DeviceWatch(IntentSource):
    """Requests DAMP when a device's heartbeats stop, and whenever the robot is led out of DAMPING without it."""

    def __init__(self, name: str, heartbeats: Callable[[], Mapping[str, float]], tell: Callable[[str], None]) -> None:
        """Watch the producer of that name; `heartbeats` are each producer's latest arrival, s, robot's clock."""
        self._name, self._heartbeats, self._tell = name, heartbeats, tell
        self._is_lost = False
        self._polled = self._resumed = -math.inf

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        if time - self._polled > DEVICE_TIMEOUT:  # motors were being enabled: heartbeats waited, and are as old as that
            self._resumed = time
        self._polled = time
        arrival = self._heartbeats().get(self._name)
        drives = output is not None and output.control_mode.mode not in (Mode.ZERO_TORQUE, Mode.DAMPING)
        if arrival is None:  # missing, but not lost: only driven joints are damped
            is_lost = drives
        else:  # only a new heartbeat ends a loss
            is_lost = not time - (arrival if self._is_lost else max(arrival, self._resumed)) <= DEVICE_TIMEOUT
        was_lost, self._is_lost = self._is_lost, is_lost
        if is_lost and not was_lost:
            self._tell(f"{self._name}: lost, no heartbeat for {DEVICE_TIMEOUT:g} s: DAMP")
            return (Intent.DAMP,)
        if was_lost and not is_lost and arrival is not None:
            self._tell(f"{self._name}: there again")
        return (Intent.DAMP,) if is_lost and drives else ()


_UPTIME = partial(clock_gettime, CLOCK_BOOTTIME)  # s, with the time for which the computer was suspended


class Interruption(IntentSource):
    """Requests DAMP in the tick that follows a standstill, and when a terminal wants to suspend the process."""

    def __init__(self, longest: float, tell: Callable[[str], None], clock: Callable[[], float] = _UPTIME) -> None:
        """Begin at the first tick; beyond `longest` s between two signs of life the loop stood still."""
        self._longest, self._tell, self._clock = longest, tell, clock
        self._last: float | None = None
        self._damps = self._is_refused = False

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        self.stood_still()
        if self._is_refused:
            self._damps, self._is_refused = True, False
            self._tell("SIGTSTP (Ctrl-Z): a process that holds motors is not suspended; DAMPING instead")
        damps, self._damps = self._damps, False
        return (Intent.DAMP,) if damps else ()

    def stood_still(self) -> bool:
        """Return True if the loop has stood still since the last call."""
        now = self._clock()
        last, self._last = self._last, now
        if last is None or now - last <= self._longest:
            return False
        self._damps = True
        self._tell(f"the process stood still for {now - last:.2f} s: DAMPING; motors may have stopped by themselves")
        return True

    def refuse_suspension(self) -> None:
        """Damp instead of suspending the process. Takes no lock: signal handlers call it."""
        self._is_refused = True

    def restart(self) -> None:
        self._last = None
