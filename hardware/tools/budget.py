"""`hardware budget`: whether a robot's motors fit on its channels, their load, and the highest control rate.

A period sends one command to each motor and gets one status back, all of them extended frames of 8 bytes. A Sito motor
may be sent its gains in a frame of their own, and gives its state in two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rich.markup import escape
from rich.table import Table

from humanoid_sim.cli import ExitStatus
from humanoid_sim.errors import InputError
from humanoid_sim.hardware.bus.address import BusAddress, bus_hints, parse_addresses
from humanoid_sim.hardware.bus.frame import FRAME_BITS
from humanoid_sim.hardware.robstride.parameters import report_interval
from humanoid_sim.hardware.tools.options import Budget
from humanoid_sim.hardware.tools.terminal import make_console, make_table
from humanoid_sim.robots.description import load_robot
from humanoid_sim.robots.motors import FAMILIES
from humanoid_sim.robots.schema import RobotDescription

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
    """Active reports of each motor that can send some."""
    frames: int
    """To motors in each period, at most, and as many from them. They get into the outgoing queue at once."""
    reporting: int
    """Motors that can send active reports."""

    @property
    def frame_time(self) -> tuple[float, float]:
        """The time of one frame, s."""
        return FRAME_BITS[0] / self.bitrate, FRAME_BITS[1] / self.bitrate

    @property
    def period_time(self) -> tuple[float, float]:
        """The bus's time for the commands and statuses of one period, s."""
        fast, slow = self.frame_time
        return 2 * self.frames * fast, 2 * self.frames * slow

    @property
    def load(self) -> tuple[float, float]:
        """Share of the bus's time, reports included; above 1 it cannot be had."""
        frames = 2 * self.frames * self.rate + self.reporting * self.reports_per_second
        return frames * self.frame_time[0], frames * self.frame_time[1]

    @property
    def highest_rate(self) -> tuple[float, float]:
        """Hz at which the bus is full; 0 where the reports alone fill it."""
        reports = self.reporting * self.reports_per_second
        fast, slow = (max(0.0, (1.0 / time - reports) / (2 * self.frames)) for time in self.frame_time)
        return fast, slow


def channel_budgets(
    description: RobotDescription, channel_count: int, rate: float, bitrate: float, reports_per_second: float
) -> tuple[ChannelBudget, ...]:
    """Return the budget of each channel, one for all motors or one per bus; an `InputError` if there are none such."""
    motors = [(joint.name, joint.motor) for joint in description.joints if joint.motor is not None]
    if not motors:
        raise InputError(f"{description.name}: no joint has a motor")
    buses = max(motor.bus for _, motor in motors) + 1
    if channel_count not in {1, buses}:
        raise InputError(f"{description.name}: {channel_count} channels given, expected 1 or one per bus, {buses}")
    budgets = []
    for channel in range(channel_count):
        here = [(name, motor) for name, motor in motors if channel_count == 1 or motor.bus == channel]
        families = [FAMILIES[motor.family] for _, motor in here]
        frames = sum(family.period_frames for family in families)
        reporting = sum(family.has_reports for family in families)
        names = tuple(name for name, _ in here)
        budgets.append(ChannelBudget(names, rate, bitrate, reports_per_second, frames, reporting))
    return tuple(budgets)


_NO_BUFFER = """\
If sending fails with "no buffer space available" (ENOBUFS), the kernel's queue is full:
  - it takes {queue} frames by default and a period sends {burst} at once: sudo ip link set CHANNEL txqueuelen {wanted}
  - or frames do not leave at all, because nobody acknowledges them (motors without power, a missing terminator, the
    wrong bit rate): the controller repeats the first one for ever. See the error counters and the state of
    ip -details -statistics link show CHANNEL, and what python -m humanoid_sim.hardware discover CHANNEL says
  - or the bus is full: the load above"""


def budget(config: Budget) -> int:
    """Print the budget; the exit status."""
    description = load_robot(config.robot)
    rate = config.rate if config.rate is not None else description.hardware.control_frequency
    for name, value in (("--rate", rate), ("--bitrate", config.bitrate)):
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{name}: is {value}, expected a number above 0")
    reports = 1.0 / report_interval(1) if config.reports else 0.0
    console = make_console()
    fits, bursts = [], []
    for addresses in _layouts(config, description):
        count = len(addresses)
        budgets = channel_budgets(description, count, rate, config.bitrate, reports)
        names = [str(address) for address in addresses if address is not None] or _unnamed(count)
        console.print(_table(description, names, budgets))
        fits.append(all(channel.load[1] <= 1.0 for channel in budgets))
        bursts.append(max(channel.frames for channel in budgets))
        for address, channel in zip(addresses, budgets, strict=True):
            for hint in bus_hints(address, channel.frames) if address is not None else ():
                print(f"{address}: {hint}")
    burst = max(bursts)
    print(_NO_BUFFER.format(queue=DEFAULT_QUEUE, burst=burst, wanted=max(4 * burst, 100)))
    # Without --channels it is enough that one of the two layouts fits.
    return 0 if any(fits) else ExitStatus.FAILED


def _layouts(config: Budget, description: RobotDescription) -> list[Sequence[BusAddress | None]]:
    """Addresses by layout; None for a channel without a name."""
    if config.channels is not None:
        return [parse_addresses(config.channels)]
    buses = {joint.motor.bus for joint in description.joints if joint.motor is not None}
    counts = sorted({1, max(buses, default=0) + 1})
    return [[None] * count for count in counts]


def _unnamed(count: int) -> list[str]:
    return ["all motors"] if count == 1 else [f"bus {i}" for i in range(count)]


def _table(description: RobotDescription, names: Sequence[str], budgets: Sequence[ChannelBudget]) -> Table:
    first = budgets[0]
    channels = f"{len(budgets)} channel{'s' if len(budgets) > 1 else ''}"
    reports = f", reports every {1000.0 / first.reports_per_second:g} ms" if first.reports_per_second else ""
    title = f"{description.name} on {channels} at {first.rate:g} Hz{reports}"
    numbers = ("motors", "commands and replies", "load", "full at")
    table = make_table("channel", *numbers, "", right=numbers, title=escape(title))
    for name, channel in zip(names, budgets, strict=True):
        table.add_row(
            escape(name),
            str(len(channel.joints)),
            f"{1e3 * channel.period_time[0]:.2f}–{1e3 * channel.period_time[1]:.2f} ms",
            f"{100.0 * channel.load[0]:.0f}–{100.0 * channel.load[1]:.0f} %",
            f"{channel.highest_rate[1]:.0f}–{channel.highest_rate[0]:.0f} Hz",
            _verdict(channel),
        )
    return table


def _verdict(channel: ChannelBudget) -> str:
    slow = channel.load[1]
    if slow <= COMFORTABLE:
        return "[green]fits[/]"
    if slow <= 1.0:
        return "[yellow]tight: a repeated frame delays the next period[/]"
    return "[red]does not fit[/]"
