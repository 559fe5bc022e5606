"""The options of `hardware`. Nothing heavy is imported here: `--help` must be quick."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, UseAppendAction, arg

_Channel = Annotated[str, Positional, arg(help="Such as can0, or udp_multicast:239.74.163.2.")]
_Channels = Annotated[
    str, Positional, arg(help="One channel for all motors, or one for each of the robot's buses: can0,can1.")
]
_MotorId = Annotated[int, Positional, arg(metavar="MOTOR_ID", help="1 to 127.")]
_Robot = Annotated[str, arg(help="A shipped robot, or its YAML file.")]
_Yes = Annotated[bool, arg(help="Do not ask first.")]
_Calibration = Annotated[Path, arg(help="The calibration to write; its other joints are kept.")]


@dataclass(frozen=True)
class Discover:
    """Ask every id who is there. Reads only; a Sito motor has no questions, and is not found.

    Exit status 1 if a motor of --robot is missing, 3 if none answers.
    """

    channels: _Channels
    robot: str | None = None  # Name the joints of this robot, and its missing motors.
    last: int = 127  # Highest id to ask.


@dataclass(frozen=True)
class Ping:
    """Ask one Robstride motor who and how it is. Reads only; exit status 3 if it is silent."""

    channel: _Channel
    motor_id: _MotorId


@dataclass(frozen=True)
class Param:
    """Read the parameters of one Robstride motor, or write one. Exit status 3 if it does not answer."""

    channel: _Channel
    motor_id: _MotorId
    names: Annotated[tuple[str, ...], Positional] = ()
    """Names such as canTimeout, or indices such as 0x7028. Default: all."""
    value: float | None = None
    """Write this to the one parameter that is named, in its own unit; it is lost at power-off unless saved."""
    save: bool = False  # Let the motor keep its parameters beyond power-off.


@dataclass(frozen=True)
class Identify:
    """Move one joint a little, to see which one it is and which way it goes, and store the confirmed direction.

    Nothing else is enabled. Exit status 1 if it did not move, another one did, or the direction is wrong; 3 if a motor
    does not answer.
    """

    channels: _Channels
    joint: Annotated[str, Positional, arg(help="Its name.")]
    robot: _Robot = "lite"
    angle: float = 0.15  # rad to move, in the joint's positive direction, and back.
    torque: float = 1.5  # N·m at most.
    output: _Calibration = Path("calibration.yaml")
    yes: Annotated[bool, arg(help="Do not ask before it moves. Nothing is stored without a person.")] = False
    allow_no_timeout: bool = False
    """Move a motor too that nothing but a watchdog stops when this program dies, such as a Sito's."""
    accept_firmware: tuple[str, ...] = ()
    """Versions that no document mentions, such as 0.2.3.20, with which the motor is to be driven all the same."""


@dataclass(frozen=True)
class Calibrate:
    """Find homing offsets by moving every joint by hand from stop to stop.

    No motor is enabled, but for those that report nothing before (Sito): they are enabled limp, after a confirmation.
    Joints that are not swept keep their entries. Enter ends the sweep and writes the file, Ctrl-C writes nothing. Exit
    status 1 if a swept joint could not be used, 3 if a motor does not answer.
    """

    channels: _Channels
    robot: _Robot = "lite"
    output: _Calibration = Path("calibration.yaml")
    joints: tuple[str, ...] = ()  # Only these. Default: all.
    tolerance: float = 0.2  # rad by which a sweep may differ from the joint's range.
    any_offset: bool = False
    """Accept any zero, for motors whose zeros were never set: a sweep outside the limits is not a flipped direction."""


@dataclass(frozen=True)
class SetId:
    """Give the only motor on a bus another id. Exit status 3 if none answers."""

    channel: _Channel
    new_id: Annotated[int, Positional, arg(metavar="NEW_ID", help="1 to 127.")]
    yes: _Yes = False


@dataclass(frozen=True)
class SetZero:
    """Make the position of the only motor on a bus its zero, beyond power-off. Exit status 3 if none answers."""

    channel: _Channel
    yes: _Yes = False


@dataclass(frozen=True)
class Emulate:
    """Emulate a robot's motors on CAN channels that other programs can use, until Ctrl-C.

    `play --hardware virtual:lite` starts its own.
    """

    channel: str
    """One channel for all motors, such as vcan0 or udp_multicast:239.74.163.2, or one for each of the robot's buses."""
    robot: _Robot = "lite"
    fault: Annotated[tuple[str, ...], UseAppendAction] = ()
    """A fault to inject, KIND[=VALUE][:JOINT,…][@START[+DURATION]], times in s: over_temperature:left_elbow_pitch@5+2.
    May be repeated. Kinds: silent late garbage wrong_id motor_fault over_temperature brown_out stuck encoder_jump
    second_master bus_off."""
    firmware: Annotated[tuple[str, ...], UseAppendAction] = ()
    """Version that the motors of a model report, MODEL=VERSION, such as rs-02=0.2.3.32. May be repeated."""
    calibration: Path | None = None
    """Assemble the motors as this calibration file says; without, every homing offset is 0."""
    quiet: bool = False  # Print no changes of motors and faults.


TOOLS = Discover | Ping | Param | Identify | Calibrate | SetId | SetZero | Emulate
"""Each by its name in lower case, with hyphens."""
