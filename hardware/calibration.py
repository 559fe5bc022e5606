"""The homing offsets of one physical robot: from sweeps by hand to `calibration.yaml`, and back.

An entry says where a motor's zero is when its joint is at zero, in the motor's frame, after assembly and after a motor
was replaced. Its `id` and `direction` are for the reader; the robot description decides.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from humanoid_sim.errors import InputError
from humanoid_sim.files import whole_file
from humanoid_sim.robots.schema import JointDescription, RobotDescription
from humanoid_sim.strict_yaml import read_yaml

_FIELDS = ("id", "direction", "homing_offset")
_LARGEST_OFFSET = 8.0 * math.pi
"""rad, the width of a motor's position range: beyond it no offset makes sense."""
_HEADING = """\
# Homing offsets of one robot, rad, motor frame: motor = direction * joint + homing_offset.
# Written by `python -m humanoid_sim.hardware calibrate`; id and direction are for the reader.
"""


@dataclass(frozen=True, slots=True)
class CalibrationEntry:
    """One joint's."""

    id: int
    """The motor's CAN id."""
    direction: int
    """±1"""
    homing_offset: float
    """rad, motor frame."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """A whole file."""

    entries: Mapping[str, CalibrationEntry]
    """By joint, in the file's order; joints that the robot has not (a neck that is not mounted) are kept."""
    warnings: tuple[str, ...] = ()
    """Disagreements of the file with the robot description, one line each."""

    def homing_offsets(self, description: RobotDescription) -> dict[str, float]:
        """Return every joint's offset, in the robot's order: rad, motor frame; an `InputError` names missing ones."""
        missing = [name for name in description.joint_names if name not in self.entries]
        if missing:
            raise InputError(
                f"calibration: lacks {', '.join(missing)}; "
                "run python -m humanoid_sim.hardware calibrate, which keeps the others"
            )
        return {name: self.entries[name].homing_offset for name in description.joint_names}


def load_calibration(path: str | os.PathLike[str], description: RobotDescription) -> Calibration:
    """Read a calibration for a robot.

    Raises `InputError` if the file cannot be read, is not a calibration, or names another motor for a joint: it is
    another robot's. One line with joint, field, value and what is accepted.
    """
    document = read_yaml(Path(path), str(path), "a calibration (YAML)")
    if not isinstance(document, dict) or not all(isinstance(name, str) for name in document):
        raise InputError(f"{path}: expected a mapping from joint names to {', '.join(_FIELDS)}")
    entries = {name: _entry(f"{path}: {name}", value) for name, value in document.items()}
    return Calibration(MappingProxyType(entries), tuple(_disagreements(path, entries, description)))


def _entry(where: str, value: Any) -> CalibrationEntry:
    if not isinstance(value, dict):
        raise InputError(f"{where}: is {_shown(value)}, expected a mapping with {', '.join(_FIELDS)}")
    for name in _FIELDS:
        if name not in value:
            raise InputError(f"{where}: misses '{name}'; expected {', '.join(_FIELDS)}")
    for name in value:
        if name not in _FIELDS:
            raise InputError(f"{where}: unknown field {_shown(name)}; expected {', '.join(_FIELDS)}")
    motor_id, direction, offset = (value[name] for name in _FIELDS)
    if type(motor_id) is not int or not 1 <= motor_id <= 255:
        raise InputError(f"{where}: id: is {_shown(motor_id)}, expected a whole number of 1 to 255")
    if type(direction) is not int or direction not in (-1, 1):
        raise InputError(f"{where}: direction: is {_shown(direction)}, expected 1 or -1")
    # The comparison is written so that NaN fails it.
    if type(offset) not in (int, float) or not abs(offset) <= _LARGEST_OFFSET:
        accepted = f"a number within ±{_LARGEST_OFFSET:.2f} rad"
        raise InputError(f"{where}: homing_offset: is {_shown(offset)}, expected {accepted}")
    return CalibrationEntry(motor_id, direction, float(offset))


def _shown(value: object) -> str:
    """Return a value for a message of one line, whatever a file may hold."""
    if isinstance(value, dict | list):
        return "a mapping" if isinstance(value, dict) else "a list"
    if isinstance(value, int) and value.bit_length() > 64:  # Python refuses to write out the longest
        return f"a number of {value.bit_length()} bits"
    return repr(value)[:80]


