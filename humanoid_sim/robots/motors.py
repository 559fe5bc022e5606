"""What the Robstride motors' MIT frames can encode: gains beyond these limits are cut off by the firmware's format.

Source: Actuator-Control, `src/protocol/robstride.rs` (T-K-233 and Berkeley-Humanoids, commit d74dd3f): K_p and K_d are
sent as `u16 = trunc(clamp(v, 0, limit) / limit · 65535)`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

__all__ = ["MOTORS", "MotorLimits"]

_FULL_SCALE = 65535


@dataclass(frozen=True, slots=True)
class MotorLimits:
    """Full scale of each value in a motor's MIT frames, at the joint."""

    stiffness: float
    """N·m/rad"""
    damping: float
    """N·m·s/rad"""
    velocity: float
    """rad/s"""
    torque: float
    """N·m"""

    @property
    def stiffness_step(self) -> float:
        """N·m/rad, the least difference between two K_p."""
        return self.stiffness / _FULL_SCALE

    @property
    def damping_step(self) -> float:
        """N·m·s/rad, the least difference between two K_d."""
        return self.damping / _FULL_SCALE


MOTORS: Mapping[str, MotorLimits] = MappingProxyType(
    {
        "rs-00": MotorLimits(stiffness=500.0, damping=5.0, velocity=33.0, torque=14.0),
        "rs-01": MotorLimits(stiffness=500.0, damping=5.0, velocity=44.0, torque=17.0),
        "rs-02": MotorLimits(stiffness=500.0, damping=5.0, velocity=44.0, torque=17.0),
        "rs-03": MotorLimits(stiffness=5000.0, damping=100.0, velocity=20.0, torque=60.0),
        "rs-04": MotorLimits(stiffness=5000.0, damping=100.0, velocity=15.0, torque=120.0),
        "rs-05": MotorLimits(stiffness=500.0, damping=5.0, velocity=50.0, torque=5.5),
        "rs-06": MotorLimits(stiffness=5000.0, damping=100.0, velocity=50.0, torque=36.0),
    }
)
"""By the model's name in robot descriptions."""
