"""Sito motors that are heard on some channels: those that are enabled, because the protocol has no question."""

from __future__ import annotations

import math
from dataclasses import dataclass

from humanoid_sim.hardware.bus.frame import Frame
from humanoid_sim.hardware.sito.codec import FROM_MOTOR, Feedback, PositionFeedback, decode, split_identifier
from humanoid_sim.robots.motors import MOTORS

LISTENING = 0.3
"""s in which a motor that sends feedback is heard: it comes every 255 ms at the latest."""
NO_QUESTION = "the Sito protocol has no question, so a motor that is not enabled stays silent and cannot be found"
_ANY_MODEL = MOTORS["TA40-50"]
"""Positions and velocities are the same for every model."""


@dataclass(slots=True)
class Heard:
    """Data received from one motor."""

    frames: int = 0
    position: float = math.nan
    """rad, motor frame."""
    velocity: float = math.nan
    """rad/s"""


class SitoEar:
    """Takes frames of channels, and sends nothing."""

    def __init__(self) -> None:
        self.motors: dict[tuple[int, int], Heard] = {}
        """By channel and device id."""

    def receive(self, channel: int, frame: Frame, _: float) -> bool:
        """Take a frame, on its receiver's thread; whether it is a Sito's."""
        parts = split_identifier(frame)
        if parts is None:
            return False
        device_id, kind = parts
        if kind in FROM_MOTOR:
            heard = self.motors.setdefault((channel, device_id), Heard())
            heard.frames += 1
            match decode(frame, _ANY_MODEL):
                case PositionFeedback(position=position):
                    heard.position = position
                case Feedback(velocity=velocity):
                    heard.velocity = velocity
        return True
