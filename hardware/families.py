"""The families of motors that can be driven: what talks to them. A new one is a folder beside `sito/`, and a row here.

What a family's protocol has and has not is in `humanoid_sim.robots.motors`, in its row of `FAMILIES`. CONTRIBUTING.md
has an example.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from humanoid_sim.hardware.bus.open_channels import OpenChannels
from humanoid_sim.hardware.motors import FrameEncoder, MotorGroup, MotorLink, Rescue, SessionTerms
from humanoid_sim.hardware.robstride.codec import RobstrideEncoder
from humanoid_sim.hardware.robstride.session import RobstrideSession
from humanoid_sim.hardware.sito.codec import SitoEncoder, rescue_frames
from humanoid_sim.hardware.sito.session import SitoSession
from humanoid_sim.mit import FloatArray


@dataclass(frozen=True, slots=True)
class Driver:
    """Functions that drive a family's motors."""

    link: Callable[[OpenChannels, MotorGroup, SessionTerms], MotorLink]
    encoder: Callable[[MotorGroup], FrameEncoder]
    rescue: Callable[[MotorGroup, FloatArray], Sequence[Rescue]] | None = None
    """For a family without a timeout, what a guardian sends to each motor; the array is the damping of each, shape
    (motors,), N·m·s/rad."""


DRIVERS: Mapping[str, Driver] = MappingProxyType(
    {
        # In the order in which they are asked whether a frame is theirs: Robstride's identifiers have no mark.
        "sito": Driver(SitoSession, SitoEncoder, rescue_frames),
        "robstride": Driver(RobstrideSession, lambda motors: RobstrideEncoder(motors.motor_id, motors.model)),
    }
)
