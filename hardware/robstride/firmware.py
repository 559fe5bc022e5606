"""Differences between firmware, by model and version, and the documents that state them.

A version has four numbers, `0.2.3.6`, of which the second belongs to the model: in everything that the vendor prints of
rs-00 to rs-04; rs-05 and rs-06 are assumed to follow. An operator decides what no document mentions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from humanoid_sim.errors import InputError
from humanoid_sim.robots.motors import MOTORS, MotorModel

FirmwareVersion: TypeAlias = tuple[int, int, int, int]

_NEVER: FirmwareVersion = (0, 0, 0, -1)  # before every version: something never was so, or always has been
_EMULATED = 255  # fourth number of emulated motors' versions, which are as the manuals; the vendor's are far below


@dataclass(frozen=True, slots=True)
class KnownFirmware:
    """Documented facts about the versions of one model. A version between two does what lies between them."""

    newest: FirmwareVersion | None = None  # that a document mentions
    last_old_range: FirmwareVersion = _NEVER  # the last that counts ±12.5 rad instead of ±4π
    first_true_gains: FirmwareVersion = _NEVER  # the first that does not multiply K_p and K_d by 1.4167
    first_reports: FirmwareVersion = _NEVER  # the first that knows active reports


_KNOWN: Mapping[str, KnownFirmware] = {
    # The vendor's firmware notes (RobStride/Product_Information, commit ba7236b) and the manuals of 2026-04-28.
    "rs-00": KnownFirmware((0, 0, 3, 6), (0, 0, 2, 6), _NEVER, (0, 0, 3, 0)),
    "rs-01": KnownFirmware((0, 1, 3, 6), (0, 1, 2, 1), (0, 1, 3, 4), (0, 1, 3, 0)),
    "rs-02": KnownFirmware((0, 2, 3, 9), (0, 2, 2, 11), (0, 2, 3, 6), (0, 2, 3, 0)),
    "rs-03": KnownFirmware((0, 3, 1, 10), (0, 3, 0, 5), _NEVER, (0, 3, 1, 0)),
    "rs-04": KnownFirmware((0, 4, 1, 12), (0, 4, 0, 5), _NEVER, (0, 4, 1, 0)),
}
_UNKNOWN = KnownFirmware()  # a model that the notes do not mention behaves as the manual has it


def position_range(model: MotorModel, version: FirmwareVersion) -> float:
    """Return full scale of positions, rad."""
    return 12.5 if version <= _KNOWN.get(model.name, _UNKNOWN).last_old_range else model.position


def gain_factor(model: MotorModel, version: FirmwareVersion) -> float:
    """Return the factor by which the motor multiplies a commanded stiffness and damping."""
    return 1.4167 if version < _KNOWN.get(model.name, _UNKNOWN).first_true_gains else 1.0


def has_active_reports(model: MotorModel, version: FirmwareVersion) -> bool:
    """Return whether the motor knows the command of type 24."""
    return version >= _KNOWN.get(model.name, _UNKNOWN).first_reports


def model_name(version: FirmwareVersion) -> str | None:
    """Return the model that a version is of; none if it is of no known one."""
    name = f"rs-{version[1]:02d}"
    return name if name in MOTORS else None


def parse_version(text: str) -> FirmwareVersion:
    """Return a version from `0.2.3.6`; an `InputError` if the text is not one."""
    parts = text.split(".")
    if len(parts) != 4 or not all(part.isascii() and part.isdigit() and int(part) <= 255 for part in parts):
        raise InputError(f"firmware version: is '{text}', expected four numbers of 0 to 255 such as 0.2.3.6")
    first, second, third, fourth = (int(part) for part in parts)
    return (first, second, third, fourth)


def version_text(version: FirmwareVersion) -> str:
    """Return a version as the vendor writes it: `0.2.3.6`."""
    return ".".join(str(number) for number in version)


def emulated_version(model: MotorModel) -> FirmwareVersion:
    """Return the version of an emulated motor, in which everything is as the manual has it."""
    return (0, int(model.name.removeprefix("rs-")), 3, _EMULATED)


def firmware_problem(model: MotorModel, version: FirmwareVersion) -> str:
    """Return why a motor with this firmware must not be driven as this model, with its scales; empty when it may."""
    found = model_name(version)
    if found != model.name:
        return f"firmware {version_text(version)} is of {found or 'no known model'}, the robot file says {model.name}"
    factor = gain_factor(model, version)
    return "" if factor == 1.0 else f"firmware {version_text(version)} multiplies K_p and K_d by {factor:g}: update it"


def firmware_question(model: MotorModel, version: FirmwareVersion) -> str:
    """Return why an operator has to accept this firmware; empty: a document covers it."""
    newest = _KNOWN.get(model.name, _UNKNOWN).newest
    if version[3] == _EMULATED or (newest is not None and version <= newest):
        return ""
    known = "no document mentions any" if newest is None else f"the newest documented is {version_text(newest)}"
    return f"firmware {version_text(version)} is in no document ({known}): its ranges and gains are an assumption"
