"""The options of `hardware`. Nothing heavy is imported here: `--help` must be quick."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import tyro

from humanoid_sim.robots.motors import FAMILIES

_Channel = Annotated[str, tyro.conf.Positional, tyro.conf.arg(help="Such as can0.")]
"""`can0`, or `interface:channel` for any interface of python-can."""
_Channels = Annotated[
    str,
    tyro.conf.Positional,
    tyro.conf.arg(help="One channel for all motors, or one for each of the robot's buses: can0,can1."),
]
_MotorId = Annotated[int, tyro.conf.Positional, tyro.conf.arg(metavar="MOTOR_ID", help="1 to 127.")]
_HostId = Annotated[int, tyro.conf.arg(help="Our own id on the bus.")]
_Robot = Annotated[str, tyro.conf.arg(help="A shipped robot, or its YAML file.")]
_Yes = Annotated[bool, tyro.conf.arg(help="Do not ask first.")]
if TYPE_CHECKING:
    _Family: TypeAlias = str
else:
    _Family = Literal[tuple(FAMILIES)]
ParameterKind = Literal["u8", "i8", "u16", "i16", "u32", "i32", "f32"]


@dataclass(frozen=True)
class Discover:
    """Ask every id on a channel who is there. Reads only. Exit status 3 if nothing answers.

    Motors that cannot be asked, such as Sito's, are listened for meanwhile; only an enabled one sends feedback.

    With --robot, exit status 1 if one of its motors is missing.
    """

    channels: _Channel
    """Such as can0, can0,can1 or udp_multicast:239.74.163.2."""
    first: int = 1
    """First id to ask."""
    last: int = 127
    """Last id to ask."""
    wait: float = 0.02
    """s to wait for each id."""
    firmware: bool = False
    """Ask for the firmware's version as well. A motor that does not know this question takes it for a stop."""
    robot: str | None = None
    """Name the joints of this robot, and what is missing of it."""
    host_id: int = 0xFD
    """Our own id on the bus, 253 (0xFD) in the vendor's tools."""


@dataclass(frozen=True)
class Ping:
    """Ask one motor who it is and how long it takes to answer. Reads only, but for --read-status.

    Exit status 3 if it does not answer. A motor that cannot be asked, such as a Sito, is listened for.
    """

    channel: _Channel
    motor_id: _MotorId
    count: int = 10
    """Times to ask."""
    family: _Family = "robstride"
    """Family of the motor, which is its protocol."""
    read_status: bool = False
    """Enable the motor for a moment, without torque, for its position, velocity, effort, temperature and faults."""
    model: str | None = None
    """Such as rs-02, for --read-status. Default: as its firmware's version tells."""
    host_id: _HostId = 0xFD


@dataclass(frozen=True)
class Get:
    """Read parameters."""

    channel: _Channel
    motor_id: _MotorId
    names: Annotated[tuple[str, ...], tyro.conf.Positional] = ()
    """Names such as canTimeout, or indices such as 0x7028. Default: all that have a name."""
    type: ParameterKind | None = None
    """Type of the values, for indices without a name."""
    host_id: _HostId = 0xFD


@dataclass(frozen=True)
class Set:
    """Write a parameter and read it back. It is lost at power-off unless saved."""

    channel: _Channel
    motor_id: _MotorId
    name: Annotated[str, tyro.conf.Positional]
    """A name such as canTimeout, or an index such as 0x7028."""
    value: Annotated[float, tyro.conf.Positional, tyro.conf.arg(metavar="VALUE")]
    """In the parameter's own unit."""
    type: ParameterKind | None = None
    """Type of the value, for an index without a name."""
    model: str | None = None
    """Such as rs-02, for values whose range is the model's. Default: as its firmware's version tells. A motor whose
    firmware does not know that question takes it for a stop."""
    host_id: _HostId = 0xFD


@dataclass(frozen=True)
class Save:
    """Have the motor keep its parameters beyond power-off."""

    channel: _Channel
    motor_id: _MotorId
    host_id: _HostId = 0xFD


@dataclass(frozen=True)
class Param:
    """Read, write or save the parameters of one motor, where its protocol has them, as Robstride's has.

    Exit status 3 if it does not answer.
    """

    command: Get | Set | Save


