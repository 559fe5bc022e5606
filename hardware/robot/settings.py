"""What an adapter was told, checked: channels, wiring, times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from humanoid_sim.errors import InputError
from humanoid_sim.hardware.bus.address import BusAddress, parse_address
from humanoid_sim.hardware.robot.wiring import Wiring, make_wiring
from humanoid_sim.hardware.robstride.commands import LARGEST_MOTOR_ID
from humanoid_sim.hardware.robstride.parameters import CanTimeout
from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["AdapterSettings", "make_settings"]


@dataclass(frozen=True, slots=True, eq=False)
class AdapterSettings:
    """All that stays the same between two activations."""

    name: str
    """The robot's."""
    addresses: tuple[BusAddress, ...]
    wiring: Wiring
    host_id: int
    control_period: float
    """s between two commands."""
    can_timeout: float
    """s without a command after which a motor stops by itself."""
    rx_timeout: float
    """s without a status after which a joint counts as silent."""
    damping: FloatArray
    """Shape (n,), N·m·s/rad, of the command that stands in for a bad one and that closing sends."""


def make_settings(
    description: RobotDescription,
    channels: Sequence[BusAddress | str],
    calibration: Mapping[str, float],
    *,
    control_period: float | None,
    host_id: int,
    can_timeout: float,
) -> AdapterSettings:
    """Settings for a robot; the arguments are those of `RobstrideRobot`.

    Raises:
        InputError: a channel, the calibration or a number does not fit.
    """
    name = description.name
    addresses = tuple(parse_address(channel) if isinstance(channel, str) else channel for channel in channels)
    if len(set(addresses)) < len(addresses):
        raise InputError(f"{name}: a channel is named twice; one channel carries all motors by itself")
    if not LARGEST_MOTOR_ID < host_id <= 0xFF:
        raise InputError(f"host id: is {host_id}, expected {LARGEST_MOTOR_ID + 1} to 255, above every motor's")
    period = 1.0 / description.hardware.control_frequency if control_period is None else control_period
    longest = CanTimeout.to_seconds(CanTimeout.LONGEST)
    if not period < can_timeout <= longest:
        raise InputError(
            f"CAN timeout: is {can_timeout:g} s, expected more than the control period of {period:g} s, and at most "
            f"{longest:g} s: motors without a timeout execute their last command for ever"
        )
    damping = description.damping_controller
    values = np.array(damping.damping or (damping.damping_scalar,) * description.joint_count)
    values.setflags(write=False)
    return AdapterSettings(
        name=name,
        addresses=addresses,
        wiring=make_wiring(description, len(addresses), calibration),
        host_id=host_id,
        control_period=period,
        can_timeout=can_timeout,
        rx_timeout=description.hardware.rx_timeout_ms / 1000.0,
        damping=values,
    )
