"""`calibration.yaml` of one physical robot: homing offsets from sweeps by hand, and the directions that were confirmed.

`motor = direction * joint + homing_offset`, rad. An entry's `id` and `direction` are those of the robot description at
the time; the description decides.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import msgspec
import yaml

from humanoid_sim.errors import InputError, meant
from humanoid_sim.files import whole_file
from humanoid_sim.robots.schema import JointDescription, RobotDescription
from humanoid_sim.strict_yaml import converted, read_yaml

_HEADING = """\
# One robot's homing offsets, rad: motor = direction * joint + homing_offset. Written by
# `python -m humanoid_sim.hardware calibrate`, and by `identify`, where a person has confirmed a joint's direction.
"""


class CalibrationEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One joint's."""

    id: Annotated[int, msgspec.Meta(ge=1, le=255)]  # the motor's CAN id
    direction: Literal[-1, 1]
    homing_offset: Annotated[float, msgspec.Meta(ge=-25.2, le=25.2)] | None = None  # rad, motor frame, within ±8π
    direction_confirmed: bool = False  # a person has seen the joint move the way of a rising angle


@dataclass(frozen=True, slots=True)
class Calibration:
    """A whole file."""

    entries: Mapping[str, CalibrationEntry]  # by joint, in the file's order; joints that the robot lacks are kept
    warnings: tuple[str, ...] = ()  # disagreements of the file with the robot description, one line each
    path: str = "calibration"

    def homing_offsets(self, description: RobotDescription) -> dict[str, float]:
        """Return every joint's offset, in the robot's order: rad, motor frame; an `InputError` names missing ones."""
        known = {name: entry.homing_offset for name, entry in self.entries.items() if entry.homing_offset is not None}
        if missing := [name for name in description.joint_names if name not in known]:
            foreign = [f"{name}{meant(name, missing)}" for name in self.entries if name not in description.joint_names]
            others = f" (has {', '.join(foreign)} besides)" if foreign else ""
            text = f"lacks {', '.join(missing)}{others}; run python -m humanoid_sim.hardware calibrate"
            raise InputError(f"{self.path}: {text}")
        return {name: known[name] for name in description.joint_names}

    def unconfirmed(self, description: RobotDescription) -> tuple[str, ...]:
        """Return the joints whose present direction no person has confirmed."""
        directions = {joint.name: joint.motor.direction for joint in description.joints if joint.motor is not None}
        confirmed = {name: entry.direction for name, entry in self.entries.items() if entry.direction_confirmed}
        return tuple(name for name, direction in directions.items() if confirmed.get(name) != direction)


def load_calibration(path: str | os.PathLike[str], description: RobotDescription) -> Calibration:
    """Read a calibration for a robot; an `InputError` where it names another motor for a joint: another robot's."""
    document = read_yaml(Path(path), "a calibration (YAML)")
    accepted = ", ".join(CalibrationEntry.__struct_fields__)
    if not isinstance(document, dict):
        raise InputError(f"{path}: expected a mapping from joint names to {accepted}")
    motors = {joint.name: joint.motor for joint in description.joints if joint.motor is not None}
    entries, mirrored = {}, []
    for name, value in document.items():
        entries[name] = entry = converted(value, CalibrationEntry, f"{path}: {name}")
        motor = motors.get(name)
        if motor is not None and entry.id != motor.can_id:
            text = f"is {entry.id}, the motor of {description.name}'s joint is {motor.can_id}"
            raise InputError(f"{path}: {name}: id: {text}: another robot's calibration, or calibrate this joint anew")
        if motor is not None and entry.direction != motor.direction:
            mirrored.append(f"{name} ({entry.direction:+d})")
    used = f"directions are not those of {description.name}, which are used: calibrate these joints anew"
    warnings = (f"{path}: {used}: {', '.join(mirrored)}",) if mirrored else ()
    return Calibration(entries, warnings, str(path))


def read_entries(path: Path, description: RobotDescription) -> Mapping[str, CalibrationEntry]:
    """Return the entries of a calibration; none where there is no file."""
    return load_calibration(path, description).entries if path.exists() else {}


def save_calibration(
    path: str | os.PathLike[str], entries: Mapping[str, CalibrationEntry], first: Sequence[str] = ()
) -> None:
    """Write a calibration, the `first` joints first: whole, or not at all; an `InputError` where it cannot be."""
    order = dict.fromkeys([*(name for name in first if name in entries), *entries])
    document = {name: msgspec.to_builtins(entries[name]) for name in order}
    with whole_file(Path(path)) as file:
        file.write((_HEADING + yaml.safe_dump(document, sort_keys=False)).encode())
        file.flush()
        os.fsync(file.fileno())  # after a power cut there is the old file or the whole new one


_TOUCH = 0.05  # rad of overlap that is none: a joint whose range ends at zero touches its mirror image there
THRESHOLD = 0.5  # rad; a joint that was moved less keeps its previous offset


class Verdict(Enum):
    """Verdict on a sweep."""

    UNSWEPT = "unswept"
    GOOD = "good"
    INCOMPLETE = "partial"  # shorter than the joint's range: not both stops were reached, or they are nearer
    BEYOND = "beyond"  # longer: its stops are farther than its limits, or two motors answer as one
    FLIPPED = "flipped"  # outside the range: its `direction` is wrong in the description, or its motor sits elsewhere


Sweep: TypeAlias = tuple[float, float]
"""Lowest and highest angle of a joint, rad, `direction · motor`; NaN before the first."""


def evaluate(
    joint: JointDescription, direction: int, sweep: Sweep, *, tolerance: float, any_offset: bool
) -> tuple[Verdict, float | None]:
    """Return the verdict on a joint's sweep, and its homing offset, rad, motor frame, if it is good.

    `homing_offset = ½ · ((lowest - lower) + (highest - upper)) · direction`, after the sweep was moved by whole turns
    to where its middle is nearest to that of the limits: a motor does not know its turn since it was switched on.
    `tolerance`: rad by which a sweep may differ from the joint's range; the offset may be wrong by half of it.
    `any_offset`: accept any zero. A sweep outside the limits then does not count as a flipped direction.
    """
    lowest, highest = sweep
    width = highest - lowest
    if not width >= THRESHOLD:  # NaN
        return Verdict.UNSWEPT, None
    offset = 0.5 * ((lowest - joint.lower) + (highest - joint.upper))
    nearest = math.remainder(offset, 2.0 * math.pi)
    overlap = min(highest + nearest - offset, joint.upper) - max(lowest + nearest - offset, joint.lower)
    if not any_offset and overlap <= min(_TOUCH, 0.5 * width):
        return Verdict.FLIPPED, None
    excess = width - (joint.upper - joint.lower)
    if abs(excess) > tolerance:
        return (Verdict.BEYOND if excess > 0.0 else Verdict.INCOMPLETE), None
    return Verdict.GOOD, round(nearest * direction, 6)
