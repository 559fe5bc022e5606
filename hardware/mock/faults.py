"""Faults to inject into mock motors and their buses."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

from humanoid_sim.errors import InputError, known_names, require_known
from humanoid_sim.robots.schema import RobotDescription


class FaultKind(NamedTuple):
    """A kind of fault."""

    text: str
    unit: str = ""
    """Unit of its value; empty: it has none."""
    default: float = 0.0
    lowest: float = -math.inf
    highest: float = math.inf


FAULTS: Mapping[str, FaultKind] = MappingProxyType(
    {
        "silent": FaultKind("the motor obeys, but its frames get lost", "probability", 1.0, 0.0, 1.0),
        "late": FaultKind("the motor's frames arrive late", "s", 0.3, 0.0, 10.0),
        "garbage": FaultKind("the motor's frames arrive with so many bytes", "bytes", 7, 0, 8),
        "wrong_id": FaultKind("the motor has this id", "id", 126, 1, 127),
        "reset": FaultKind("the motor leaves run mode, without a fault bit"),
        "motor_fault": FaultKind("the motor reports a phase overcurrent, and stops"),
        "over_temperature": FaultKind("the motor is that hot", "°C", 150.0, 0.0, 500.0),
        "brown_out": FaultKind(
            "the supply falls to that; below 6 V the motor is off and boots later", "V", 11.0, 0.0, 100.0
        ),
        "stuck": FaultKind("the joint is jammed"),
        "encoder_jump": FaultKind("the angle that the encoder reads jumps by that, without a fault bit", "rad", 1.0),
        "second_master": FaultKind("another computer commands zero torque to every motor", "Hz", 50.0, 0.1, 1e3),
        "bus_off": FaultKind("the CAN controller reports bus-off; no frame passes any more"),
        "tx_full": FaultKind("the driver refuses every frame for want of buffer space (this process only)"),
    }
)
BUS_FAULTS = frozenset({"second_master", "bus_off", "tx_full"})  # faults of a whole channel; the others are a motor's


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault: which, where, from when to when."""

    kind: str
    joints: tuple[str, ...] = ()
    """Joints whose motors it affects; empty: all. A channel's fault hits the channels of these motors."""
    start: float = 0.0
    """s, on the simulation's clock."""
    duration: float = math.inf
    """s"""
    value: float | None = None
    """In the unit of its kind; None: the default."""

    @property
    def amount(self) -> float:
        """The value, or the default of its kind."""
        return FAULTS[self.kind].default if self.value is None else self.value

    def __str__(self) -> str:
        value = "" if self.value is None else f"={self.value:g}"
        joints = f":{','.join(self.joints)}" if self.joints else ""
        duration = "" if math.isinf(self.duration) else f"+{self.duration:g}"
        return f"{self.kind}{value}{joints}@{self.start:g}{duration}"


_SYNTAX = re.compile(
    r"(?P<kind>\w+)(?:=(?P<value>[-+.\w]+?))?(?::(?P<motors>[^@]+))?(?:@(?P<start>[\d.]*)(?:\+(?P<duration>[\d.]+))?)?"
)
GRAMMAR = "KIND[=VALUE][:MOTOR,…][@START[+DURATION]], a motor by joint name or CAN id, times in s"


def parse_fault(text: str, description: RobotDescription) -> Fault:
    """Read a fault such as `over_temperature=150:left_elbow_pitch@5+2`, `silent=0.2` or `silent:14`."""
    field = f"--fault '{text}': "
    found = _SYNTAX.fullmatch(text.strip())
    if found is None:
        raise InputError(f"{field}expected {GRAMMAR}")
    kind, value = found["kind"], found["value"]
    require_known("fault", (kind,), FAULTS, field)
    known = FAULTS[kind]
    try:
        amount = None if value is None else float(value)
        start = float(found["start"] or 0.0)
        duration = float(found["duration"] or "inf")
    except ValueError:
        raise InputError(f"{field}expected {GRAMMAR}") from None
    if amount is not None and not (known.unit and math.isfinite(amount) and known.lowest <= amount <= known.highest):
        accepted = f"{known.lowest:g} to {known.highest:g} {known.unit}" if known.unit else "no value"
        raise InputError(f"{field}value is {value}, expected {accepted}")
    words = [word.strip() for word in (found["motors"] or "").split(",") if word]
    joints = tuple(_joint(word, field, description) for word in words)
    return Fault(kind, joints, start, duration, amount)


def _joint(word: str, field: str, description: RobotDescription) -> str:
    motors = {joint.name: joint.motor for joint in description.joints if joint.motor is not None}
    found = [name for name, motor in motors.items() if word in (name, str(motor.can_id))]
    if len(found) == 1:
        return found[0]
    ids = (str(motor.can_id) for motor in motors.values())
    more = f": on several buses, name one of {', '.join(found)}" if found else ""
    raise InputError(f"{field}{known_names('motor', word, (*motors, *ids))}{more}")


def describe_faults() -> str:
    """Return one line for each kind."""
    lines = []
    for name, kind in FAULTS.items():
        value = f"={kind.default:g}" if kind.unit else ""
        lines.append(f"{name + value:<22} {kind.text}{f' ({kind.unit})' if kind.unit else ''}")
    return "\n".join(lines)