@dataclass(frozen=True)
class Calibrate:
    """Find homing offsets by moving every joint by hand from stop to stop.

    No motor is enabled at any time, but for those that say nothing before, such as Sito's: they are enabled limp, after
    a confirmation. Joints that are not swept keep what the file has for them. Enter ends the sweep and writes the file,
    Ctrl-C ends it and writes nothing. Exit status 1 if a swept joint could not be used, 3 if a motor does not answer.
    """

    channels: _Channels
    robot: _Robot = "lite"
    output: Path = Path("calibration.yaml")
    """The file to write, and to keep the other joints of."""
    joints: tuple[str, ...] = ()
    """Only these. Default: all."""
    threshold: float = 0.5
    """rad; a joint that was moved less keeps its previous offset."""
    tolerance: float = 0.2
    """rad by which a sweep may differ from the joint's range."""
    any_offset: bool = False
    """The motors' zeros were never set: a sweep outside a joint's limits is not a flipped direction."""
    duration: float | None = None
    """s after which the sweep ends by itself."""
    yes: bool = False
    """Do not ask before motors are enabled for the sweep."""
    host_id: _HostId = 0xFD


@dataclass(frozen=True)
class Identify:
    """Move one joint a little to see which one it is, and which way it goes. Nothing else is enabled.

    Exit status 1 if it did not move, or another one did; 3 if a motor does not answer.
    """

    channels: _Channels
    joint: Annotated[str, tyro.conf.Positional]
    """The joint's name."""
    robot: _Robot = "lite"
    angle: float = 0.15
    """rad to move, in the joint's positive direction, and back."""
    torque: float = 1.5
    """N·m at most: written to the motor as its torque limit meanwhile, where it knows one, and the bound of what it is
    told."""
    allow_no_timeout: bool = False
    """Move a motor too that nothing stops when this program or its computer dies, such as a Sito's."""
    yes: _Yes = False
    accept_firmware: tuple[str, ...] = ()
    """Versions that no document mentions, such as 0.2.3.20, with which the motor is to be driven all the same."""
    host_id: _HostId = 0xFD


@dataclass(frozen=True)
class Emulate:
    """Emulate a robot's motors on CAN channels, moved by MuJoCo, until Ctrl-C.

    Other programs find them there as they would find real ones: on a CAN interface of the kernel (`vcan0`), or, for
    programs of other processes on the same machine, on `udp_multicast:239.74.163.2`. Within one program
    `play --hardware virtual:lite` starts its own. `--fault help` lists the faults.
    """

    channel: str = ""
    """Required. One channel for all motors, such as `can0` or `udp_multicast:239.74.163.2`, or one for each of the
    robot's buses, separated by commas."""
    robot: _Robot = "lite"
    fault: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """A fault to inject, KIND[=VALUE][:MOTOR,…][@START[+DURATION]], a motor by joint name or CAN id, times in s, START
    from when the emulation begins:
    `over_temperature:left_elbow_pitch@5+2`, `silent=0.2`, `silent:14`. May be repeated."""
    firmware: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """A firmware, JOINT=VERSION or MODEL=VERSION, such as `rs-02=0.2.2.11`. May be repeated; else the newest."""
    calibration: str | None = None
    """Assemble the motors as this calibration file says; without, every homing offset is 0."""
    alone: str = ""
    """A joint whose motor is alone on the bus, with the factory's id 127: to try `set-id` and `set-zero`."""
    duration: float | None = None
    """s after which to end; none: never."""
    seed: int = 0
    """Seed of the faults that happen by chance."""
    quiet: bool = False
    """Do not print what happens to the motors."""


@dataclass(frozen=True)
class SetId:
    """Give the only motor on a bus another id, such as one that comes from the factory with 127.

    Connect one motor alone. Exit status 3 if none answers.
    """

    channel: _Channel
    new_id: Annotated[int, tyro.conf.Positional, tyro.conf.arg(metavar="NEW_ID")]
    """1 to 127."""
    yes: _Yes = False
    host_id: _HostId = 0xFD


@dataclass(frozen=True)
class SetZero:
    """Make the present position of the only motor on a bus its zero, and keep it beyond power-off.

    Connect one motor alone. Exit status 3 if none answers.
    """

    channel: _Channel
    yes: _Yes = False
    host_id: _HostId = 0xFD


TOOLS = Discover | Ping | Param | Calibrate | Identify | Emulate | SetId | SetZero
"""Each by its name in lower case, with hyphens."""
