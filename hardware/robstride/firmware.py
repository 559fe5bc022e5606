"""What old firmware does differently, by model and version.

A version has four numbers, `0.2.3.6`, of which the second belongs to the model. Source: the vendor's firmware notes and
the manuals of 2026-04-28.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

from humanoid_sim.errors import InputError
from humanoid_sim.robots.motors import MOTORS, MotorModel

__all__ = [
    "Firmware",
    "FirmwareVersion",
    "firmware_of",
    "firmware_problem",
    "firmware_warning",
    "model_name",
    "parse_version",
    "version_text",
]


FirmwareVersion: TypeAlias = tuple[int, int, int, int]

_OLD_POSITION_RANGE = 12.5
_OLD_GAIN_FACTOR = 1.4167
_LAST_OLD_RANGE: Mapping[str, FirmwareVersion] = {
    "rs-00": (0, 0, 2, 6),
    "rs-01": (0, 1, 2, 1),
    "rs-02": (0, 2, 2, 11),
    "rs-03": (0, 3, 0, 5),
    "rs-04": (0, 4, 0, 5),
}
_FIRST_TRUE_GAINS: Mapping[str, FirmwareVersion] = {"rs-01": (0, 1, 3, 4), "rs-02": (0, 2, 3, 6)}
_FIRST_REPORTS: Mapping[str, FirmwareVersion] = {
    "rs-00": (0, 0, 3, 0),
    "rs-01": (0, 1, 3, 0),
    "rs-02": (0, 2, 3, 0),
    "rs-03": (0, 3, 1, 0),
    "rs-04": (0, 4, 1, 0),
}
_LAST_REPORTS_AS_STATUS: Mapping[str, FirmwareVersion] = {
    "rs-00": (0, 0, 3, 2),
    "rs-01": (0, 1, 3, 2),
    "rs-03": (0, 3, 1, 2),
    "rs-04": (0, 4, 1, 2),
}


@dataclass(frozen=True, slots=True)
class Firmware:
    """What a version means for whoever talks to the motor."""

    position_range: float
    """rad, full scale of positions: a host that takes the new range for the old one is 0.5 % off."""
    gain_factor: float
    """What the motor multiplies a commanded stiffness and damping by, in operation mode."""
    has_active_reports: bool
    """Whether it knows the command of type 24."""
    reports_as_status: bool
    """Whether its active reports come as type 2."""

    def applied_to(self, model: MotorModel) -> MotorModel:
        """The model with this firmware's position range."""
        return replace(model, position=self.position_range)


def firmware_of(model: MotorModel, version: FirmwareVersion) -> Firmware:
    """What this version of a model does. A model that the notes do not mention behaves as the manual has it."""
    name = model.name
    old_range = version <= _LAST_OLD_RANGE.get(name, (0, 0, 0, -1))
    old_gains = version < _FIRST_TRUE_GAINS.get(name, (0, 0, 0, 0))
    return Firmware(
        position_range=_OLD_POSITION_RANGE if old_range else model.position,
        gain_factor=_OLD_GAIN_FACTOR if old_gains else 1.0,
        has_active_reports=version >= _FIRST_REPORTS.get(name, (0, 0, 0, 0)),
        reports_as_status=version <= _LAST_REPORTS_AS_STATUS.get(name, (0, 0, 0, -1)),
    )


def model_name(version: FirmwareVersion) -> str | None:
    """The model that a version is of; none if it is of no known one.

    The second number is the model's in everything that the vendor prints of rs-00 to rs-04; rs-05 and rs-06 are taken
    to follow.
    """
    name = f"rs-{version[1]:02d}"
    return name if name in MOTORS else None


def parse_version(text: str) -> FirmwareVersion:
    """A version from `0.2.3.6`.

    Raises:
        InputError: the text is no such version.
    """
    parts = text.split(".")
    if len(parts) != 4 or not all(part.isascii() and part.isdigit() and int(part) <= 255 for part in parts):
        raise InputError(f"firmware version: is '{text}', expected four numbers of 0 to 255 such as 0.2.3.6")
    first, second, third, fourth = (int(part) for part in parts)
    return (first, second, third, fourth)


def version_text(version: FirmwareVersion) -> str:
    """A version as the vendor writes it: `0.2.3.6`."""
    return ".".join(str(number) for number in version)


def firmware_problem(model: MotorModel, version: FirmwareVersion) -> str:
    """Why a motor with this firmware must not be driven as this model; empty when it may.

    A motor driven as another model would scale torque, velocity and gains wrongly.
    """
    found = model_name(version)
    if found != model.name:
        whose = f"is an {found}'s" if found else "is no known model's"
        return f"its firmware {version_text(version)} {whose}, the robot description has an {model.name} here"
    factor = firmware_of(model, version).gain_factor
    if factor != 1.0:
        return f"its firmware {version_text(version)} multiplies K_p and K_d by {factor:g}: update it"
    return ""


def firmware_warning(model: MotorModel, version: FirmwareVersion) -> str:
    """What an operator should know about this firmware; empty for nothing."""
    found = firmware_of(model, version).position_range
    if found == model.position:
        return ""
    return (
        f"its firmware {version_text(version)} counts ±{found:g} rad where frames are read as ±{model.position:.3f}: "
        f"angles are off by {100.0 * (model.position / found - 1.0):.1f} %"
    )
