"""Faults on purpose: what can go wrong with motors and buses, when it does, and how a person writes it down."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from humanoid_sim.errors import InputError, blaming, known_names, require_known
from humanoid_sim.robots.description import RobotDescription


@dataclass(frozen=True, slots=True)
class FaultInfo:
    """Description of a kind of fault."""

    scope: Literal["frames", "motor", "bus", "host"]
    """`frames`: what passes between the bus and a motor; `motor`; `bus`: a whole channel; `host`: the computer's end of
    a channel, which only a program in the same process can be given."""
    text: str
    unit: str = ""
    """Unit of its value; empty: it has none."""
    default: float = 0.0
    lowest: float = -math.inf
    highest: float = math.inf
    is_whole: bool = False
    """True if the value is a whole number."""


FAULTS: Mapping[str, FaultInfo] = {
    "lost": FaultInfo("frames", "frames to and from the motor get lost", "probability", 1.0, 0.0, 1.0),
    "delayed": FaultInfo("frames", "the motor's frames arrive late", "s", 0.3, 0.0, 10.0),
    "duplicated": FaultInfo("frames", "the motor's frames arrive twice", "probability", 1.0, 0.0, 1.0),
    "reordered": FaultInfo("frames", "a frame of the motor arrives after the next one", "probability", 0.5, 0.0, 1.0),
    "corrupted_id": FaultInfo("frames", "one bit of the motor's frame ids is inverted", "bit", 27, 0, 28, True),
    "corrupted_dlc": FaultInfo("frames", "the motor's frames have another length", "bytes", 7, 0, 8, True),
    "silent": FaultInfo("motor", "the motor hears and obeys, but no longer answers"),
    "unplugged": FaultInfo("motor", "the motor has neither power nor bus; plugged in again it boots"),
    "reset": FaultInfo("motor", "the motor falls back to reset mode, with no fault bit"),
    "over_temperature": FaultInfo("motor", "the motor is that hot", "°C", 150.0, 0.0, 500.0),
    "under_voltage": FaultInfo("motor", "the supply voltage falls to that", "V", 11.0, 0.0, 100.0),
    "over_voltage": FaultInfo("motor", "the supply voltage rises to that", "V", 61.0, 0.0, 100.0),
    "overcurrent": FaultInfo("motor", "the phase current is beyond what the driver takes"),
    "stalled": FaultInfo("motor", "the joint is jammed, and the firmware's overload protection trips"),
    "blocked": FaultInfo("motor", "the joint is jammed, and no motor notices"),
    "encoder_fault": FaultInfo("motor", "the motor's magnetic encoder reports a fault"),
    "encoder_jump": FaultInfo("motor", "the angle that the encoder reads jumps by that, with no fault bit", "rad", 1.0),
    "other_master": FaultInfo("bus", "another computer commands zero torque to every motor", "Hz", 50.0, 0.1, 1e3),
    "foreign_host": FaultInfo(
        "bus",
        "another computer reads a parameter of every motor, which from then on answers that computer",
        "Hz",
        5.0,
        0.1,
        1e3,
    ),
    "error_frames": FaultInfo(
        "bus", "the CAN controller reports protocol violations; no frame is lost", "Hz", 200.0, 0.1, 1e4
    ),
    "bus_off": FaultInfo("bus", "the CAN controller reports bus-off; no frame passes any more"),
    "enobufs": FaultInfo("host", "every frame to be sent is refused for want of buffer space"),
    "enobufs_once": FaultInfo("host", "one frame to be sent is refused for want of buffer space"),
}
"""By name, in the order in which they are listed."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: what, where, from when to when. An unknown kind or a number out of range is an `InputError`."""

    kind: str
    joints: tuple[str, ...] = ()
    """Joints whose motors it affects; empty: all. Faults of a bus hit the buses of these motors."""
    start: float = 0.0
    """s, on the emulator's clock, which starts with it."""
    duration: float = math.inf
    """s"""
    value: float | None = None
    """See `FAULTS`; None: the default."""

    def __post_init__(self) -> None:
        require_known("fault", (self.kind,), FAULTS)
        info = FAULTS[self.kind]
        if not (math.isfinite(self.start) and self.start >= 0.0):
            raise InputError(f"fault '{self.kind}': starts at {self.start} s, expected a finite number >= 0")
        if not self.duration > 0.0:
            raise InputError(f"fault '{self.kind}': lasts {self.duration} s, expected more than 0")
        if self.value is None:
            return
        if not info.unit:
            raise InputError(f"fault '{self.kind}': takes no value, but is given {self.value:g}")
        if not (math.isfinite(self.value) and info.lowest <= self.value <= info.highest):
            expected = "a finite number" if math.isinf(info.lowest) else f"{info.lowest:g} to {info.highest:g}"
            raise InputError(f"fault '{self.kind}': value is {self.value:g} {info.unit}, expected {expected}")
        if info.is_whole and self.value != int(self.value):
            raise InputError(f"fault '{self.kind}': value is {self.value:g} {info.unit}, expected a whole number")

    @property
    def info(self) -> FaultInfo:
        """Return what this kind does."""
        return FAULTS[self.kind]

    @property
    def amount(self) -> float:
        """The value, or the default of the kind."""
        return self.info.default if self.value is None else self.value

    def __str__(self) -> str:
        """As it is written on the command line."""
        value = "" if self.value is None else f"={self.value:g}"
        joints = f":{','.join(self.joints)}" if self.joints else ""
        duration = "" if math.isinf(self.duration) else f"+{self.duration:g}"
        return f"{self.kind}{value}{joints}@{self.start:g}{duration}"


