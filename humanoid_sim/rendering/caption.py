"""What is said beside a picture of a run: when it was, and who was in control."""

from __future__ import annotations

from dataclasses import dataclass

from humanoid_sim.messages import Mode, TickRecord

MODE_COLOURS = {
    Mode.ZERO_TORQUE: (150, 156, 164),
    Mode.DAMPING: (232, 168, 56),
    Mode.STANDBY: (86, 160, 236),
    Mode.LOCOMOTION: (88, 196, 120),
    Mode.REMOTE: (184, 128, 232),
}


@dataclass(frozen=True, slots=True)
class Caption:
    """Words about one tick."""

    time: float  # s, robot's clock
    mode: Mode
    controller: str
    message: str = ""

    @classmethod
    def of(cls, record: TickRecord) -> Caption:
        """Return the caption of a tick."""
        control = record.output.control_mode
        return cls(float(record.input.state.time), control.mode, control.controller_name, control.status_message)
