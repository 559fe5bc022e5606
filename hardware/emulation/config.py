"""The options of `hardware emulate`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

__all__ = ["EmulateConfig"]


@dataclass(frozen=True)
class EmulateConfig:
    """Emulate a robot's motors on CAN channels, moved by MuJoCo, until Ctrl-C.

    Other programs find them there as they would find real ones: on a CAN interface of the kernel (`vcan0`), or, for
    programs of other processes on the same machine, on `udp_multicast:239.74.163.2`. Within one program
    `play --hardware virtual:lite` starts its own. `--fault help` lists the faults.
    """

    channel: str = ""
    """Required. One channel for all motors, such as `can0` or `udp_multicast:239.74.163.2`, or one for each of the
    robot's buses, separated by commas."""
    robot: str = "lite"
    """A shipped robot's name, or its YAML file."""
    fault: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """A fault on purpose, KIND[=VALUE][:MOTOR,…][@START[+DURATION]], a motor by joint name or CAN id, times in s:
    `over_temperature:left_elbow_pitch@5+2`, `lost=0.2`, `silent:14`. May be repeated."""
    firmware: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """A firmware, JOINT=VERSION or MODEL=VERSION, such as `rs-02=0.2.2.11`. May be repeated; else the newest."""
    calibration: str | None = None
    """Assemble the motors as this calibration file says; without, every homing offset is 0."""
    bitrate: float = 1_000_000.0
    """bit/s of the modelled bus time; 0 where the channel itself takes time, as a real bus does."""
    scale: Literal["reference", "manual"] = "reference"
    """Convention in which the motors read and write signed values; `manual` is half a step off around 0."""
    sweep: bool = False
    """A hand leads the joints to and fro between their limits, one after the other, 4 s each, to try `calibrate`."""
    duration: float | None = None
    """s after which to end; none: never."""
    seed: int = 0
    """Of the faults that happen by chance."""
    quiet: bool = False
    """Do not print what happens to the motors."""
