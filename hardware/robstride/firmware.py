"""Differences between firmware, by model and version, and the documents that state them.

A version has four numbers, `0.2.3.6`, of which the second belongs to the model: in everything that the vendor prints of
rs-00 to rs-04; rs-05 and rs-06 are assumed to follow.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

from humanoid_sim.errors import InputError
from humanoid_sim.robots.motors import MOTORS, MotorModel

FirmwareVersion: TypeAlias = tuple[int, int, int, int]

_EMULATED = 255  # fourth number of emulated motors' versions, which are as the manuals; the vendor's are far below


class _Firmware(NamedTuple):
    """Documented facts about the versions of one model."""

    first: FirmwareVersion  # that counts ±4π and not ±12.5 rad, and does not multiply K_p and K_d by 1.4167
    newest: FirmwareVersion  # that a document mentions
    first_reports: FirmwareVersion  # that knows active reports


_KNOWN: Mapping[str, _Firmware] = {
    # The vendor's firmware notes (RobStride/Product_Information, commit ba7236b) and the manuals of 2026-04-28.
    "rs-00": _Firmware((0, 0, 2, 7), (0, 0, 3, 6), (0, 0, 3, 0)),
    "rs-01": _Firmware((0, 1, 3, 4), (0, 1, 3, 6), (0, 1, 3, 0)),
    "rs-02": _Firmware((0, 2, 3, 6), (0, 2, 3, 9), (0, 2, 3, 0)),
    "rs-03": _Firmware((0, 3, 0, 6), (0, 3, 1, 10), (0, 3, 1, 0)),
    "rs-04": _Firmware((0, 4, 0, 6), (0, 4, 1, 12), (0, 4, 1, 0)),
}


def has_active_reports(model: MotorModel, version: FirmwareVersion) -> bool:
    """Return whether the motor knows the command of type 24; a model that no document mentions does."""
    return model.name not in _KNOWN or version >= _KNOWN[model.name].first_reports


def model_name(version: FirmwareVersion) -> str | None:
    """Return the model that a version is of; none if it is of no known one."""
    name = f"rs-{version[1]:02d}"
    return name if name in MOTORS else None


def parse_version(text: str) -> FirmwareVersion:
    """Return a version from `0.2.3.6`; an `InputError` if the text is not one."""
    parts = text.split(".")
    if len(parts) != 4 or not all(part.isascii() and part.isdigit() and int(part) <= 255 for part in parts):
        raise InputError(f"firmware version: is '{text}', expected four numbers of 0 to 255 such as 0.2.3.6")
    first, second, third, fourth = map(int, parts)
    return (first, second, third, fourth)


def version_text(version: FirmwareVersion) -> str:
    """Return a version as the vendor writes it: `0.2.3.6`."""
    return ".".join(str(number) for number in version)


def emulated_version(model: MotorModel) -> FirmwareVersion:
    """Return the version of an emulated motor, in which everything is as the manual has it."""
    return (0, int(model.name.removeprefix("rs-")), 3, _EMULATED)


def is_documented(model: MotorModel, version: FirmwareVersion) -> bool:
    """Return whether a document covers a version, or it is an emulated motor's."""
    return version[3] == _EMULATED or (model.name in _KNOWN and version <= _KNOWN[model.name].newest)


def firmware_problem(model: MotorModel, version: FirmwareVersion) -> str:
    """Return why a motor with this firmware must not be driven as this model, with its scales; empty when it may."""
    text, found = version_text(version), model_name(version)
    if found != model.name:
        return f"firmware {text} is of {found or 'no known model'}, the robot file says {model.name}"
    known = _KNOWN.get(model.name)
    if known is not None and version < known.first:
        older = f"firmware {text} is older than {version_text(known.first)}"
        return f"{older}: it counts ±12.5 rad, or multiplies K_p and K_d by 1.4167: update it"
    return ""
