"""The declared operator's device: its loss is a DAMP."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from humanoid_sim.messages import Intent, Mode, TickOutput
from humanoid_sim.session.sources import IntentSource

DEVICE_TIMEOUT = 0.2
"""s without a heartbeat after which a device is lost."""


class DeviceWatch(IntentSource):
    """Asks for DAMP when the heartbeats of a device stop, and whenever the robot is led out of DAMPING without it.

    A heartbeat says that the device is there, not only the program that reads it: whether it was unplugged, its program
    was killed or the radio is silent makes no difference here.
    """

    def __init__(
        self,
        name: str,
        heartbeats: Callable[[], Mapping[str, float]],
        tell: Callable[[str], None],
        timeout: float = DEVICE_TIMEOUT,
    ) -> None:
        """Watch. Before the first heartbeat the device is missing, but not lost: only driven joints are damped.

        Only while the loop runs can a device be lost: one that stood still damps for that reason (`Interruption`).

        Args:
            name: of the producer of the heartbeats.
            heartbeats: arrival of the latest one of each producer, s, robot's clock.
            tell: records a line: that the device is lost, or there again.
            timeout: s
        """
        self._name = name
        self._heartbeats = heartbeats
        self._tell = tell
        self._timeout = timeout
        self._is_lost = False
        self._polled = self._resumed = -math.inf

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """DAMP while the device is lost and the robot is not damped."""
        if time - self._polled > self._timeout:  # motors were being enabled: heartbeats waited, and are as old as that
            self._resumed = time
        self._polled = time
        heard = self._heartbeats().get(self._name)
        mode = Mode.ZERO_TORQUE if output is None else output.control_mode.mode
        drives = mode not in (Mode.ZERO_TORQUE, Mode.DAMPING)
        if heard is None:
            is_lost = drives
        else:  # one that is lost already is there again with a heartbeat only
            is_lost = not time - (heard if self._is_lost else max(heard, self._resumed)) <= self._timeout
        if is_lost != self._is_lost:
            self._is_lost = is_lost
            silence = "never heard" if heard is None else f"nothing heard for {self._timeout:g} s"
            if is_lost:
                self._tell(f"{self._name}: lost, {silence}: DAMP")
            elif heard is not None:
                self._tell(f"{self._name}: there again")
            return (Intent.DAMP,) if is_lost else ()
        return (Intent.DAMP,) if is_lost and drives else ()
