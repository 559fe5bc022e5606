"""What a robot's motors ask of its CAN channels: load, and the highest control rate. Pure functions.

A period sends one command to each motor and gets one status back, all of them extended frames of 8 bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from humanoid_sim.errors import InputError
from humanoid_sim.robots.schema import RobotDescription

__all__ = ["COMFORTABLE", "DEFAULT_QUEUE", "FRAME_BITS", "ChannelBudget", "channel_budgets"]

FRAME_BITS = (131, 160)
"""Bits of an extended frame of 8 bytes with the space to the next one: without stuff bits, and with the most."""
DEFAULT_QUEUE = 10
"""Frames that the kernel queues for a CAN interface (`txqueuelen`), unless told otherwise."""
COMFORTABLE = 0.7
"""Load up to which a frame that is repeated, or a parameter that is read, finds room within its period."""


@dataclass(frozen=True, slots=True)
class ChannelBudget:
    """One channel. Of every pair, the first is without stuff bits and the second with the most."""

    joints: tuple[str, ...]
    rate: float
    """Hz of control."""
    bitrate: float
    """bit/s"""
    reports_per_second: float
    """Active reports of each motor."""

    @property
    def burst(self) -> int:
        """Commands that a control period puts into the outgoing queue at once."""
        return len(self.joints)

    @property
    def frame_time(self) -> tuple[float, float]:
        """The time of one frame, s."""
        return FRAME_BITS[0] / self.bitrate, FRAME_BITS[1] / self.bitrate

    @property
    def period_time(self) -> tuple[float, float]:
        """The bus's time for the commands and statuses of one period, s."""
        fast, slow = self.frame_time
        return 2 * self.burst * fast, 2 * self.burst * slow

    @property
    def load(self) -> tuple[float, float]:
        """Share of the bus's time, reports included; above 1 it cannot be had."""
        frames = self.burst * (2.0 * self.rate + self.reports_per_second)
        return frames * self.frame_time[0], frames * self.frame_time[1]

    @property
    def highest_rate(self) -> tuple[float, float]:
        """Hz at which the bus is full; 0 where the reports alone fill it."""
        fast, slow = (max(0.0, (1.0 / time / self.burst - self.reports_per_second) / 2.0) for time in self.frame_time)
        return fast, slow


def channel_budgets(
    description: RobotDescription, channel_count: int, rate: float, bitrate: float, reports_per_second: float
) -> tuple[ChannelBudget, ...]:
    """The budget of each channel: one for all motors, or one for each of the robot's buses.

    Raises:
        InputError: the robot has no motors, or not so many buses.
    """
    motors = [(joint.name, joint.motor) for joint in description.joints if joint.motor is not None]
    if not motors:
        raise InputError(f"{description.name}: no joint has a motor")
    buses = max(motor.bus for _, motor in motors) + 1
    if channel_count not in {1, buses}:
        raise InputError(f"{description.name}: {channel_count} channels given, expected 1 or one per bus, {buses}")
    groups: Sequence[list[str]] = [[] for _ in range(channel_count)]
    for name, motor in motors:
        groups[motor.bus if channel_count > 1 else 0].append(name)
    return tuple(ChannelBudget(tuple(group), rate, bitrate, reports_per_second) for group in groups)
