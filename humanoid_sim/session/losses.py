"""Losses that damp the robot: of the operator's device, and of the loop's own time while its process stood still.

What drove the robot before a standstill must not drive it after: the motors have stopped by themselves meanwhile, the
arms have sunk, and nobody knows what the operator did about it.
"""

from __future__ import annotations

import math
import time as system_time
from collections import deque
from collections.abc import Callable, Mapping, Sequence

from humanoid_sim.messages import Intent, Mode, TickOutput
from humanoid_sim.session.sources import IntentSource

DEVICE_TIMEOUT = 0.2  # s without a heartbeat after which a device is lost
_LATE = 1.5  # control periods after which a loop whose process was continued has missed a tick


class DeviceWatch(IntentSource):
    """Requests DAMP when the heartbeats of a device stop, and whenever the robot is led out of DAMPING without it.

    A heartbeat says that the device is there, not only the program that reads it: an unplugged device, a killed program
    and a silent radio are the same here. Before the first heartbeat the device is missing, but not lost: only driven
    joints are damped.
    """

    def __init__(self, name: str, heartbeats: Callable[[], Mapping[str, float]], tell: Callable[[str], None]) -> None:
        """Watch the producer of that name; `heartbeats` are each producer's latest arrival, s, robot's clock."""
        self._name, self._heartbeats, self._tell = name, heartbeats, tell
        self._is_lost = False
        self._polled = self._resumed = -math.inf

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Return DAMP while the device is lost and the robot is not damped."""
        if time - self._polled > DEVICE_TIMEOUT:  # motors were being enabled: heartbeats waited, and are as old as that
            self._resumed = time
        self._polled = time
        heard = self._heartbeats().get(self._name)
        mode = Mode.ZERO_TORQUE if output is None else output.control_mode.mode
        drives = mode not in (Mode.ZERO_TORQUE, Mode.DAMPING)
        if heard is None:
            is_lost = drives
        else:  # one that is lost already is there again with a heartbeat only
            is_lost = not time - (heard if self._is_lost else max(heard, self._resumed)) <= DEVICE_TIMEOUT
        if is_lost == self._is_lost:
            return (Intent.DAMP,) if is_lost and drives else ()
        self._is_lost = is_lost
        if is_lost:
            silence = "no heartbeat yet" if heard is None else f"no heartbeat for {DEVICE_TIMEOUT:g} s"
            self._tell(f"{self._name}: lost, {silence}: DAMP")
            return (Intent.DAMP,)
        if heard is not None:
            self._tell(f"{self._name}: there again")
        return ()


def running_time() -> float:
    """Return s since the computer started, including the time for which it was suspended."""
    return system_time.clock_gettime(getattr(system_time, "CLOCK_BOOTTIME", system_time.CLOCK_MONOTONIC))


class Interruption(IntentSource):
    """Requests DAMP in the tick that follows a standstill, and when a terminal wants to suspend the process."""

    def __init__(self, period: float, longest: float, clock: Callable[[], float] = running_time) -> None:
        """Begin at the first tick; beyond `longest` s between two signs of life the loop stood still."""
        self._period, self._longest, self._clock = period, longest, clock
        self._last: float | None = None
        self._continued = self._damps = False
        self._news: deque[str] = deque()

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """Return DAMP, once, after a standstill or a refused suspension."""
        self.beat()
        damps, self._damps = self._damps, False
        return (Intent.DAMP,) if damps else ()

    def beat(self) -> bool:
        """Give a sign of life of the loop; return True if it has stood still since the one before."""
        now = self._clock()
        last, self._last = self._last, now
        limit = min(_LATE * self._period, self._longest) if self._continued else self._longest
        self._continued = False
        if last is None or now - last <= limit:
            return False
        self._damps = True
        self._news.append(
            f"the process stood still for {now - last:.2f} s: DAMPING; motors whose CAN timeout is shorter have "
            "stopped, reactivate enables them again"
        )
        return True

    def news(self) -> str:
        """Return the next line for the operator; empty for none."""
        return self._news.popleft() if self._news else ""

    def refuse_suspension(self) -> None:
        """Damp instead of suspending the process. May be called from a signal handler."""
        self._damps = True
        self._news.append("SIGTSTP (Ctrl-Z): a process that holds motors is not suspended; DAMPING instead")

    def note_continued(self) -> None:
        """Note that the process continues: one missed tick is a standstill then."""
        self._continued = True

    def restart(self) -> None:
        """Start anew: what has just happened was not part of the loop."""
        self._last = None
