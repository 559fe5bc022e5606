"""The operator's own device, such as a gamepad: where it must be there, its loss damps the robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from humanoid_sim.messages import Intent, Mode, TickOutput
from humanoid_sim.session.sources import IntentSource

__all__ = ["DEVICE_TIMEOUT", "OperatorDevice"]

DEVICE_TIMEOUT = 0.2
"""s without a heartbeat after which a device counts as lost."""

_PASSIVE = (Mode.ZERO_TORQUE, Mode.DAMPING)


class OperatorDevice(IntentSource):
    """Asks for DAMP in every tick in which the device is not there, which no other intent gets past.

    Before the device was first heard, modes that drive no joint are left as they are.
    """

    def __init__(self, name: str, heartbeats: Mapping[str, float], tell: Callable[[str], None]) -> None:
        """Watch.

        Args:
            name: of the producer whose heartbeats count.
            heartbeats: arrival of the latest one by name, s, robot's clock; looked at in every tick.
            tell: records a line: the device is lost, or there again.
        """
        self._name, self._heartbeats, self._tell = name, heartbeats, tell
        self._is_lost = False

    def poll(self, time: float, output: TickOutput | None) -> Sequence[Intent]:
        """DAMP while the device is lost."""
        heard = self._heartbeats.get(self._name)
        if heard is None:
            is_lost = output is not None and output.control_mode.mode not in _PASSIVE
        else:
            is_lost = time - heard > DEVICE_TIMEOUT
        if is_lost != self._is_lost:
            self._is_lost = is_lost
            silence = "never heard" if heard is None else f"silent for {1e3 * (time - heard):.0f} ms"
            self._tell(f"{self._name} lost, {silence}: DAMP" if is_lost else f"{self._name} is there again")
        return (Intent.DAMP,) if is_lost else ()