def _disagreements(
    path: str | os.PathLike[str], entries: Mapping[str, CalibrationEntry], description: RobotDescription
) -> list[str]:
    found = []
    joints = {joint.name: joint for joint in description.joints}
    for name, entry in entries.items():
        joint = joints.get(name)
        if joint is None or joint.motor is None:
            found.append(f"{path}: {name}: is not a driven joint of {description.name}; its entry is not used")
            continue
        if entry.id != joint.motor.can_id:
            raise InputError(
                f"{path}: {name}: id: is {entry.id}, the motor of {description.name}'s joint is {joint.motor.can_id}: "
                "another robot's calibration, or calibrate this joint anew"
            )
        if entry.direction != joint.motor.direction:
            found.append(
                f"{path}: {name}: direction: is {entry.direction}, the robot description has {joint.motor.direction}, "
                "which is used; calibrate this joint anew if its direction was wrong before"
            )
    return found


def save_calibration(path: str | os.PathLike[str], entries: Mapping[str, CalibrationEntry]) -> None:
    """Write a calibration: whole, or not at all, whatever happens meanwhile; an `InputError` where it cannot be."""
    path = Path(path)
    document = {
        name: {"id": entry.id, "direction": entry.direction, "homing_offset": round(entry.homing_offset, 6)}
        for name, entry in entries.items()
    }
    with whole_file(path) as file:
        if path.exists():
            os.fchmod(file.fileno(), path.stat().st_mode & 0o777)
        file.write((_HEADING + yaml.safe_dump(document, sort_keys=False)).encode())
        file.flush()
        os.fsync(file.fileno())  # before the name: after a power cut there is the old file or the whole new one


_TOUCH = 0.05
"""rad of overlap that is none: a joint whose range ends at zero touches its mirror image there."""


class Verdict(Enum):
    """Verdict on a sweep."""

    UNSWEPT = "unswept"
    """Less than the threshold: the joint keeps its previous offset."""
    GOOD = "good"
    INCOMPLETE = "partial"
    """Shorter than the joint's range: not both stops were reached, or they are nearer than the limits."""
    BEYOND = "beyond"
    """Longer than the joint's range: its stops are farther than its limits, or two motors answer as one."""
    FLIPPED = "flipped"
    """Range where the joint cannot be: its `direction` is wrong in the description, or its motor sits elsewhere."""


@dataclass(frozen=True, slots=True)
class Sweep:
    """Lowest and highest angle seen, rad; NaN before the first."""

    lowest: float = math.nan
    highest: float = math.nan

    @property
    def width(self) -> float:
        """The angle swept, rad; 0 before the first."""
        return 0.0 if math.isnan(self.lowest) else self.highest - self.lowest

    def with_angle(self, angle: float) -> Sweep:
        """Return the sweep with another angle in it, rad; one that is not finite changes nothing."""
        if not math.isfinite(angle):
            return self
        if math.isnan(self.lowest):
            return Sweep(angle, angle)
        return Sweep(min(self.lowest, angle), max(self.highest, angle))


@dataclass(frozen=True, slots=True)
class SweepResult:
    """Result of one joint's sweep."""

    verdict: Verdict
    width: float
    """rad swept."""
    homing_offset: float | None
    """rad, motor frame; none unless the verdict is GOOD."""


def evaluate(
    joint: JointDescription, direction: int, sweep: Sweep, *, threshold: float, tolerance: float, any_offset: bool
) -> SweepResult:
    """Return what a sweep says of a joint with limits.

    `homing_offset = ½ · ((lowest - lower) + (highest - upper)) · direction`, after the sweep was moved by whole turns
    to where its middle is nearest to that of the limits: since it was switched on, a motor does not know its turn.

    Args:
        joint: whose limits are its stops.
        direction: ±1, of its motor.
        threshold: rad; less is not a sweep.
        tolerance: rad by which a sweep may differ from the joint's range; the offset may be wrong by half of it.
        any_offset: do not conclude from a sweep outside the joint's limits that its direction is flipped: for motors
            that were assembled without setting their zero.
    """
    width = sweep.width
    if width < threshold:
        return SweepResult(Verdict.UNSWEPT, width, None)
    offset = 0.5 * ((sweep.lowest - joint.lower) + (sweep.highest - joint.upper))
    nearest = math.remainder(offset, 2.0 * math.pi)
    lowest, highest = sweep.lowest + nearest - offset, sweep.highest + nearest - offset
    overlap = min(highest, joint.upper) - max(lowest, joint.lower)
    if not any_offset and overlap <= min(_TOUCH, 0.5 * width):
        return SweepResult(Verdict.FLIPPED, width, None)
    excess = width - (joint.upper - joint.lower)
    if abs(excess) > tolerance:
        return SweepResult(Verdict.BEYOND if excess > 0.0 else Verdict.INCOMPLETE, width, None)
    return SweepResult(Verdict.GOOD, width, nearest * direction)
