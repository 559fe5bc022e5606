"""Faults to inject into mock motors and their buses."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from humanoid_sim.errors import InputError, require_known
from humanoid_sim.robots.schema import RobotDescription

FAULTS: dict[str, tuple[float, float, float]] = {
    "silent": (1.0, 0.0, 1.0),  # probability with which a frame of the motor is lost
    "late": (0.3, 0.0, 10.0),  # s by which its frames are late
    "garbage": (7, 0, 8),  # bytes to which its frames are cut
    "wrong_id": (126, 1, 127),  # id that it has
    "motor_fault": (1, 1, 1),  # it reports a phase overcurrent and stops
    "over_temperature": (150.0, 0.0, 500.0),  # °C
    "brown_out": (11.0, 0.0, 48.0),  # V of the supply; below 6 V the motor is off and boots later
    "stuck": (1, 1, 1),  # the joint is jammed
    "encoder_jump": (1.0, -100.0, 100.0),  # rad by which the measured angle jumps, without a fault bit
    "second_master": (50.0, 0.1, 1e3),  # Hz at which another computer commands zero torque to every motor
    "bus_off": (1, 1, 1),  # the CAN controller reports bus-off; no frame passes any more
}
"""By kind of fault, its value: default, lowest and highest."""
_SYNTAX = re.compile(
    r"(?P<kind>\w+)(?:=(?P<value>[-+.\w]+?))?(?::(?P<joints>[^@]+))?(?:@(?P<start>[\d.]*)(?:\+(?P<duration>[\d.]+))?)?"
)


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault, the motors that it affects, and its time."""

    kind: str
    joints: tuple[str, ...] = ()  # of the motors; empty: all. A fault of a channel affects these motors' channels
    start: float = 0.0  # s, on the motors' clock
    duration: float = math.inf  # s
    value: float | None = None  # None: the default of its kind

    @property
    def amount(self) -> float:
        return FAULTS[self.kind][0] if self.value is None else self.value

    def affects(self, joint: str) -> bool:
        return not self.joints or joint in self.joints


def parse_fault(text: str, description: RobotDescription) -> Fault:
    """Read a fault such as `over_temperature=150:left_elbow_pitch@5+2` or `silent=0.2`."""
    field = f"--fault '{text}': "
    found = _SYNTAX.fullmatch(text.strip())
    try:
        if found is None:
            raise ValueError
        kind, value = found["kind"], None if found["value"] is None else float(found["value"])
        start, duration = float(found["start"] or 0.0), float(found["duration"] or "inf")
    except ValueError:
        raise InputError(f"{field}expected KIND[=VALUE][:JOINT,…][@START[+DURATION]], times in s") from None
    require_known("fault", (kind,), FAULTS, field)
    _, lowest, highest = FAULTS[kind]
    if value is not None and not lowest <= value <= highest:  # NaN too
        raise InputError(f"{field}value is {value:g}, expected {lowest:g} to {highest:g}")
    joints = tuple(name.strip() for name in (found["joints"] or "").split(",") if name)
    require_known("joint", joints, description.joint_names, field)
    return Fault(kind, joints, start, duration, value)