_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_SYNTAX = re.compile(
    rf"(?P<kind>\w+)(?:=(?P<value>{_NUMBER}))?(?::(?P<motors>[^@]+))?(?:@(?P<start>{_NUMBER}?)(?:\+(?P<duration>{_NUMBER}))?)?"
)
_GRAMMAR = "KIND[=VALUE][:MOTOR,…][@START[+DURATION]], a motor by joint name or CAN id, times in s"


def parse_fault(text: str, description: RobotDescription) -> Fault:
    """Read `over_temperature=150:left_elbow_pitch@5+2`, `lost=0.2`, `silent:14`; what is wrong is an `InputError`."""
    found = _SYNTAX.fullmatch(text.strip())
    if found is None:
        raise InputError(f"--fault: is '{text}', expected {_GRAMMAR}")
    joints = tuple(_joint(word.strip(), text, description) for word in (found["motors"] or "").split(",") if word)
    with blaming(f"--fault '{text}'", InputError):
        return Fault(
            found["kind"],
            joints,
            float(found["start"] or 0.0),
            float(found["duration"]) if found["duration"] else math.inf,
            float(found["value"]) if found["value"] else None,
        )


def _joint(word: str, text: str, description: RobotDescription) -> str:
    motors = {joint.name: joint.motor for joint in description.joints if joint.motor is not None}
    if word in motors:
        return word
    if not word.isdecimal():
        raise InputError(f"--fault '{text}': {known_names('joint', word, motors)}")
    found = [name for name, motor in motors.items() if motor.can_id == int(word)]
    if len(found) == 1:
        return found[0]
    if found:
        raise InputError(f"--fault '{text}': id {word} is on several buses: {', '.join(found)}; name the joint")
    ids = (f"{motor.can_id}" for motor in motors.values())
    raise InputError(f"--fault '{text}': {known_names('CAN id', word, ids)}")


def describe_faults() -> str:
    """One line per kind, for a person."""
    lines = []
    for kind, info in FAULTS.items():
        name = f"{kind}={info.default:g}" if info.unit else kind
        lines.append(f"{name:<22} {info.text}{f' ({info.unit})' if info.unit else ''}")
    return "\n".join(lines)
